//! Scenes built in memory for the tests.

use glam::{DVec3, Vec2, Vec3};
use lightkiln::scene::material::Material;
use lightkiln::scene::{Instance, Role, Scene, Triangle};

/// A scene being assembled from polygons in f64 world coordinates.
#[derive(Default)]
pub struct Builder {
    corners: Vec<[DVec3; 3]>,
    materials: Vec<u32>,
    kinds: Vec<Material>,
}

impl Builder {
    /// Adds a grey material and makes it current for what follows.
    pub fn grey(self, albedo: f32) -> Self {
        self.material(Material {
            base_color: Vec3::splat(albedo),
            ..Material::default()
        })
    }

    /// Adds a material and makes it current for what follows.
    pub fn material(mut self, material: Material) -> Self {
        self.kinds.push(material);
        self
    }

    /// A triangle, counter-clockwise seen from its front.
    pub fn triangle(mut self, corners: [DVec3; 3]) -> Self {
        self.materials.push(self.kinds.len() as u32 - 1);
        self.corners.push(corners);
        self
    }

    /// A quadrilateral as two triangles.
    pub fn quad(self, [a, b, c, d]: [DVec3; 4]) -> Self {
        self.triangle([a, b, c]).triangle([a, c, d])
    }

    /// An axis-aligned room seen from inside, each wall `n x n` quads.
    pub fn room(mut self, min: DVec3, max: DVec3, n: u32) -> Self {
        let size = max - min;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for high in [false, true] {
                let at = |i: u32, j: u32| {
                    let mut p = min;
                    p[u] += size[u] * f64::from(i) / f64::from(n);
                    p[v] += size[v] * f64::from(j) / f64::from(n);
                    p[axis] = if high { max[axis] } else { min[axis] };
                    p
                };
                for i in 0..n {
                    for j in 0..n {
                        let mut quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                        if high {
                            quad.reverse();
                        }
                        self = self.quad(quad);
                    }
                }
            }
        }
        self
    }

    /// A geodesic sphere of `20 * 4^level` triangles, facing out, or in if `inside`.
    pub fn sphere(mut self, centre: DVec3, radius: f64, level: u32, inside: bool) -> Self {
        let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
        let mut faces = Vec::new();
        let v: Vec<DVec3> = [
            (-1.0, g, 0.0),
            (1.0, g, 0.0),
            (-1.0, -g, 0.0),
            (1.0, -g, 0.0),
            (0.0, -1.0, g),
            (0.0, 1.0, g),
            (0.0, -1.0, -g),
            (0.0, 1.0, -g),
            (g, 0.0, -1.0),
            (g, 0.0, 1.0),
            (-g, 0.0, -1.0),
            (-g, 0.0, 1.0),
        ]
        .map(|(x, y, z)| DVec3::new(x, y, z).normalize())
        .to_vec();
        for [a, b, c] in [
            [0, 11, 5],
            [0, 5, 1],
            [0, 1, 7],
            [0, 7, 10],
            [0, 10, 11],
            [1, 5, 9],
            [5, 11, 4],
            [11, 10, 2],
            [10, 7, 6],
            [7, 1, 8],
            [3, 9, 4],
            [3, 4, 2],
            [3, 2, 6],
            [3, 6, 8],
            [3, 8, 9],
            [4, 9, 5],
            [2, 4, 11],
            [6, 2, 10],
            [8, 6, 7],
            [9, 8, 1],
        ] {
            faces.push([v[a], v[b], v[c]]);
        }
        for _ in 0..level {
            faces = faces
                .into_iter()
                .flat_map(|[a, b, c]| {
                    let (ab, bc, ca) = (
                        (a + b).normalize(),
                        (b + c).normalize(),
                        (c + a).normalize(),
                    );
                    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                })
                .collect();
        }
        for [a, b, c] in faces {
            let [a, b, c] = [a, b, c].map(|p| centre + p * radius);
            self = self.triangle(if inside { [a, c, b] } else { [a, b, c] });
        }
        self
    }

    /// The finished scene: one static instance, face normals, origin as a loader sets it.
    pub fn build(self) -> Scene {
        let all: Vec<DVec3> = self.corners.iter().flatten().copied().collect();
        let (low, high) = all
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
                (l.min(*p), h.max(*p))
            });
        let around_zero = low.cmple(DVec3::ZERO).all() && high.cmpge(DVec3::ZERO).all();
        let origin = if around_zero {
            DVec3::ZERO
        } else {
            (low + high) * 0.5
        };
        let mut scene = Scene {
            name: "test".into(),
            origin,
            positions: all.iter().map(|p| (*p - origin).as_vec3()).collect(),
            uvs: vec![Vec2::ZERO; all.len()],
            lightmap_uvs: vec![Vec2::NAN; all.len()],
            materials: self.kinds,
            ..Scene::default()
        };
        for (i, material) in self.materials.iter().enumerate() {
            let v = 3 * i as u32;
            let vertices = [v, v + 1, v + 2];
            scene.triangles.push(Triangle {
                vertices,
                material: *material,
                instance: 0,
            });
        }
        for t in 0..scene.triangles.len() as u32 {
            let normal = scene.double_area_normal(t).normalize();
            scene.normals.extend([normal; 3]);
        }
        scene.instances.push(Instance {
            node: "node".into(),
            mesh: "mesh".into(),
            role: Role::Static,
            triangles: 0..scene.triangles.len() as u32,
        });
        scene
    }
}
