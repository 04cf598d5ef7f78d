//! What a loader hands to [`super::assemble`]: parts in units and axes of the file, f64 world space.

use super::material::{Material, Texture};
use super::{Finding, Role};
use crate::error::{Error, Result};
use glam::{DVec3, Vec2, Vec3};
use lightkiln_format::lighting::Light;
use std::path::Path;

/// Most triangles, and most vertices, a scene may have: about 10 GiB of memory.
pub const MAX_ELEMENTS: usize = 100_000_000;

/// A parsed scene file.
#[derive(Debug, Default)]
pub(super) struct Loaded {
    /// Placed primitives in file order; parts of a node follow one another.
    pub parts: Vec<Part>,
    /// Materials; a part's index lies within.
    pub materials: Vec<Material>,
    /// Role that the file gives to triangles of each material.
    pub material_roles: Vec<Option<Role>>,
    /// Decoded textures.
    pub textures: Vec<Texture>,
    /// Lights; positions in units and axes of the file.
    pub lights: Vec<Light>,
    /// What was repaired or left out.
    pub findings: Vec<Finding>,
    elements: usize,
}

/// A primitive placed by a node.
#[derive(Debug, Clone, Default)]
pub(super) struct Part {
    /// Number of the node; parts of equal number and mesh belong to one instance.
    pub node: usize,
    /// Names of the node and its ancestors, the node first, never empty.
    pub path: Vec<String>,
    /// Name of the mesh.
    pub mesh: String,
    /// Role that the file itself gives to the node or mesh.
    pub role: Option<Role>,
    /// Index into [`Loaded::materials`].
    pub material: u32,
    /// Vertex positions.
    pub positions: Vec<DVec3>,
    /// Normals, any length, NaN where missing; one a vertex.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one a vertex.
    pub uvs: Vec<Vec2>,
    /// Second texture coordinates, NaN where missing; one a vertex.
    pub lightmap_uvs: Vec<Vec2>,
    /// Vertex numbers, counter-clockwise seen from the front; not yet checked.
    pub triangles: Vec<[u32; 3]>,
}

impl Part {
    /// Node and mesh, for messages.
    pub fn label(&self) -> String {
        format!("node `{}`, mesh `{}`", self.path[0], self.mesh)
    }
}

impl Loaded {
    /// Adds a part.
    ///
    /// # Errors
    /// [`Error::Input`] beyond [`MAX_ELEMENTS`] triangles or vertices.
    pub fn push(&mut self, file: &Path, part: Part) -> Result<()> {
        self.elements += part.triangles.len().max(part.positions.len());
        if self.elements > MAX_ELEMENTS {
            let problem = format!("places more than {MAX_ELEMENTS} triangles or vertices");
            return Err(Error::input(file, part.label(), problem, "split the scene"));
        }
        self.parts.push(part);
        Ok(())
    }

    /// Adds a finding.
    pub fn find(&mut self, element: impl Into<String>, what: impl Into<String>, count: u64) {
        self.findings.push(Finding {
            element: element.into(),
            what: what.into(),
            count,
        });
    }
}
