//! The container of every array asset: a safetensors file, written atomically and checked on reading.
//!
//! Layout (<https://github.com/huggingface/safetensors>): `u64` header length, JSON header padded
//! to 8 bytes, data. Ours adds to the header's `__metadata__`: `format` (the asset's kind),
//! `version` (of that kind) and `blake3.NAME` for each array, so that a damaged byte is found
//! wherever it lies. Arrays are ordered by element size, then name: all are aligned, and the same
//! arrays give the same bytes. Everything is little-endian.

use crate::error::AssetError;
use bytemuck::Pod;
use half::f16;
use safetensors::tensor::{Dtype, Metadata, TensorInfo};
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

#[cfg(target_endian = "big")]
compile_error!("assets are little-endian and are read without conversion");

/// Longest header accepted, bytes. Ours have some kilobytes; the bound keeps a damaged length from
/// asking for memory.
const MAX_HEADER: u64 = 1 << 20;

/// Bytes read or hashed at a time.
const CHUNK: usize = 1 << 20;

/// Size and digest of a file as written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Written {
    /// Length in bytes.
    pub bytes: u64,
    /// BLAKE3 of all bytes.
    pub blake3: blake3::Hash,
}

/// A type whose slices are arrays of a container: a number, or a fixed-size array of one.
pub trait Element: Pod {
    /// Type of one number.
    const DTYPE: Dtype;
    /// Axes after the first; empty for plain numbers.
    const INNER: &'static [usize];
}

macro_rules! element {
    ($($number:ty => $dtype:ident),*) => {$(
        impl Element for $number {
            const DTYPE: Dtype = Dtype::$dtype;
            const INNER: &'static [usize] = &[];
        }
        impl<const N: usize> Element for [$number; N] where [$number; N]: Pod {
            const DTYPE: Dtype = Dtype::$dtype;
            const INNER: &'static [usize] = &[N];
        }
    )*};
}
element!(f64 => F64, f32 => F32, f16 => F16, u32 => U32, u16 => U16);

/// One named array, borrowed for writing.
#[derive(Debug, Clone)]
pub struct ArrayView<'a> {
    name: &'a str,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: &'a [u8],
}

impl<'a> ArrayView<'a> {
    /// `data` under `name`, its shape `[data.len()]` or `[data.len(), N]`.
    pub fn new<T: Element>(name: &'a str, data: &'a [T]) -> Self {
        let mut shape = vec![data.len()];
        shape.extend_from_slice(T::INNER);
        Self {
            name,
            dtype: T::DTYPE,
            shape,
            bytes: bytemuck::cast_slice(data),
        }
    }
}

/// Writes `arrays` as one container, atomically: a reader sees the old file or the whole new one.
///
/// The arrays are streamed from where they lie; nothing of their size is allocated.
///
/// # Errors
/// [`AssetError::Io`]; the temporary file is removed.
pub fn write(
    path: &Path,
    format: &str,
    version: u32,
    arrays: &[ArrayView<'_>],
) -> Result<Written, AssetError> {
    let mut arrays: Vec<_> = arrays.iter().collect();
    arrays.sort_by(|a, b| {
        b.dtype
            .bitsize()
            .cmp(&a.dtype.bitsize())
            .then(a.name.cmp(b.name))
    });
    let mut about = serde_json::Map::new();
    about.insert("format".into(), format.into());
    about.insert("version".into(), version.to_string().into());
    let mut infos = serde_json::Map::new();
    let mut offset = 0;
    for array in &arrays {
        let digest = blake3::hash(array.bytes).to_hex();
        about.insert(format!("blake3.{}", array.name), digest.as_str().into());
        let end = offset + array.bytes.len();
        let info = serde_json::json!(TensorInfo {
            dtype: array.dtype,
            shape: array.shape.clone(),
            data_offsets: (offset, end),
        });
        infos.insert(array.name.into(), info);
        offset = end;
    }
    let mut header = serde_json::Map::new();
    header.insert("__metadata__".into(), about.into());
    header.extend(infos);
    let mut header = serde_json::Value::Object(header).to_string().into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    write_atomically(path, |file| {
        file.write_all(&(header.len() as u64).to_le_bytes())?;
        file.write_all(&header)?;
        arrays
            .iter()
            .try_for_each(|array| file.write_all(array.bytes))
    })
}

/// Writes `bytes` to `path` atomically; for everything that is not a container.
///
/// # Errors
/// [`AssetError::Io`]; the temporary file is removed.
pub fn atomic_write(path: &Path, bytes: &[u8]) -> Result<Written, AssetError> {
    write_atomically(path, |file| file.write_all(bytes))
}

/// Counts and hashes what passes through.
struct Hashing<W> {
    inner: W,
    hasher: blake3::Hasher,
    bytes: u64,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, buffer: &[u8]) -> std::io::Result<usize> {
        // Large slices pass the buffer whole; bounded pieces keep the hash in cache.
        let n = self.inner.write(&buffer[..buffer.len().min(CHUNK)])?;
        self.hasher.update(&buffer[..n]);
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.inner.flush()
    }
}

/// Temporary file in the same folder, `fill`, sync, rename, sync of the folder.
fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<Hashing<File>>) -> std::io::Result<()>,
) -> Result<Written, AssetError> {
    static SERIAL: AtomicU32 = AtomicU32::new(0);
    let Some(name) = path.file_name() else {
        return Err(AssetError::damaged(path, "path", "does not name a file"));
    };
    let mut temporary_name = std::ffi::OsString::from(".");
    temporary_name.push(name);
    let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
    temporary_name.push(format!(".{}-{serial}.tmp", std::process::id()));
    let temporary = path.with_file_name(temporary_name);
    let file = File::create_new(&temporary).map_err(AssetError::io(&temporary, "create"))?;
    let written = stream(file, fill).and_then(|written| {
        std::fs::rename(&temporary, path)?;
        sync_folder(path)?;
        Ok(written)
    });
    written.map_err(|source| {
        // The first error is the one to tell; after the rename there is nothing to remove.
        let _ = std::fs::remove_file(&temporary);
        AssetError::Io {
            path: path.into(),
            action: "write",
            source,
        }
    })
}

fn stream(
    file: File,
    fill: impl FnOnce(&mut BufWriter<Hashing<File>>) -> std::io::Result<()>,
) -> std::io::Result<Written> {
    let hashing = Hashing {
        inner: file,
        hasher: blake3::Hasher::new(),
        bytes: 0,
    };
    let mut out = BufWriter::with_capacity(CHUNK, hashing);
    fill(&mut out)?;
    let hashing = out
        .into_inner()
        .map_err(std::io::IntoInnerError::into_error)?;
    hashing.inner.sync_all()?;
    Ok(Written {
        bytes: hashing.bytes,
        blake3: hashing.hasher.finalize(),
    })
}

/// Makes the rename itself durable, where folders can be synced.
#[cfg(unix)]
fn sync_folder(path: &Path) -> std::io::Result<()> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn sync_folder(_: &Path) -> std::io::Result<()> {
    Ok(())
}

/// An open container whose header has been checked; arrays are read on demand.
#[derive(Debug)]
pub struct Container {
    path: PathBuf,
    file: File,
    header: Metadata,
    data_start: u64,
}

impl Container {
    /// Opens a container of kind `format` and version `version`, and checks its header against the
    /// file's size: nothing larger than the header is allocated.
    ///
    /// # Errors
    /// [`AssetError::Io`] or [`AssetError::Damaged`].
    pub fn open(path: &Path, format: &str, version: u32) -> Result<Self, AssetError> {
        let io = || AssetError::io(path, "read");
        let damaged = |problem: String| AssetError::damaged(path, "header", problem);
        let mut file = File::open(path).map_err(io())?;
        let size = file.metadata().map_err(io())?.len();
        if size < 8 {
            return Err(damaged(format!(
                "the file has {size} bytes, too few for a container"
            )));
        }
        let mut length = [0; 8];
        file.read_exact(&mut length).map_err(io())?;
        let length = u64::from_le_bytes(length);
        if length > MAX_HEADER || length > size - 8 {
            let problem = format!("says it has {length} bytes, in a file of {size}");
            return Err(damaged(problem));
        }
        let mut header = vec![0; length as usize];
        file.read_exact(&mut header).map_err(io())?;
        let header: Metadata =
            serde_json::from_slice(&header).map_err(|e| damaged(format!("is malformed: {e}")))?;
        let data_start = 8 + length;
        let data_end = header.data_len() as u64;
        if size - data_start != data_end {
            let held = size - data_start;
            return Err(damaged(format!(
                "describes {data_end} bytes of data, the file has {held}"
            )));
        }
        let container = Self {
            path: path.into(),
            file,
            header,
            data_start,
        };
        let found = container.about("format")?;
        if found != format {
            return Err(damaged(format!("this is `{found}`, not `{format}`")));
        }
        let found = container.about("version")?;
        if found != version.to_string() {
            let problem = format!("`{format}` version {found}; this build reads version {version}");
            return Err(damaged(problem));
        }
        Ok(container)
    }

    fn about(&self, key: &str) -> Result<&str, AssetError> {
        let metadata = self.header.metadata().as_ref();
        metadata
            .and_then(|about| about.get(key))
            .map(String::as_str)
            .ok_or_else(|| AssetError::damaged(&self.path, "header", format!("`{key}` is missing")))
    }

    /// Reads one array whole, after checking type, shape and byte range, and checks its digest.
    ///
    /// # Errors
    /// [`AssetError::Damaged`] names the array; [`AssetError::Io`].
    pub fn array<T: Element>(&self, name: &str) -> Result<Vec<T>, AssetError> {
        let damaged = |problem| AssetError::damaged(&self.path, format!("array `{name}`"), problem);
        let info = self
            .header
            .info(name)
            .ok_or_else(|| damaged("is missing".into()))?;
        if info.dtype != T::DTYPE {
            return Err(damaged(format!(
                "has type {:?}, expected {:?}",
                info.dtype,
                T::DTYPE
            )));
        }
        let Some((&count, inner)) = info.shape.split_first() else {
            return Err(damaged("has no axis".into()));
        };
        if inner != T::INNER {
            let problem = format!("has shape {:?}, expected [_{}]", info.shape, axes(T::INNER));
            return Err(damaged(problem));
        }
        // `Metadata` has held the byte range against the shape, `open` against the file's size.
        let start = self.data_start + info.data_offsets.0 as u64;
        let digest = self.about(&format!("blake3.{name}"))?;
        let mut data = vec![T::zeroed(); count];
        let io = || AssetError::io(&self.path, "read");
        let mut file = &self.file;
        file.seek(SeekFrom::Start(start)).map_err(io())?;
        let mut hasher = blake3::Hasher::new();
        for piece in bytemuck::cast_slice_mut::<T, u8>(&mut data).chunks_mut(CHUNK) {
            file.read_exact(piece).map_err(io())?;
            hasher.update(piece);
        }
        if hasher.finalize().to_hex().as_str() != digest {
            return Err(damaged(
                "does not match its digest: the file is damaged".into(),
            ));
        }
        Ok(data)
    }
}

fn axes(inner: &[usize]) -> String {
    inner.iter().map(|n| format!(", {n}")).collect()
}
