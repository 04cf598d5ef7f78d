//! Files and `data:` URIs that scene files refer to.

use crate::error::{Error, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::path::{Path, PathBuf};

/// Reads a regular file. Pipes and devices are refused: they may never end.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>> {
    let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "read", e))?;
    if !meta.is_file() {
        return Err(Error::input(
            path,
            "file",
            "is not a regular file",
            "name a file",
        ));
    }
    std::fs::read(path).map_err(|e| Error::io(path, "read", e))
}

/// Why a file could not be read, without its path: findings are the same on every machine.
pub(super) fn reason(error: &Error) -> String {
    match error {
        Error::Io { source, .. } => format!("cannot be read: {}", source.kind()),
        Error::Input { problem, .. } => problem.clone(),
        other => other.to_string(),
    }
}

/// The bytes behind a glTF URI: a `data:` URI, or a file relative to `file`.
///
/// # Errors
/// A message for the user: schemes other than `data:`, malformed base64, unreadable files.
pub(super) fn read_uri(file: &Path, uri: &str) -> std::result::Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, body) = data.split_once(',').ok_or("the data URI has no comma")?;
        let body = percent_decode(body);
        return if kind.ends_with(";base64") {
            STANDARD
                .decode(body.trim_ascii())
                .map_err(|e| format!("bad base64: {e}"))
        } else {
            Ok(body)
        };
    }
    if let Some((scheme, _)) = uri.split_once("://") {
        return Err(format!(
            "`{scheme}:` is not read; only files beside the scene and data URIs"
        ));
    }
    let name = String::from_utf8(percent_decode(uri)).map_err(|_| "the URI is not UTF-8")?;
    read_file(&beside(file, &name)).map_err(|e| reason(&e))
}

/// `name`, relative to the folder of `file`. Backslashes of Windows exporters count as separators.
pub(super) fn beside(file: &Path, name: &str) -> PathBuf {
    let folder = file.parent().unwrap_or(Path::new(""));
    let path = folder.join(name);
    if path.exists() {
        path
    } else {
        folder.join(name.replace('\\', "/"))
    }
}

fn percent_decode(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = if bytes[i] == b'%' {
            text.get(i + 1..i + 3)
        } else {
            None
        };
        match hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) => {
                decoded.push(byte);
                i += 3;
            }
            None => {
                decoded.push(bytes[i]);
                i += 1;
            }
        }
    }
    decoded
}
