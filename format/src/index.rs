//! `index.json`: what a bake has put into its output folder.
//!
//! The same input gives the same bytes: fields in declaration order, assets sorted by name and
//! technique, keys of free-form values sorted, and no time, host or path outside the folder. The
//! schema is `format/schema/index.schema.json`.

use crate::container::{Written, atomic_write};
use crate::error::AssetError;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Component, Path};

/// Version of the index's own layout.
pub const SCHEMA_VERSION: u32 = 1;

/// JSON Schema (draft 2020-12) of the index.
pub const SCHEMA: &str = include_str!("../schema/index.schema.json");

/// The index of an output folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Index {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Version of the tool that wrote it.
    pub tool_version: String,
    /// The baked assets.
    pub assets: Vec<Asset>,
}

/// One baked asset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Asset {
    /// Name of the scene in the manifest.
    pub name: String,
    /// Technique, such as `prm`.
    pub technique: String,
    /// Kind of the asset, as in its container, such as `lightkiln-prm`.
    pub kind: String,
    /// Version of that kind's layout.
    pub format_version: u32,
    /// The asset's files.
    pub files: Vec<FileEntry>,
    /// Resolved parameters of the bake.
    pub parameters: Value,
    /// Key of the plan: a digest of everything the asset depends on.
    pub plan_key: String,
    /// What the bake counted or measured, timings excepted.
    pub statistics: Value,
    /// What was left out, and why.
    pub skips: Vec<Note>,
    /// What was mended, and how.
    pub repairs: Vec<Note>,
}

/// One file of an asset.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Path relative to the index, with `/`.
    pub path: String,
    /// What the file is to the asset, such as `data` or `scene`.
    pub role: String,
    /// Length in bytes.
    pub bytes: u64,
    /// BLAKE3 of all bytes, 64 lower-case hexadecimal digits.
    pub blake3: String,
}

/// Something skipped or repaired.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Note {
    /// Element of the scene or asset, by name.
    pub element: String,
    /// What happened and why.
    pub reason: String,
    /// How many elements it stands for.
    pub count: u64,
}

impl FileEntry {
    /// The entry of a file just written.
    pub fn new(path: impl Into<String>, role: impl Into<String>, written: Written) -> Self {
        let blake3 = written.blake3.to_hex().to_string();
        Self {
            path: path.into(),
            role: role.into(),
            bytes: written.bytes,
            blake3,
        }
    }
}

impl Index {
    /// An empty index of this schema version.
    pub fn new(tool_version: impl Into<String>) -> Self {
        let tool_version = tool_version.into();
        Self {
            schema_version: SCHEMA_VERSION,
            tool_version,
            assets: Vec::new(),
        }
    }

    /// The bytes of the index: pretty JSON, everything unordered sorted.
    ///
    /// # Errors
    /// Those of `serde_json`; an index of plain values has none.
    pub fn to_json(&self) -> serde_json::Result<String> {
        let mut index = self.clone();
        index
            .assets
            .sort_by(|a, b| (&a.name, &a.technique).cmp(&(&b.name, &b.technique)));
        for asset in &mut index.assets {
            asset.parameters.sort_all_objects();
            asset.statistics.sort_all_objects();
            asset.files.sort_by(|a, b| a.path.cmp(&b.path));
        }
        let mut text = serde_json::to_string_pretty(&index)?;
        text.push('\n');
        Ok(text)
    }

    /// Validates and writes the index, atomically.
    ///
    /// # Errors
    /// [`AssetError::Damaged`] names the field that breaks a rule; [`AssetError::Io`].
    pub fn write(&self, path: &Path) -> Result<Written, AssetError> {
        self.validate(path)?;
        let text = self.to_json();
        let text = text.map_err(|e| AssetError::damaged(path, "index", e.to_string()))?;
        atomic_write(path, text.as_bytes())
    }

    /// Reads and validates an index.
    ///
    /// # Errors
    /// [`AssetError`] names the file and the field.
    pub fn read(path: &Path) -> Result<Self, AssetError> {
        let bytes = std::fs::read(path).map_err(AssetError::io(path, "read"))?;
        let index: Self = serde_json::from_slice(&bytes)
            .map_err(|e| AssetError::damaged(path, "index", e.to_string()))?;
        index.validate(path)?;
        Ok(index)
    }

    fn validate(&self, path: &Path) -> Result<(), AssetError> {
        let bad = |field: String, problem: String| Err(AssetError::damaged(path, field, problem));
        if self.schema_version != SCHEMA_VERSION {
            let found = self.schema_version;
            let problem = format!("is {found}; this build reads {SCHEMA_VERSION}");
            return bad("schema_version".into(), problem);
        }
        let mut names: Vec<_> = self
            .assets
            .iter()
            .map(|a| (&a.name, &a.technique))
            .collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
            let (name, technique) = twice[0];
            return bad("assets".into(), format!("`{name}` has `{technique}` twice"));
        }
        for (i, asset) in self.assets.iter().enumerate() {
            let words = [
                ("name", &asset.name),
                ("technique", &asset.technique),
                ("kind", &asset.kind),
            ];
            if let Some((field, _)) = words.iter().find(|(_, word)| word.is_empty()) {
                return bad(format!("assets[{i}].{field}"), "is empty".into());
            }
            for (field, value) in [
                ("parameters", &asset.parameters),
                ("statistics", &asset.statistics),
            ] {
                if !value.is_object() {
                    return bad(format!("assets[{i}].{field}"), "is not an object".into());
                }
            }
            for (j, file) in asset.files.iter().enumerate() {
                if let Some((field, problem)) = file.fault() {
                    return bad(format!("assets[{i}].files[{j}].{field}"), problem);
                }
            }
        }
        Ok(())
    }
}

impl FileEntry {
    /// The first field that breaks a rule, and what is wrong with it.
    fn fault(&self) -> Option<(&'static str, String)> {
        let inside = |path: &Path| path.components().all(|c| matches!(c, Component::Normal(_)));
        if self.path.is_empty() || self.path.contains(['\\', ':']) || !inside(Path::new(&self.path))
        {
            let problem = format!("`{}` is not a relative path inside the folder", self.path);
            return Some(("path", problem));
        }
        let digit = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
        if self.blake3.len() != 64 || !self.blake3.bytes().all(digit) {
            return Some(("blake3", "is not 64 lower-case hexadecimal digits".into()));
        }
        None
    }
}
