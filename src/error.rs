//! What can go wrong, said so that the user knows the file, the element, the field and the remedy.

use lightkiln_format::error::AssetError;
use lightkiln_format::lighting::LightingError;
use std::path::{Path, PathBuf};

/// Any failure of the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The manifest or a command-line value is wrong (exit code 2).
    #[error("{file}: {field}: {problem}")]
    Manifest {
        /// The manifest.
        file: PathBuf,
        /// Key, with line where known.
        field: String,
        /// What is wrong.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// A scene, image or asset is wrong (exit code 1).
    #[error("{file}: {element}: {problem}")]
    Input {
        /// The file.
        file: PathBuf,
        /// Node, mesh, accessor, array or field.
        element: String,
        /// What is wrong.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// A file could not be read or written (exit code 1).
    #[error("{file}: cannot {action}: {source}")]
    Io {
        /// The file.
        file: PathBuf,
        /// `read`, `write`, `create` ...
        action: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// The user interrupted the work (exit code 130).
    #[error("interrupted; nothing was left half-written")]
    Interrupted,
}

/// Result of the library's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Input`].
    pub fn input(
        file: &Path,
        element: impl Into<String>,
        problem: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Input {
            file: file.into(),
            element: element.into(),
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    /// An [`Error::Manifest`].
    pub fn manifest(
        file: &Path,
        field: impl Into<String>,
        problem: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Manifest {
            file: file.into(),
            field: field.into(),
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    /// An [`Error::Io`].
    pub fn io(file: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io {
            file: file.into(),
            action,
            source,
        }
    }

    /// What the user can do about it.
    pub fn remedy(&self) -> Option<&str> {
        match self {
            Self::Manifest { remedy, .. } | Self::Input { remedy, .. } => Some(remedy),
            _ => None,
        }
    }
}

impl From<AssetError> for Error {
    fn from(error: AssetError) -> Self {
        match error {
            AssetError::Io {
                path,
                action,
                source,
            } => Self::io(&path, action, source),
            AssetError::Damaged {
                path,
                part,
                problem,
            } => Self::input(&path, part, problem, "bake the asset again"),
            AssetError::Invalid { path, source } => Self::input(
                &path,
                source.array,
                source.to_string(),
                "bake the asset again",
            ),
            other => Self::input(Path::new(""), "asset", other.to_string(), "bake it again"),
        }
    }
}

impl From<LightingError> for Error {
    fn from(error: LightingError) -> Self {
        let file = match &error {
            LightingError::Io { path, .. } | LightingError::Toml { path, .. } => path.clone(),
            _ => PathBuf::from("lighting"),
        };
        Self::manifest(
            &file,
            "light",
            error.to_string(),
            "see the README's section on the lighting file for the keys of each kind of light",
        )
    }
}
