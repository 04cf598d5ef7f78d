//! Writes the lit scene: the geometry as baked, with lightmap coordinates, as one GLB file.
//!
//! One root node stands at the scene's origin; below it every instance is a node with a mesh of its
//! own, in local metres, whose primitives are split by material and lightmap page. What glTF has no
//! word for stands in `extras.lightkiln`: role and lightmap of a node, page of a primitive, portals,
//! lamp volumes and rectangle lights of the scene (in world metres).

mod light;
mod material;

use crate::domain::{LightmapUvs, NO_PAGE};
use crate::error::{Error, Result};
use crate::scene::{Bounds, Instance, Scene};
use glam::{DVec3, Vec2, Vec3};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// The scene as a GLB file, with `TEXCOORD_1` where `lightmap` has a page for the triangle.
///
/// Lightmap coordinates are fractions of the page, first texel row at `v = 0`. All instances are
/// written, whatever their role. Equal input gives equal bytes. Base colours and metallic factors
/// are clamped to `[0, 1]`, which is all that glTF can hold.
///
/// # Errors
/// [`Error::Input`] when the file would exceed the 4 GiB of the GLB format, a texture cannot be
/// encoded as PNG, or a texture transform is sheared.
pub fn write_glb(scene: &Scene, lightmap: Option<&LightmapUvs>) -> Result<Vec<u8>> {
    let mut document = Document::default();
    let materials = material::write(scene, &mut document)?;
    let mut nodes = vec![Value::Null];
    for instance in &scene.instances {
        let node = document.instance(scene, instance, lightmap);
        nodes.push(node);
    }
    nodes.extend(light::nodes(scene));
    let mut root = json!({ "name": scene.name });
    if scene.origin != DVec3::ZERO {
        root["translation"] = json!(scene.origin.to_array());
    }
    if nodes.len() > 1 {
        root["children"] = json!((1..nodes.len()).collect::<Vec<_>>());
    }
    nodes[0] = root;

    let mut top = Map::new();
    let generator = concat!("lightkiln ", env!("CARGO_PKG_VERSION"));
    top.insert(
        "asset".into(),
        json!({ "version": "2.0", "generator": generator }),
    );
    let lights = light::punctual(scene);
    let mut used = document.extensions.clone();
    if !lights.is_empty() {
        used.insert(light::EXTENSION);
        top.insert(
            "extensions".into(),
            json!({ light::EXTENSION: { "lights": lights } }),
        );
    }
    put(
        &mut top,
        "extensionsUsed",
        used.into_iter().map(Value::from).collect(),
    );
    top.insert("scene".into(), json!(0));
    let mut written = json!({ "nodes": [0] });
    if let Some(extras) = scene_extras(scene) {
        written["extras"] = json!({ "lightkiln": extras });
    }
    top.insert("scenes".into(), json!([written]));
    top.insert("nodes".into(), Value::Array(nodes));
    put(&mut top, "materials", materials);
    document.finish(scene, top)
}

fn put(top: &mut Map<String, Value>, key: &str, values: Vec<Value>) {
    if !values.is_empty() {
        top.insert(key.into(), Value::Array(values));
    }
}

/// The shortest decimal that reads back as the same f32.
fn number(x: f32) -> Value {
    x.to_string()
        .parse::<f64>()
        .map_or(Value::Null, Value::from)
}

fn numbers<const N: usize>(values: [f32; N]) -> Value {
    values.map(number).to_vec().into()
}

fn refuse(scene: &Scene, element: &str, problem: &str, remedy: &str) -> Error {
    Error::input(Path::new(&scene.name), element, problem, remedy)
}

/// The arrays of the glTF document under construction, and the binary chunk they refer to.
#[derive(Default)]
struct Document {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    images: Vec<Value>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
    extensions: BTreeSet<&'static str>,
}

/// What distinguishes two vertices of a primitive: the bits of all their attributes.
type VertexKey = [u32; 10];

/// Vertices and indices of one primitive.
#[derive(Default)]
struct Primitive {
    known: HashMap<VertexKey, u32>,
    vertices: Vec<Vertex>,
    indices: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
    lightmap: Vec2,
}

impl Primitive {
    fn push(&mut self, vertex: Vertex) {
        let Vertex {
            position: p,
            normal: n,
            uv,
            lightmap: l,
        } = vertex;
        let key = [p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y, l.x, l.y].map(f32::to_bits);
        let index = *self.known.entry(key).or_insert_with(|| {
            self.vertices.push(vertex);
            self.vertices.len() as u32 - 1
        });
        self.indices.push(index);
    }
}

impl Document {
    /// Appends bytes to the binary chunk, four-byte aligned; returns the number of their view.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.binary.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor<T: bytemuck::NoUninit>(&mut self, values: &[T], kind: &str) -> usize {
        let (target, component) = match kind {
            "SCALAR" => (ELEMENT_ARRAY_BUFFER, UNSIGNED_INT),
            _ => (ARRAY_BUFFER, FLOAT),
        };
        let view = self.view(bytemuck::cast_slice(values), Some(target));
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "count": values.len(), "type": kind,
        }));
        self.accessors.len() - 1
    }

    /// The node of an instance; its mesh and buffers are appended.
    fn instance(
        &mut self,
        scene: &Scene,
        instance: &Instance,
        lightmap: Option<&LightmapUvs>,
    ) -> Value {
        let mut primitives: BTreeMap<(u32, u16), Primitive> = BTreeMap::new();
        for t in instance.triangles.clone() {
            let page = lightmap.map_or(NO_PAGE, |l| l.page_of[t as usize]);
            let triangle = scene.triangles[t as usize];
            let primitive = primitives.entry((triangle.material, page)).or_default();
            let textured = material::textured(&scene.materials[triangle.material as usize]);
            for (corner, v) in triangle.vertices.into_iter().enumerate() {
                let uv = scene.uvs[v as usize];
                primitive.push(Vertex {
                    position: scene.positions[v as usize],
                    normal: scene.normals[v as usize].normalize_or(Vec3::Y),
                    uv: if textured && uv.is_finite() {
                        uv
                    } else {
                        Vec2::ZERO
                    },
                    lightmap: match lightmap {
                        Some(uvs) if page != NO_PAGE => {
                            let [w, h] = uvs.pages[page as usize];
                            let size = Vec2::new(w as f32, h as f32);
                            (uvs.corners[t as usize][corner] / size).clamp(Vec2::ZERO, Vec2::ONE)
                        }
                        _ => Vec2::ZERO,
                    },
                });
            }
        }
        let mut extras = json!({ "role": instance.role });
        let pages: BTreeSet<u16> = primitives
            .keys()
            .map(|&(_, page)| page)
            .filter(|&p| p != NO_PAGE)
            .collect();
        if !pages.is_empty() {
            let entry = |page| json!({ "page": page, "scale": [1, 1], "offset": [0, 0] });
            extras["lightmap"] = pages.into_iter().map(entry).collect();
        }
        let mut node = json!({ "name": instance.node });
        if !primitives.is_empty() {
            let written: Vec<Value> = primitives
                .into_iter()
                .map(|((material, page), primitive)| {
                    let textured = material::textured(&scene.materials[material as usize]);
                    self.primitive(&primitive, material, page, textured)
                })
                .collect();
            node["mesh"] = json!(self.meshes.len());
            self.meshes
                .push(json!({ "name": instance.mesh, "primitives": written }));
        }
        node["extras"] = json!({ "lightkiln": extras });
        node
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        material: u32,
        page: u16,
        textured: bool,
    ) -> Value {
        let vertices = &primitive.vertices;
        let column = |get: fn(&Vertex) -> Vec3| vertices.iter().map(get).collect::<Vec<_>>();
        let coordinates = |get: fn(&Vertex) -> Vec2| vertices.iter().map(get).collect::<Vec<_>>();
        let positions = column(|v| v.position);
        let bounds = Bounds::of(positions.iter().copied());
        let mut attributes = Map::new();
        let position = self.accessor(&positions, "VEC3");
        self.accessors[position]["min"] = numbers(bounds.min.to_array());
        self.accessors[position]["max"] = numbers(bounds.max.to_array());
        attributes.insert("POSITION".into(), json!(position));
        let normal = self.accessor(&column(|v| v.normal), "VEC3");
        attributes.insert("NORMAL".into(), json!(normal));
        let lit = page != NO_PAGE;
        // Numbered attributes must be continuous: no second set without a first.
        if textured || lit {
            let uv = self.accessor(&coordinates(|v| v.uv), "VEC2");
            attributes.insert("TEXCOORD_0".into(), json!(uv));
        }
        if lit {
            let lightmap = self.accessor(&coordinates(|v| v.lightmap), "VEC2");
            attributes.insert("TEXCOORD_1".into(), json!(lightmap));
        }
        let indices = self.accessor(&primitive.indices, "SCALAR");
        let mut written =
            json!({ "attributes": attributes, "indices": indices, "material": material });
        if lit {
            written["extras"] = json!({ "lightkiln": { "page": page } });
        }
        written
    }

    /// Header, JSON chunk and binary chunk.
    fn finish(self, scene: &Scene, mut top: Map<String, Value>) -> Result<Vec<u8>> {
        put(&mut top, "meshes", self.meshes);
        put(&mut top, "textures", self.textures);
        put(&mut top, "images", self.images);
        put(&mut top, "samplers", self.samplers);
        put(&mut top, "accessors", self.accessors);
        put(&mut top, "bufferViews", self.views);
        let mut binary = self.binary;
        if !binary.is_empty() {
            top.insert("buffers".into(), json!([{ "byteLength": binary.len() }]));
            binary.resize(binary.len().next_multiple_of(4), 0);
        }
        let mut text = Value::Object(top).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let chunks = [(*b"JSON", text), (*b"BIN\0", binary)];
        let chunks = || chunks.iter().filter(|(_, bytes)| !bytes.is_empty());
        let total = 12 + chunks().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
        let length = |bytes: usize| {
            u32::try_from(bytes).map_err(|_| {
                let problem = format!("takes {total} bytes; a GLB file holds less than 4 GiB");
                refuse(
                    scene,
                    "lit scene",
                    &problem,
                    "split the scene or shrink its textures",
                )
            })
        };
        let mut file = Vec::with_capacity(total);
        file.extend_from_slice(b"glTF");
        file.extend_from_slice(&2u32.to_le_bytes());
        file.extend_from_slice(&length(total)?.to_le_bytes());
        for (kind, bytes) in chunks() {
            file.extend_from_slice(&length(bytes.len())?.to_le_bytes());
            file.extend_from_slice(kind);
            file.extend_from_slice(bytes);
        }
        Ok(file)
    }
}

/// Portals, lamp volumes and rectangle lights, world metres; nothing if there are none.
fn scene_extras(scene: &Scene) -> Option<Value> {
    let world = |p: Vec3| json!((p.as_dvec3() + scene.origin).to_array());
    let mut extras = Map::new();
    let portals = scene.portals.iter().map(|portal| {
        json!({
            "name": portal.name,
            "corners": portal.corners.map(world),
            "inward": numbers(portal.inward.to_array()),
        })
    });
    put(&mut extras, "portals", portals.collect());
    let volumes = scene.lamp_volumes.iter();
    let volumes = volumes.map(|b| json!({ "min": world(b.min), "max": world(b.max) }));
    put(&mut extras, "lamp_volumes", volumes.collect());
    put(&mut extras, "rectangle_lights", light::rectangles(scene));
    (!extras.is_empty()).then_some(Value::Object(extras))
}
