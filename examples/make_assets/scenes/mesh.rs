//! Triangles being collected into a scene.

use glam::{DVec2, DVec3, Vec2, Vec3};
use lightkiln::scene::material::{Material, Texture, TextureRef};
use lightkiln::scene::{Instance, Role, Scene, Triangle};

/// Positions are rounded to this many parts of a metre: joints computed from two sides meet in the
/// same bits, and the platform's sine and cosine do not show.
const PARTS: f64 = 65536.0;

/// A vertex of a curved surface; `uv` in metres along the surface.
#[derive(Clone, Copy)]
pub struct Corner {
    pub position: DVec3,
    pub normal: DVec3,
    pub uv: DVec2,
}

/// A scene under construction.
pub struct Mesh {
    scene: Scene,
    material: u32,
    tiles: Vec<f64>,
}

fn rounded(v: DVec3) -> DVec3 {
    (v * PARTS).round() / PARTS
}

impl Mesh {
    pub fn new(name: &str) -> Self {
        let scene = Scene {
            name: name.into(),
            ..Scene::default()
        };
        Self {
            scene,
            material: 0,
            tiles: Vec::new(),
        }
    }

    /// A material of one linear colour.
    pub fn colour(&mut self, name: &str, base_color: [f32; 3]) -> u32 {
        self.add(
            Material {
                name: name.into(),
                base_color: base_color.into(),
                ..Material::default()
            },
            1.0,
        )
    }

    /// A material of one texture that repeats every `tile` metres.
    pub fn textured(&mut self, texture: Texture, tile: f64) -> u32 {
        let material = Material {
            name: texture.name.clone(),
            base_color_texture: Some(TextureRef::new(self.scene.textures.len() as u32)),
            ..Material::default()
        };
        self.scene.textures.push(texture);
        self.add(material, tile)
    }

    fn add(&mut self, material: Material, tile: f64) -> u32 {
        self.scene.materials.push(material);
        self.tiles.push(tile);
        self.scene.materials.len() as u32 - 1
    }

    /// Begins a node; what follows belongs to it.
    pub fn node(&mut self, name: &str, material: u32) {
        let next = self.scene.triangles.len() as u32;
        self.material = material;
        self.scene.instances.push(Instance {
            node: name.into(),
            mesh: name.into(),
            role: Role::Static,
            triangles: next..next,
        });
    }

    /// A triangle whose front is the side of its normals; nothing if it has no area.
    fn triangle(&mut self, mut corners: [Corner; 3]) {
        for corner in &mut corners {
            corner.position = rounded(corner.position);
        }
        let [a, b, c] = corners.map(|k| k.position);
        let normal = (b - a).cross(c - a);
        if normal.length() < 1.0 / PARTS / PARTS {
            return;
        }
        if normal.dot(corners.iter().map(|k| k.normal).sum()) < 0.0 {
            corners.swap(1, 2);
        }
        let scene = &mut self.scene;
        let first = scene.positions.len() as u32;
        let tile = self.tiles[self.material as usize];
        for corner in corners {
            scene.positions.push(corner.position.as_vec3());
            let normal: Vec3 = rounded(corner.normal.normalize()).normalize().as_vec3();
            scene.normals.push(normal);
            let uv = (corner.uv / tile * PARTS).round() / PARTS;
            scene.uvs.push(uv.as_vec2());
            scene.lightmap_uvs.push(Vec2::NAN);
        }
        scene.triangles.push(Triangle {
            vertices: [first, first + 1, first + 2],
            material: self.material,
            instance: scene.instances.len() as u32 - 1,
        });
        if let Some(instance) = scene.instances.last_mut() {
            instance.triangles.end += 1;
        }
    }

    /// A curved surface of `n` by `m` quads over the corners `f(0..=n, 0..=m)`.
    pub fn patch(&mut self, [n, m]: [usize; 2], f: impl Fn(usize, usize) -> Corner) {
        for j in 0..m {
            for i in 0..n {
                let quad = [f(i, j), f(i + 1, j), f(i + 1, j + 1), f(i, j + 1)];
                self.triangle([quad[0], quad[1], quad[2]]);
                self.triangle([quad[0], quad[2], quad[3]]);
            }
        }
    }

    /// A flat convex polygon with its front towards `normal`, cut into a fan from its first corner.
    pub fn polygon(&mut self, corners: &[DVec3], normal: DVec3) {
        let corner = |position: DVec3| Corner {
            position,
            normal,
            uv: planar(position, normal),
        };
        for k in 1..corners.len() - 1 {
            self.triangle([corners[0], corners[k], corners[k + 1]].map(corner));
        }
    }

    pub fn finish(self) -> Scene {
        self.scene
    }
}

/// Coordinates (metres) in the axis plane that `normal` is most perpendicular to.
fn planar(p: DVec3, normal: DVec3) -> DVec2 {
    let n = normal.abs();
    if n.y >= n.x && n.y >= n.z {
        DVec2::new(p.x, p.z)
    } else if n.x > n.z {
        DVec2::new(p.z, -p.y)
    } else {
        DVec2::new(p.x, -p.y)
    }
}
