//! The manifest: `pipeline.toml` as it was written. Values are checked here, nothing is resolved:
//! an absent key stays `None`, a relative path stays relative to the manifest.

mod check;

use crate::error::{Error, Result};
use crate::scene::Role;
use glam::{DVec3, Vec3};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use wildmatch::WildMatch;

/// Metres per unit of the scene file where the manifest says nothing.
pub const DEFAULT_METRES_PER_UNIT: f64 = 1.0;
/// Width and height of a lightmap page in texels where the manifest says nothing.
pub const DEFAULT_PAGE_SIZE: u32 = 1024;
/// Vertical field of view in degrees where the manifest says nothing.
pub const DEFAULT_FOV_DEG: f64 = 60.0;
/// Output folder, relative to the manifest, where the manifest says nothing.
pub const DEFAULT_OUTPUT_DIR: &str = "baked";

/// Most paths a reference point: the longest sequence of the sampler.
pub const MAX_SAMPLES: u32 = 1 << 16;
/// Most entry cells: the operator between cells is a dense matrix.
pub const MAX_CELLS: u32 = 4096;

/// A whole manifest.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Where assets go.
    pub output: Option<OutputSpec>,
    /// The scenes, in file order.
    #[serde(default, rename = "scene")]
    pub scenes: Vec<SceneSpec>,
}

/// `[output]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputSpec {
    /// Folder of the assets, relative to the manifest; [`DEFAULT_OUTPUT_DIR`] if absent.
    pub dir: Option<PathBuf>,
}

/// `[[scene]]`. Coordinates are units and axes of the scene file, node transforms applied.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Name of the scene and of its output folder: a plain file name, unique in the manifest.
    pub name: String,
    /// The `.gltf`, `.glb` or `.obj` file, relative to the manifest.
    pub path: PathBuf,
    /// Metres per unit of the file; [`DEFAULT_METRES_PER_UNIT`] if absent.
    pub metres_per_unit: Option<f64>,
    /// The file's axis that points up; `+Y` if absent.
    pub up: Option<Up>,
    /// What the baker does with parts of the scene; later entries win.
    #[serde(default, rename = "role")]
    pub roles: Vec<RoleSpec>,
    /// Material overrides; later entries win, key by key.
    #[serde(default, rename = "material")]
    pub materials: Vec<MaterialSpec>,
    /// Portals given by hand.
    #[serde(default, rename = "portal")]
    pub portals: Vec<PortalSpec>,
    /// Where lamps may be at run time.
    #[serde(default, rename = "lamp_volume")]
    pub lamp_volumes: Vec<LampVolumeSpec>,
    /// Where reference points lie.
    pub domain: Option<DomainSpec>,
    /// Camera for pictures.
    pub view: Option<ViewSpec>,
    /// What is baked.
    #[serde(default, rename = "bake")]
    pub bakes: Vec<BakeSpec>,
}

/// An axis of the scene file, written `"+Y"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Up {
    /// `+X`
    #[serde(rename = "+X")]
    PlusX,
    /// `-X`
    #[serde(rename = "-X")]
    MinusX,
    /// `+Y`
    #[default]
    #[serde(rename = "+Y")]
    PlusY,
    /// `-Y`
    #[serde(rename = "-Y")]
    MinusY,
    /// `+Z`
    #[serde(rename = "+Z")]
    PlusZ,
    /// `-Z`
    #[serde(rename = "-Z")]
    MinusZ,
}

/// `[[scene.role]]`: exactly one of `match` and `box`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoleSpec {
    /// Nodes, meshes or materials by name.
    #[serde(rename = "match")]
    pub selector: Option<Selector>,
    /// Smallest and largest corner; takes triangles whose three vertices lie inside.
    #[serde(rename = "box")]
    pub bounds: Option<[DVec3; 2]>,
    /// The role given.
    pub role: Role,
}

/// `[[scene.material]]`: absent keys leave the material as it is.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialSpec {
    /// Nodes, meshes or materials by name.
    #[serde(rename = "match")]
    pub selector: Selector,
    /// Linear base colour, each in `[0, 1]`; replaces factor and texture.
    pub base_color: Option<Vec3>,
    /// Metallic factor in `[0, 1]`; replaces factor and texture.
    pub metallic: Option<f32>,
    /// Emitted radiance, W/(m² sr), linear RGB; replaces factor and texture.
    pub emissive: Option<Vec3>,
    /// Whether the back side reflects too.
    pub double_sided: Option<bool>,
}

/// `[[scene.portal]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortalSpec {
    /// Name, unique in the scene.
    pub name: String,
    /// Corners in order around the quadrilateral.
    pub corners: [DVec3; 4],
    /// Direction into the room, any length.
    pub inward: DVec3,
}

/// `[[scene.lamp_volume]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampVolumeSpec {
    /// Smallest and largest corner.
    #[serde(rename = "box")]
    pub bounds: [DVec3; 2],
}

/// `[scene.domain]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomainSpec {
    /// Where reference points lie.
    pub kind: DomainKind,
    /// Lightmap texels a metre.
    pub texels_per_metre: Option<f64>,
    /// Width and height of a lightmap page, texels; [`DEFAULT_PAGE_SIZE`] if absent.
    pub page_size: Option<u32>,
}

/// Where reference points lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum DomainKind {
    /// Texels of a lightmap atlas.
    Atlas,
}

/// `[scene.view]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewSpec {
    /// Position of the eye.
    pub eye: DVec3,
    /// Point looked at.
    pub target: DVec3,
    /// Vertical field of view, degrees; [`DEFAULT_FOV_DEG`] if absent.
    pub fov_deg: Option<f64>,
}

/// `[[scene.bake]]`: absent numbers come from the preset.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BakeSpec {
    /// What is baked.
    pub technique: Technique,
    /// Where absent numbers come from; `normal` if absent.
    pub preset: Option<Preset>,
    /// Paths a reference point, at most [`MAX_SAMPLES`].
    pub samples: Option<u32>,
    /// Entry cells aimed at, at most [`MAX_CELLS`].
    pub cells: Option<u32>,
    /// Entry points a cell.
    pub entries_per_cell: Option<u32>,
    /// Entry points a square metre.
    pub entry_density: Option<f64>,
    /// Bounces of light after the entry point.
    pub bounces: Option<u32>,
}

/// A baking technique of this version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum Technique {
    /// Precomputed radiance maps.
    Prm,
}

/// Where a job's absent numbers come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Seconds: to see whether roles and units are right.
    Draft,
    /// The default.
    #[default]
    Normal,
    /// For the final asset.
    High,
}

/// `node:`, `mesh:` or `material:` and a glob of `*` (any characters) and `?` (one character).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub struct Selector {
    /// Whose name is compared.
    pub target: Target,
    glob: WildMatch,
}

/// Whose name a [`Selector`] compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// The placed node (OBJ: group or object) or any of its ancestors.
    Node,
    /// The mesh.
    Mesh,
    /// The material.
    Material,
}

impl Selector {
    /// Whether the glob matches all of `name`; upper and lower case differ.
    pub fn matches(&self, name: &str) -> bool {
        self.glob.matches(name)
    }
}

impl std::fmt::Display for Selector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let target = match self.target {
            Target::Node => "node",
            Target::Mesh => "mesh",
            Target::Material => "material",
        };
        write!(f, "{target}:{}", self.glob.pattern())
    }
}

// Messages of the conversions below are `problem; remedy`, taken apart in `toml_error`.

impl TryFrom<String> for Selector {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let (kind, glob) = text.split_once(':').unwrap_or(("", &text));
        let target = match kind {
            "node" => Target::Node,
            "mesh" => Target::Mesh,
            "material" => Target::Material,
            _ => {
                return Err(format!(
                    "`{text}` does not say what it matches; write \"node:NAME\", \"mesh:NAME\" or \
                     \"material:NAME\", where * and ? stand for any characters and any one"
                ));
            }
        };
        Ok(Self {
            target,
            glob: WildMatch::new(glob),
        })
    }
}

impl TryFrom<String> for Technique {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let later = ["auto", "portal", "object", "sphere_set", "box_transfer"];
        known(&text, &[("prm", Self::Prm)], &later)
    }
}

impl TryFrom<String> for DomainKind {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        known(&text, &[("atlas", Self::Atlas)], &["vertices", "probes"])
    }
}

/// The value named `text`, or why there is none: `later` names what this version cannot do yet.
fn known<T: Copy>(text: &str, values: &[(&str, T)], later: &[&str]) -> Result<T, String> {
    if let Some(&(_, value)) = values.iter().find(|(name, _)| *name == text) {
        return Ok(value);
    }
    let list: Vec<&str> = values.iter().map(|&(name, _)| name).collect();
    if later.contains(&text) {
        let list = list.join(", ");
        return Err(format!(
            "`{text}` is not available in this version; available: {list}"
        ));
    }
    Err(format!(
        "`{text}` is not known; {}",
        did_you_mean(text, &list)
    ))
}

fn did_you_mean(name: &str, known: &[&str]) -> String {
    let nearest = known
        .iter()
        .min_by_key(|k| strsim::damerau_levenshtein(name, k));
    match nearest {
        Some(nearest) => format!("did you mean `{nearest}`? Known here: {}", known.join(", ")),
        None => "remove it".into(),
    }
}

impl SceneSpec {
    /// A scene file of which the manifest says nothing more.
    pub fn new(name: String, path: PathBuf) -> Self {
        Self {
            name,
            path,
            metres_per_unit: None,
            up: None,
            roles: Vec::new(),
            materials: Vec::new(),
            portals: Vec::new(),
            lamp_volumes: Vec::new(),
            domain: None,
            view: None,
            bakes: Vec::new(),
        }
    }
}

impl Manifest {
    /// Reads and checks a manifest.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, else [`Error::Manifest`] for the first key or
    /// value that is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, "read", e))?;
        Self::parse(&text, path)
    }

    /// Reads and checks a manifest's text; `path` is only named in messages.
    ///
    /// # Errors
    /// [`Error::Manifest`] for the first key or value that is wrong.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let manifest: Self = toml::from_str(text).map_err(|e| toml_error(&e, text, path))?;
        check::Check { file: path, text }.manifest(&manifest)?;
        Ok(manifest)
    }

    /// The output folder, for a manifest that lies at `path`.
    pub fn output_dir(&self, path: &Path) -> PathBuf {
        let dir = self.output.as_ref().and_then(|o| o.dir.as_deref());
        path.parent()
            .unwrap_or(Path::new(""))
            .join(dir.unwrap_or(Path::new(DEFAULT_OUTPUT_DIR)))
    }
}

fn line_at(text: &str, byte: usize) -> usize {
    text.bytes().take(byte).filter(|&b| b == b'\n').count() + 1
}

/// Turns serde's message into ours; unknown names are answered with the nearest known one.
fn toml_error(error: &toml::de::Error, text: &str, file: &Path) -> Error {
    let line = error.span().map(|span| line_at(text, span.start));
    let field = line.map_or_else(|| "file".into(), |l| format!("line {l}"));
    let message = error.message();
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    if let (true, [unknown, known @ ..]) = (message.starts_with("unknown "), quoted.as_slice()) {
        let kind = if message.starts_with("unknown field") {
            "key"
        } else {
            "value"
        };
        let problem = format!("unknown {kind} `{unknown}`");
        return Error::manifest(file, field, problem, did_you_mean(unknown, known));
    }
    let (problem, remedy) = message
        .split_once("; ")
        .unwrap_or((message, "correct the TOML at this line"));
    Error::manifest(file, field, problem, remedy)
}
