//! A scene as transport needs it: flat triangles in metres, `+Y` up, with materials and roles.
//! No type of a loader crosses this border.

mod assemble;
pub mod environment;
mod gltf;
mod loaded;
pub mod material;
mod normals;
mod obj;
mod overrides;
mod resource;
pub mod surface;
mod texture;

pub use assemble::{load, load_file};
pub use loaded::MAX_ELEMENTS;
pub use texture::{MAX_SCENE_TEXELS, MAX_TEXTURE_SIDE};

use glam::{DVec3, Vec2, Vec3};
use lightkiln_format::lighting::Light;
use material::{Material, Texture};
use serde::Serialize;
use std::ops::Range;

/// A loaded scene. All positions are metres relative to [`Scene::origin`], `+Y` up.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Name from the manifest.
    pub name: String,
    /// World position (metres) of the local zero: zero when the world's own origin lies within the
    /// scene's bounds, else the centre of the bounds, so that f32 loses nothing far from the origin.
    pub origin: DVec3,
    /// Vertex positions, metres, local.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one a vertex.
    pub normals: Vec<Vec3>,
    /// First texture coordinates, one a vertex; zero where the file has none.
    pub uvs: Vec<Vec2>,
    /// Authored second texture coordinates, one a vertex; NaN where the file has none.
    pub lightmap_uvs: Vec<Vec2>,
    /// All triangles, instances one after another.
    pub triangles: Vec<Triangle>,
    /// Placed meshes, in file order; their ranges cover [`Scene::triangles`] without gaps.
    pub instances: Vec<Instance>,
    /// Materials; index 0 always exists.
    pub materials: Vec<Material>,
    /// Decoded textures.
    pub textures: Vec<Texture>,
    /// Lights found in the file, world space.
    pub lights: Vec<Light>,
    /// Portals given by hand in the manifest.
    pub portals: Vec<Portal>,
    /// Where lamps may be at run time, local space.
    pub lamp_volumes: Vec<Bounds>,
    /// Camera for pictures, local space.
    pub view: Option<View>,
    /// Repairs and omissions made while loading.
    pub findings: Vec<Finding>,
}

/// One triangle. Front is counter-clockwise; instances with negative determinant are already turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into the vertex arrays.
    pub vertices: [u32; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Index into [`Scene::instances`].
    pub instance: u32,
}

/// A mesh placed by a node. A node whose triangles have several roles is several instances.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    /// Name of the node (OBJ: of the object or group).
    pub node: String,
    /// Name of the mesh.
    pub mesh: String,
    /// What the baker does with it.
    pub role: Role,
    /// Its triangles.
    pub triangles: Range<u32>,
}

/// What the baker does with an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Blocks and reflects light, receives a lightmap.
    #[default]
    Static,
    /// Moves at run time: not part of the static transport.
    Dynamic,
    /// A window or opening: light passes.
    Portal,
    /// Blocks and reflects light, but receives no lightmap.
    Occluder,
    /// Does not exist for the baker.
    Ignore,
}

impl Role {
    /// Whether triangles of this role block and reflect light in the static transport.
    pub fn blocks_light(self) -> bool {
        matches!(self, Self::Static | Self::Occluder)
    }
}

/// A quadrilateral portal, local metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Portal {
    /// Name from the manifest.
    pub name: String,
    /// Corners in order around the rectangle.
    pub corners: [Vec3; 4],
    /// Unit vector into the room.
    pub inward: Vec3,
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

/// A camera for pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Eye, local metres.
    pub eye: Vec3,
    /// Point looked at, local metres.
    pub target: Vec3,
    /// Vertical field of view, radians.
    pub vertical_fov: f32,
}

/// A repair or omission, listed in `index.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Node, mesh, material or field concerned.
    pub element: String,
    /// What was found and what was done about it.
    pub what: String,
    /// How many elements (triangles, normals, texels).
    pub count: u64,
}

impl Bounds {
    /// Bounds that contain nothing.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// Smallest bounds around `points`.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self {
            min: b.min.min(p),
            max: b.max.max(p),
        })
    }

    /// Length of the diagonal, metres; zero when empty.
    pub fn diagonal(&self) -> f32 {
        if self.min.x <= self.max.x {
            (self.max - self.min).length()
        } else {
            0.0
        }
    }
}

impl Scene {
    /// Corner positions of a triangle, metres, local.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize]
            .vertices
            .map(|v| self.positions[v as usize])
    }

    /// Twice the area times the unit geometric normal of a triangle, m².
    #[inline]
    pub fn double_area_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Material of a triangle.
    #[inline]
    pub fn material_of(&self, triangle: u32) -> &Material {
        &self.materials[self.triangles[triangle as usize].material as usize]
    }

    /// Role of a triangle's instance.
    #[inline]
    pub fn role_of(&self, triangle: u32) -> Role {
        self.instances[self.triangles[triangle as usize].instance as usize].role
    }

    /// Texture coordinates at barycentric `(u, v)`: `(1-u-v) c0 + u c1 + v c2`.
    #[inline]
    pub fn uv_at(&self, triangle: u32, u: f32, v: f32) -> Vec2 {
        let [a, b, c] = self.triangles[triangle as usize]
            .vertices
            .map(|i| self.uvs[i as usize]);
        a * (1.0 - u - v) + b * u + c * v
    }

    /// Diffuse albedo (linear RGB, dimensionless) at barycentric `(u, v)`.
    #[inline]
    pub fn albedo_at(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        let material = self.material_of(triangle);
        if material.has_albedo_texture() {
            material.albedo(&self.textures, self.uv_at(triangle, u, v))
        } else {
            material.constant_albedo()
        }
    }

    /// Bounds of all triangles that block light, local metres.
    pub fn bounds(&self) -> Bounds {
        let blocking = (0..self.triangles.len() as u32).filter(|&t| self.role_of(t).blocks_light());
        Bounds::of(blocking.flat_map(|t| self.corners(t)))
    }

    /// World position (metres) to local.
    pub fn to_local(&self, world: DVec3) -> Vec3 {
        (world - self.origin).as_vec3()
    }
}
