//! Damaged containers: always an error that names the file, or data that is still right.

use crate::random::{self, Random};
use lightkiln_format::error::AssetError;
use lightkiln_format::prm::Prm;
use std::path::Path;

/// Reads damaged bytes; the error must name the file and say which part.
fn read(path: &Path, bytes: &[u8]) -> Result<Prm, AssetError> {
    std::fs::write(path, bytes).unwrap();
    let result = Prm::read(path);
    if let Err(error) = &result {
        let text = error.to_string();
        assert!(text.starts_with(&path.display().to_string()), "{text}");
        assert!(!matches!(error, AssetError::Io { .. }), "{text}");
    }
    result
}

fn small() -> (tempfile::TempDir, std::path::PathBuf, Prm, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("prm.safetensors");
    let prm = random::prm(1, 5, 2, 1);
    prm.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (folder, path, prm, bytes)
}

#[test]
fn every_truncation_is_an_error() {
    let (_folder, path, _, bytes) = small();
    for length in 0..bytes.len() {
        assert!(
            read(&path, &bytes[..length]).is_err(),
            "accepted {length} bytes"
        );
    }
    let longer = [bytes.as_slice(), &[0]].concat();
    assert!(read(&path, &longer).is_err(), "accepted a byte too many");
}

#[test]
fn every_bit_flip_of_the_header_is_an_error() {
    let (_folder, path, _, bytes) = small();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for bit in 0..header * 8 {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(
            read(&path, &damaged).is_err(),
            "accepted a flip of bit {bit}"
        );
    }
}

#[test]
fn bit_flips_of_the_data_name_the_array() {
    let (_folder, path, _, bytes) = small();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let random = &mut Random(2);
    for _ in 0..500 {
        let bit = header * 8 + random.below((bytes.len() - header) * 8);
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        let error = read(&path, &damaged).unwrap_err().to_string();
        assert!(error.contains("array `"), "{error}");
    }
}

#[test]
fn many_random_changes_never_panic() {
    let (_folder, path, prm, bytes) = small();
    let random = &mut Random(3);
    for _ in 0..2000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + random.below(8) {
            let at = random.below(damaged.len().min(1200));
            damaged[at] = random.bits() as u8;
        }
        if let Ok(found) = read(&path, &damaged) {
            assert_eq!(found, prm);
        }
    }
}

#[test]
fn claims_of_huge_arrays_are_refused_before_allocating() {
    let (_folder, path, _, _) = small();
    let headers = [
        r#"{"origin":{"dtype":"F64","shape":[1152921504606846976],"data_offsets":[0,24]}}"#,
        r#"{"origin":{"dtype":"F64","shape":[3],"data_offsets":[0,9223372036854775807]}}"#,
        r#"{"origin":{"dtype":"F64","shape":[18446744073709551615,2],"data_offsets":[0,24]}}"#,
        r#"{"origin":{"dtype":"F64","shape":[3],"data_offsets":[24,0]}}"#,
        r#"{"origin":{"dtype":"F64","shape":[],"data_offsets":[0,24]}}"#,
        r#"{"a":{"dtype":"F64","shape":[3],"data_offsets":[8,32]}}"#,
        "[]",
        "{}",
        "",
    ];
    for header in headers {
        let length = (header.len() as u64).to_le_bytes();
        read(&path, &[&length, header.as_bytes(), &[0; 24]].concat()).unwrap_err();
    }
    read(&path, &u64::MAX.to_le_bytes()).unwrap_err();
}

#[test]
fn other_kinds_and_versions_are_named() {
    use lightkiln_format::container::{self, Container};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.safetensors");
    container::write(&path, "lightkiln-other", 3, &[]).unwrap();
    let error = Prm::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("lightkiln-other") && error.contains("lightkiln-prm"),
        "{error}"
    );
    let error = Container::open(&path, "lightkiln-other", 4)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("version 3") && error.contains("version 4"),
        "{error}"
    );
    Container::open(&path, "lightkiln-other", 3).unwrap();
}
