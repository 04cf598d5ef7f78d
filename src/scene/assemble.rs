//! The last step of loading, shared by all formats: manifest overrides, repairs, and the change from
//! units and axes of the file to local metres with `+Y` up.

use super::loaded::{Loaded, Part};
use super::{Bounds, Finding, Instance, Portal, Role, Scene, Triangle, View};
use super::{gltf, normals, obj, overrides};
use crate::error::{Error, Result};
use crate::manifest::{DEFAULT_FOV_DEG, DEFAULT_METRES_PER_UNIT, SceneSpec, Up};
use glam::{DMat3, DVec3, Vec3};
use lightkiln_format::lighting::Light;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::Path;

/// Loads a scene of a manifest that lies at `manifest_file`.
///
/// Lights of the file come with it. Their positions are scaled to metres; the intensities of point
/// and spot lights are scaled by `metres_per_unit²`, so that irradiances stay as they were in the
/// file's own units; photometric values (candela, lux) are taken as W/sr and W/m² as they stand.
///
/// Roles come, the last winning, from the material (glass that transmits half of the light or more
/// is a portal), from `extras.role` of material, mesh, node and its ancestors, and from the manifest.
///
/// # Errors
/// [`Error::Io`] and [`Error::Input`] name the file and the element: unreadable or malformed files,
/// more than [`super::MAX_ELEMENTS`] triangles, or none that blocks light. Bad triangles and missing
/// textures are no errors but [`Scene::findings`].
pub fn load(manifest_file: &Path, spec: &SceneSpec) -> Result<Scene> {
    let file = manifest_file
        .parent()
        .unwrap_or(Path::new(""))
        .join(&spec.path);
    let loaded = read(&file)?;
    assemble(&file, loaded, spec)
}

/// Loads a scene file by itself: metres, `+Y` up, nothing overridden.
///
/// # Errors
/// As [`load`].
pub fn load_file(file: &Path) -> Result<Scene> {
    let name = file
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    assemble(file, read(file)?, &SceneSpec::new(name, file.into()))
}

fn read(file: &Path) -> Result<Loaded> {
    let extension = file
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    match extension.as_str() {
        "gltf" | "glb" => gltf::load(file),
        "obj" => obj::load(file),
        _ => Err(Error::input(
            file,
            "file name",
            format!("`.{extension}` is not a scene format that is read"),
            "convert the scene to .glb, .gltf or .obj",
        )),
    }
}

/// From units and axes of the file to metres, `+Y` up; right-handed stays right-handed.
struct ToMetres {
    turn: DMat3,
    scale: f64,
}

impl ToMetres {
    fn of(spec: &SceneSpec) -> Self {
        let rows = match spec.up.unwrap_or_default() {
            Up::PlusY => [DVec3::X, DVec3::Y, DVec3::Z],
            Up::MinusY => [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z],
            Up::PlusZ => [DVec3::X, DVec3::Z, DVec3::NEG_Y],
            Up::MinusZ => [DVec3::X, DVec3::NEG_Z, DVec3::Y],
            Up::PlusX => [DVec3::NEG_Y, DVec3::X, DVec3::Z],
            Up::MinusX => [DVec3::Y, DVec3::NEG_X, DVec3::Z],
        };
        let turn = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
        Self {
            turn,
            scale: spec.metres_per_unit.unwrap_or(DEFAULT_METRES_PER_UNIT),
        }
    }

    fn point(&self, p: DVec3) -> DVec3 {
        self.turn * p * self.scale
    }

    fn direction(&self, d: Vec3) -> Vec3 {
        (self.turn * d.as_dvec3()).as_vec3()
    }

    fn light(&self, light: Light) -> Light {
        let squared = (self.scale * self.scale) as f32;
        let scale = self.scale as f32;
        match light {
            Light::Point {
                position,
                intensity,
                radius,
            } => Light::Point {
                position: self.point(position),
                intensity: intensity * squared,
                radius: radius * scale,
            },
            Light::Spot {
                position,
                direction,
                intensity,
                inner_cone,
                outer_cone,
                radius,
            } => Light::Spot {
                position: self.point(position),
                direction: self.direction(direction),
                intensity: intensity * squared,
                inner_cone,
                outer_cone,
                radius: radius * scale,
            },
            Light::Directional {
                direction,
                irradiance,
            } => Light::Directional {
                direction: self.direction(direction),
                irradiance,
            },
            Light::Rectangle {
                position,
                half_u,
                half_v,
                radiance,
            } => Light::Rectangle {
                position: self.point(position),
                half_u: self.direction(half_u) * scale,
                half_v: self.direction(half_v) * scale,
                radiance,
            },
        }
    }
}

fn assemble(file: &Path, mut loaded: Loaded, spec: &SceneSpec) -> Result<Scene> {
    let metres = ToMetres::of(spec);
    overrides::materials(&mut loaded, &spec.materials);
    overrides::sanitise(&mut loaded);
    overrides::report_albedo(&mut loaded);
    let roles = overrides::roles(&mut loaded, &spec.roles);

    let mut findings = std::mem::take(&mut loaded.findings);
    for part in &mut loaded.parts {
        for (p, n) in part.positions.iter_mut().zip(&mut part.normals) {
            *p = metres.point(*p);
            *n = metres.direction(*n);
        }
        drop_invalid(part, &mut findings);
    }
    let origin = origin_of(&loaded.parts, &roles);
    let mut scene = Scene {
        name: spec.name.clone(),
        origin,
        lights: loaded
            .lights
            .drain(..)
            .map(|light| metres.light(light))
            .collect(),
        textures: loaded.textures,
        materials: loaded.materials,
        findings,
        ..Scene::default()
    };
    if scene.materials.is_empty() {
        scene.materials.push(super::material::Material::default());
    }
    append_parts(&mut scene, loaded.parts, &roles);
    add_spec(&mut scene, spec, &metres);

    scene.findings = merged(std::mem::take(&mut scene.findings));

    let blocking = scene.instances.iter().filter(|i| i.role.blocks_light());
    if blocking.map(|i| i.triangles.len()).sum::<usize>() == 0 {
        return Err(Error::input(
            file,
            "triangles",
            "no triangle blocks light, so there is nothing to bake",
            "check the file's meshes, and the roles in the manifest",
        ));
    }
    Ok(scene)
}

/// Largest coordinate, metres: beyond it differences overflow f32, so it is as good as infinite.
const LARGEST: f64 = f32::MAX as f64 / 4.0;

/// Drops triangles that no geometry can be made of, before anything depends on them.
fn drop_invalid(part: &mut Part, findings: &mut Vec<Finding>) {
    let positions = &part.positions;
    let (mut missing, mut infinite, mut repeated) = (0, 0, 0);
    part.triangles.retain(|t| {
        let corners = t.map(|v| positions.get(v as usize));
        let counter = match corners {
            [Some(a), Some(b), Some(c)] => {
                let fits = |p: &DVec3| p.is_finite() && p.abs().max_element() <= LARGEST;
                if ![a, b, c].into_iter().all(fits) {
                    &mut infinite
                } else if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                    &mut repeated
                } else {
                    return true;
                }
            }
            _ => &mut missing,
        };
        *counter += 1;
        false
    });
    let dropped = [
        (
            missing,
            "triangles with vertex numbers that do not exist are dropped",
        ),
        (
            infinite,
            "triangles with positions that are not finite are dropped",
        ),
        (repeated, "triangles that use a vertex twice are dropped"),
    ];
    find(part, &dropped, findings);
}

fn find(part: &Part, counts: &[(u64, &str)], findings: &mut Vec<Finding>) {
    for &(count, what) in counts.iter().filter(|&&(count, _)| count > 0) {
        findings.push(Finding {
            element: part.label(),
            what: what.into(),
            count,
        });
    }
}

/// Findings with equal texts as one, in order of the first.
fn merged(findings: Vec<Finding>) -> Vec<Finding> {
    let mut merged: Vec<Finding> = Vec::new();
    let mut known: HashMap<(String, String), usize> = HashMap::new();
    for finding in findings {
        match known.entry((finding.element.clone(), finding.what.clone())) {
            Entry::Occupied(at) => merged[*at.get()].count += finding.count,
            Entry::Vacant(at) => {
                at.insert(merged.len());
                merged.push(finding);
            }
        }
    }
    merged
}

/// See [`Scene::origin`].
fn origin_of(parts: &[Part], roles: &[Role]) -> DVec3 {
    let blocking = parts
        .iter()
        .zip(roles)
        .filter(|(_, role)| role.blocks_light());
    let points = blocking.flat_map(|(part, _)| {
        part.triangles
            .iter()
            .flatten()
            .map(|&v| part.positions[v as usize])
    });
    let (min, max) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| {
        (min.min(p), max.max(p))
    });
    if min.cmple(DVec3::ZERO).all() && max.cmpge(DVec3::ZERO).all() || !min.is_finite() {
        DVec3::ZERO
    } else {
        (min + max) * 0.5
    }
}

/// Appends parts as instances: one a node, mesh and role.
fn append_parts(scene: &mut Scene, parts: Vec<Part>, roles: &[Role]) {
    // Parts of one node and role lie together, in order of the first of them.
    let mut first: HashMap<(usize, Role), usize> = HashMap::new();
    let keys: Vec<usize> = (0..parts.len())
        .map(|i| *first.entry((parts[i].node, roles[i])).or_insert(i))
        .collect();
    let mut order: Vec<usize> = (0..parts.len()).collect();
    order.sort_by_key(|&i| keys[i]);
    let mut open: Option<(usize, Role)> = None;
    let mut parts: Vec<Option<Part>> = parts.into_iter().map(Some).collect();
    for i in order {
        let Some(mut part) = parts[i].take() else {
            continue;
        };
        let role = roles[i];
        repair(scene, &mut part);
        if part.triangles.is_empty() {
            continue;
        }
        if open != Some((part.node, role)) {
            open = Some((part.node, role));
            let start = scene.triangles.len() as u32;
            let (node, mesh) = (part.path[0].clone(), part.mesh.clone());
            scene.instances.push(Instance {
                node,
                mesh,
                role,
                triangles: start..start,
            });
        }
        append(scene, &part);
    }
}

/// Drops triangles without area in f32 and completes normals.
fn repair(scene: &mut Scene, part: &mut Part) {
    let local: Vec<Vec3> = part.positions.iter().map(|&p| scene.to_local(p)).collect();
    let before = part.triangles.len();
    part.triangles.retain(|t| {
        let [a, b, c] = t.map(|v| local[v as usize]);
        (b - a).cross(c - a).try_normalize().is_some()
    });
    let flat = (before - part.triangles.len()) as u64;
    let lacking = normals::complete(part);
    let repairs = [
        (flat, "triangles without area are dropped"),
        (lacking, "vertices without usable normal get computed ones"),
    ];
    find(part, &repairs, &mut scene.findings);
}

/// Appends a part's triangles, and those of its vertices that they use, to the last instance.
fn append(scene: &mut Scene, part: &Part) {
    let mut number = vec![u32::MAX; part.positions.len()];
    let instance = scene.instances.len() as u32 - 1;
    for triangle in &part.triangles {
        let vertices = triangle.map(|v| {
            let v = v as usize;
            if number[v] == u32::MAX {
                number[v] = scene.positions.len() as u32;
                scene.positions.push(scene.to_local(part.positions[v]));
                scene.normals.push(part.normals[v]);
                let uv = part.uvs[v];
                scene
                    .uvs
                    .push(if uv.is_finite() { uv } else { glam::Vec2::ZERO });
                scene.lightmap_uvs.push(part.lightmap_uvs[v]);
            }
            number[v]
        });
        scene.triangles.push(Triangle {
            vertices,
            material: part.material,
            instance,
        });
    }
    if let Some(last) = scene.instances.last_mut() {
        last.triangles.end = scene.triangles.len() as u32;
    }
}

/// Portals, lamp volumes and the view of the manifest.
fn add_spec(scene: &mut Scene, spec: &SceneSpec, metres: &ToMetres) {
    for portal in &spec.portals {
        let inward = metres.turn * portal.inward;
        scene.portals.push(Portal {
            name: portal.name.clone(),
            corners: portal.corners.map(|c| scene.to_local(metres.point(c))),
            inward: inward.normalize_or_zero().as_vec3(),
        });
    }
    for volume in &spec.lamp_volumes {
        let corners = volume.bounds.map(|c| scene.to_local(metres.point(c)));
        scene.lamp_volumes.push(Bounds::of(corners));
    }
    scene.view = spec.view.as_ref().map(|view| View {
        eye: scene.to_local(metres.point(view.eye)),
        target: scene.to_local(metres.point(view.target)),
        vertical_fov: view.fov_deg.unwrap_or(DEFAULT_FOV_DEG).to_radians() as f32,
    });
}
