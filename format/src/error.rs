//! What can be wrong with an asset, said with file, array and element.

use std::path::{Path, PathBuf};

/// Why an asset could not be written, read or evaluated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssetError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// File or folder.
        path: PathBuf,
        /// `create`, `write`, `read` ...
        action: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// The container or the JSON around the data is damaged, or is no Lightkiln asset.
    #[error("{}: {part}: {problem}", path.display())]
    Damaged {
        /// File.
        path: PathBuf,
        /// `header`, or the array or field by name.
        part: String,
        /// What is wrong.
        problem: String,
    },
    /// An array of an asset breaks one of its rules.
    #[error("{}: {source}", path.display())]
    Invalid {
        /// File.
        path: PathBuf,
        /// Array, element and rule.
        source: InvalidArray,
    },
}

/// The first element that breaks a rule of an asset's arrays.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("array `{array}`, element {index}: {problem}")]
pub struct InvalidArray {
    /// Name of the array, as in the container and in the struct.
    pub array: &'static str,
    /// Zero-based element along the array's first axis.
    pub index: usize,
    /// What is wrong.
    pub problem: String,
}

impl InvalidArray {
    /// The error for element `index` of `array`.
    pub fn new(array: &'static str, index: usize, problem: impl Into<String>) -> Self {
        Self {
            array,
            index,
            problem: problem.into(),
        }
    }
}

impl AssetError {
    /// An [`AssetError::Io`], for `map_err`.
    pub fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io {
            path: path.into(),
            action,
            source,
        }
    }

    /// An [`AssetError::Damaged`].
    pub fn damaged(path: &Path, part: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Damaged {
            path: path.into(),
            part: part.into(),
            problem: problem.into(),
        }
    }
}
