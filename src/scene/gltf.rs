//! glTF 2.0 (`.gltf`, `.glb`): the node hierarchy of the default scene, its meshes, materials and
//! `KHR_lights_punctual` lights.
//!
//! The crate parses and validates the JSON; buffers and images are loaded here, so that nothing is
//! allocated by what the file claims.

mod accessor;
mod material;

use super::Role;
use super::loaded::{Loaded, Part};
use super::resource::{read_file, read_uri};
use crate::error::{Error, Result};
use ::gltf::json::validation::{Error as Flaw, Validate};
use ::gltf::json::{Path as JsonPath, Root};
use ::gltf::khr_lights_punctual::Kind;
use ::gltf::mesh::Mode;
use ::gltf::{Document, Node, Primitive, Semantic};
use accessor::Buffers;
use glam::{DMat3, DMat4, DQuat, DVec3, Vec2, Vec3};
use lightkiln_format::lighting::Light;
use material::Materials;
use serde::Deserialize;
use std::path::Path;

/// Extensions that a file may require.
const SUPPORTED: [&str; 7] = [
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Deepest node hierarchy read: each node carries the names of its ancestors.
const MAX_DEPTH: usize = 256;

/// Reads a `.gltf` or `.glb` file.
///
/// # Errors
/// [`Error::Input`] for malformed JSON, unsupported required extensions, accessors that do not fit
/// into the file, and node graphs that are no forest; [`Error::Io`] if the file cannot be read.
pub(super) fn load(file: &Path) -> Result<Loaded> {
    let (document, blob) = parse(file, &read_file(file)?)?;
    let buffers = read_buffers(file, &document, blob)?;
    let mut loaded = Loaded::default();
    let mut materials = Materials::new(&document, &buffers);
    for material in document.materials() {
        materials.add(&material, &mut loaded);
    }
    let mut walk = Walk {
        file,
        buffers: &buffers,
        materials,
        loaded,
        default_material: None,
    };
    walk.run(&document)?;
    Ok(walk.loaded)
}

fn parse(file: &Path, bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>)> {
    let fail = |element: &str, problem: String| {
        let remedy = "export the file again and check it with the glTF validator";
        Error::input(file, element, problem, remedy)
    };
    let (json, blob) = if bytes.starts_with(b"glTF") {
        // The crate subtracts the header's size from the length without looking.
        let claimed = bytes
            .get(8..12)
            .map_or(0, |l| u32::from_le_bytes([l[0], l[1], l[2], l[3]]));
        if (claimed as usize) < 20 || claimed as usize > bytes.len() {
            let problem = format!("claims {claimed} bytes, the file has {}", bytes.len());
            return Err(fail("glb header", problem));
        }
        let glb = ::gltf::binary::Glb::from_slice(bytes)
            .map_err(|e| fail("glb chunks", e.to_string()))?;
        (
            glb.json.into_owned(),
            glb.bin.map(std::borrow::Cow::into_owned),
        )
    } else {
        (bytes.to_vec(), None)
    };
    let mut root = Root::from_slice(&json).map_err(|e| fail("JSON", e.to_string()))?;

    let required = std::mem::take(&mut root.extensions_required);
    if let Some(name) = required.iter().find(|r| !SUPPORTED.contains(&r.as_str())) {
        return Err(Error::input(
            file,
            "extensionsRequired",
            format!("the file cannot be read without `{name}`, which is not supported"),
            "export without it, or convert the file (gltfpack, gltf-transform) to plain buffers",
        ));
    }
    if !root.asset.version.starts_with("2.") {
        let problem = format!("is {}, not 2.0", root.asset.version);
        return Err(fail("asset.version", problem));
    }
    // The crate's validation looks positions up without asking whether they exist.
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut accessors = primitives.flat_map(|primitive| primitive.attributes.values());
    if let Some(lost) = accessors.find(|index| root.get(**index).is_none()) {
        let problem = format!("accessor {} does not exist", lost.value());
        return Err(fail("mesh attributes", problem));
    }
    let mut flaw = None;
    root.validate(&root, JsonPath::new, &mut |path, error| {
        let path = path().to_string();
        // Bounds of positions are for viewers; they are computed here anyway.
        let bounds = path.ends_with(".min") || path.ends_with(".max");
        if !(bounds && error == Flaw::Missing) {
            flaw.get_or_insert((path, error));
        }
    });
    match flaw {
        Some((path, error)) => Err(fail(&path, error.to_string())),
        None => Ok((Document::from_json_without_validation(root), blob)),
    }
}

fn read_buffers<'a>(
    file: &'a Path,
    document: &Document,
    mut blob: Option<Vec<u8>>,
) -> Result<Buffers<'a>> {
    let mut data = Vec::new();
    for buffer in document.buffers() {
        data.push(match buffer.source() {
            // A buffer without URI is the GLB's own; any other is a fallback that nobody may read.
            ::gltf::buffer::Source::Bin => blob.take().unwrap_or_default(),
            ::gltf::buffer::Source::Uri(uri) => read_uri(file, uri).map_err(|problem| {
                let element = format!("buffer {}", buffer.index());
                Error::input(
                    file,
                    element,
                    problem,
                    "put the buffer beside the scene file",
                )
            })?,
        });
    }
    Ok(Buffers { file, data })
}

/// The role in `extras`, if any; a value that is none is reported.
fn role_in(extras: &::gltf::json::Extras, element: &str, loaded: &mut Loaded) -> Option<Role> {
    let extras: serde_json::Value = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    // The lit scene keeps all its extras under the tool's own name.
    let value = extras
        .get("role")
        .or_else(|| extras.get("lightkiln")?.get("role"))?;
    let role = Role::deserialize(value).ok();
    if role.is_none() {
        loaded.find(
            element,
            format!("extras.role {value} is no role and has no effect"),
            1,
        );
    }
    role
}

/// A node to be visited.
struct Visit<'a> {
    node: Node<'a>,
    to_world: DMat4,
    path: Vec<String>,
    role: Option<Role>,
}

struct Walk<'a> {
    file: &'a Path,
    buffers: &'a Buffers<'a>,
    materials: Materials<'a>,
    loaded: Loaded,
    default_material: Option<u32>,
}

impl Walk<'_> {
    fn run(&mut self, document: &Document) -> Result<()> {
        let scene = document
            .default_scene()
            .or_else(|| document.scenes().next());
        let roots: Vec<Node<'_>> = match scene {
            Some(scene) => scene.nodes().collect(),
            None => {
                let mut child = vec![false; document.nodes().len()];
                for node in document.nodes().flat_map(|n| n.children()) {
                    child[node.index()] = true;
                }
                document.nodes().filter(|n| !child[n.index()]).collect()
            }
        };
        let root = |node| Visit {
            node,
            to_world: DMat4::IDENTITY,
            path: Vec::new(),
            role: None,
        };
        let mut stack: Vec<Visit<'_>> = roots.into_iter().rev().map(root).collect();
        let mut seen = vec![false; document.nodes().len()];
        while let Some(Visit {
            node,
            to_world,
            path: ancestors,
            role,
        }) = stack.pop()
        {
            let name = node
                .name()
                .map_or_else(|| format!("node {}", node.index()), Into::into);
            if std::mem::replace(&mut seen[node.index()], true) {
                return Err(Error::input(
                    self.file,
                    format!("node `{name}`"),
                    "is reached twice: it has two parents or is its own ancestor",
                    "make the node graph a forest, as glTF demands",
                ));
            }
            if ancestors.len() >= MAX_DEPTH {
                let element = format!("node `{name}`");
                let problem = format!("lies below more than {MAX_DEPTH} ancestors");
                return Err(Error::input(
                    self.file,
                    element,
                    problem,
                    "flatten the hierarchy",
                ));
            }
            let to_world = to_world * local_matrix(&node);
            let mut path = vec![name];
            path.extend(ancestors);
            let element = format!("node `{}`", path[0]);
            let role = role_in(node.extras(), &element, &mut self.loaded).or(role);
            self.node(&node, to_world, &path, role)?;
            let children: Vec<Node<'_>> = node.children().collect();
            stack.extend(children.into_iter().rev().map(|node| Visit {
                node,
                to_world,
                path: path.clone(),
                role,
            }));
        }
        Ok(())
    }

    fn node(
        &mut self,
        node: &Node<'_>,
        to_world: DMat4,
        path: &[String],
        role: Option<Role>,
    ) -> Result<()> {
        let element = format!("node `{}`", path[0]);
        if let Some(light) = node.light() {
            self.light(&light, to_world, &element);
        }
        let Some(mesh) = node.mesh() else {
            return Ok(());
        };
        if node.skin().is_some() {
            self.loaded.find(
                &element,
                "is skinned: taken as modelled, without its skeleton",
                1,
            );
        }
        if node.extension_value("EXT_mesh_gpu_instancing").is_some() {
            let what = "EXT_mesh_gpu_instancing is not read: the mesh is placed once";
            self.loaded.find(&element, what, 1);
        }
        let name = mesh
            .name()
            .map_or_else(|| format!("mesh {}", mesh.index()), Into::into);
        let role = role.or(role_in(
            mesh.extras(),
            &format!("mesh `{name}`"),
            &mut self.loaded,
        ));
        for primitive in mesh.primitives() {
            if matches!(
                primitive.mode(),
                Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip
            ) {
                self.loaded
                    .find(&element, "points and lines are left out", 1);
                continue;
            }
            let mut part = self.part(&primitive, to_world)?;
            part.node = node.index();
            part.path = path.to_vec();
            part.mesh = name.clone();
            part.role = role;
            self.loaded.push(self.file, part)?;
        }
        Ok(())
    }

    fn part(&mut self, primitive: &Primitive<'_>, to_world: DMat4) -> Result<Part> {
        let material = self.material(primitive);
        let set = self.materials.sets[material as usize];
        let read3 = |semantic: Semantic| -> Result<Option<Vec<[f32; 3]>>> {
            primitive
                .get(&semantic)
                .map(|a| self.buffers.vectors::<3>(&a))
                .transpose()
        };
        let local = read3(Semantic::Positions)?.unwrap_or_default();
        let count = local.len();
        let linear = DMat3::from_mat4(to_world);
        let mirrored = linear.determinant() < 0.0;
        let positions = local
            .iter()
            .map(|&p| to_world.transform_point3(Vec3::from(p).as_dvec3()))
            .collect();

        // The cofactor matrix turns normals as the inverse transpose does, and exists for flattened
        // nodes too; it differs by the factor det, whose sign is taken back.
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let sign = if mirrored { -1.0 } else { 1.0 };
        let cofactor = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign;
        let mut normals: Vec<Vec3> = read3(Semantic::Normals)?
            .unwrap_or_default()
            .iter()
            .map(|&n| {
                (cofactor * Vec3::from(n).as_dvec3())
                    .normalize_or_zero()
                    .as_vec3()
            })
            .collect();
        normals.resize(count, Vec3::NAN);

        let read_uv = |set: u32, missing: Vec2| -> Result<Vec<Vec2>> {
            let accessor = primitive.get(&Semantic::TexCoords(set));
            let uvs = accessor
                .map(|a| self.buffers.vectors::<2>(&a))
                .transpose()?;
            let mut uvs: Vec<Vec2> = uvs.into_iter().flatten().map(Vec2::from).collect();
            uvs.resize(count, missing);
            Ok(uvs)
        };
        let (uvs, lightmap_uvs) = (read_uv(set, Vec2::ZERO)?, read_uv(1, Vec2::NAN)?);

        let indices = match primitive.indices() {
            Some(accessor) => self.buffers.indices(&accessor)?,
            None => (0..count as u32).collect(),
        };
        let mut triangles = triangles(&indices, primitive.mode());
        if mirrored {
            for [_, b, c] in &mut triangles {
                std::mem::swap(b, c);
            }
        }
        if primitive.get(&Semantic::Colors(0)).is_some() {
            let element = format!("mesh material {material}");
            let element = self
                .loaded
                .materials
                .get(material as usize)
                .map_or(element, |m| format!("material `{}`", m.name));
            self.loaded
                .find(element, "vertex colours are not used", count as u64);
        }
        Ok(Part {
            material,
            positions,
            normals,
            uvs,
            lightmap_uvs,
            triangles,
            ..Part::default()
        })
    }

    fn material(&mut self, primitive: &Primitive<'_>) -> u32 {
        let material = primitive.material();
        match (material.index(), self.default_material) {
            (Some(index), _) => index as u32,
            (None, Some(index)) => index,
            (None, None) => {
                self.materials.add(&material, &mut self.loaded);
                let index = self.loaded.materials.len() as u32 - 1;
                self.default_material = Some(index);
                index
            }
        }
    }

    /// Photometric values are taken as radiometric ones. Positions stay in units of the file.
    fn light(
        &mut self,
        light: &::gltf::khr_lights_punctual::Light<'_>,
        to_world: DMat4,
        element: &str,
    ) {
        let intensity = Vec3::from(light.color()) * light.intensity();
        let position = to_world.w_axis.truncate();
        let direction = to_world
            .transform_vector3(DVec3::NEG_Z)
            .normalize_or(DVec3::NEG_Z);
        let direction = direction.as_vec3();
        let light = match light.kind() {
            Kind::Directional => Light::Directional {
                direction,
                irradiance: intensity,
            },
            Kind::Point => Light::Point {
                position,
                intensity,
                radius: 0.0,
            },
            Kind::Spot {
                inner_cone_angle: inner_cone,
                outer_cone_angle: outer_cone,
            } => Light::Spot {
                position,
                direction,
                intensity,
                inner_cone,
                outer_cone,
                radius: 0.0,
            },
        };
        match (lightkiln_format::lighting::Lighting {
            lights: vec![light.clone()],
            environment: None,
        })
        .validate()
        {
            Ok(()) => self.loaded.lights.push(light),
            Err(e) => self
                .loaded
                .find(element, format!("its light is left out: {e}"), 1),
        }
    }
}

fn local_matrix(node: &Node<'_>) -> DMat4 {
    match node.transform() {
        ::gltf::scene::Transform::Matrix { matrix } => {
            DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from)))
        }
        ::gltf::scene::Transform::Decomposed {
            translation,
            rotation,
            scale,
        } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            DMat4::from_scale_rotation_translation(
                DVec3::from(scale.map(f64::from)),
                // A rotation rounded to f32 must not scale; a zero one turns nothing.
                if rotation.length() > 0.0 {
                    rotation.normalize()
                } else {
                    DQuat::IDENTITY
                },
                DVec3::from(translation.map(f64::from)),
            )
        }
    }
}

/// Triangles of lists, strips and fans; an incomplete last triangle is none.
fn triangles(indices: &[u32], mode: Mode) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, w)| {
                if i % 2 == 0 {
                    [w[0], w[1], w[2]]
                } else {
                    [w[0], w[2], w[1]]
                }
            })
            .collect(),
        Mode::TriangleFan => indices
            .get(1..)
            .unwrap_or_default()
            .windows(2)
            .map(|w| [w[0], w[1], indices[0]])
            .collect(),
        _ => indices
            .chunks_exact(3)
            .map(|c| [c[0], c[1], c[2]])
            .collect(),
    }
}
