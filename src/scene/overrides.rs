//! Roles and material overrides of the manifest, applied to what a loader found.

use super::loaded::{Loaded, Part};
use super::material::{Material, Texture};
use super::{Finding, Role};
use crate::manifest::{MaterialSpec, RoleSpec, Selector, Target};
use glam::{DVec3, Vec3, Vec4};
use std::collections::HashMap;

fn selects(selector: &Selector, part: &Part, material: &Material) -> bool {
    match selector.target {
        Target::Node => part.path.iter().any(|name| selector.matches(name)),
        Target::Mesh => selector.matches(&part.mesh),
        Target::Material => selector.matches(&material.name),
    }
}

fn idle(element: String) -> Finding {
    let what = "matches nothing in the scene and has no effect".into();
    Finding {
        element,
        what,
        count: 0,
    }
}

/// Splits each part by role. What the file says (node and its ancestors, mesh, material) comes
/// first, then the manifest's entries in order; the last one that takes a triangle decides.
///
/// Returns roles in the order of `loaded.parts`, which becomes longer where boxes cut parts.
pub(super) fn roles(loaded: &mut Loaded, specs: &[RoleSpec]) -> Vec<Role> {
    let mut used = vec![false; specs.len()];
    let mut parts = Vec::with_capacity(loaded.parts.len());
    let mut roles = Vec::with_capacity(loaded.parts.len());
    for mut part in std::mem::take(&mut loaded.parts) {
        let material = &loaded.materials[part.material as usize];
        let from_material = loaded.material_roles[part.material as usize];
        let base = part.role.or(from_material).unwrap_or_default();
        // Entries by name decide for the whole part, boxes for each triangle.
        let mut of_triangle = vec![base; part.triangles.len()];
        for (spec, used) in specs.iter().zip(&mut used) {
            let by_name = spec.selector.as_ref().map(|s| selects(s, &part, material));
            let takes = |triangle: &[u32; 3]| match (by_name, spec.bounds) {
                (Some(selected), _) => selected,
                (None, Some([min, max])) => triangle.iter().all(|&v| {
                    let inside = |p: &DVec3| p.cmpge(min).all() && p.cmple(max).all();
                    part.positions.get(v as usize).is_some_and(inside)
                }),
                (None, None) => false,
            };
            for (triangle, role) in part.triangles.iter().zip(&mut of_triangle) {
                if takes(triangle) {
                    *role = spec.role;
                    *used = true;
                }
            }
        }
        let triangles = std::mem::take(&mut part.triangles);
        let mut found: Vec<Role> = Vec::new();
        for &role in &of_triangle {
            if !found.contains(&role) {
                found.push(role);
            }
        }
        let last = found.len().saturating_sub(1);
        let mut rest = Some(part);
        for (i, &role) in found.iter().enumerate() {
            let mine = triangles
                .iter()
                .zip(&of_triangle)
                .filter(|&(_, r)| *r == role);
            let part = if i == last { rest.take() } else { rest.clone() };
            parts.extend(part.map(|p| Part {
                triangles: mine.map(|(t, _)| *t).collect(),
                ..p
            }));
            roles.push(role);
        }
    }
    loaded.parts = parts;
    for (spec, _) in specs.iter().zip(used).filter(|&(_, used)| !used) {
        let element = match (&spec.selector, spec.bounds) {
            (Some(selector), _) => format!("role `{selector}`"),
            (None, Some([min, max])) => format!("role box [{min}, {max}]"),
            (None, None) => "role".into(),
        };
        loaded.findings.push(idle(element));
    }
    roles
}

/// Applies material overrides in order, key by key. An override of a node or mesh leaves other
/// parts with the same material alone: the material is cloned.
pub(super) fn materials(loaded: &mut Loaded, specs: &[MaterialSpec]) {
    let mut used = vec![false; specs.len()];
    let mut made: HashMap<(u32, Vec<usize>), u32> = HashMap::new();
    let mut white: HashMap<u32, u32> = HashMap::new();
    let originals = loaded.materials.clone();
    for part in &mut loaded.parts {
        let original = &originals[part.material as usize];
        let matching: Vec<usize> = (0..specs.len())
            .filter(|&i| selects(&specs[i].selector, part, original))
            .collect();
        for &i in &matching {
            used[i] = true;
        }
        if matching.is_empty() {
            continue;
        }
        let key = (part.material, matching);
        part.material = match made.get(&key) {
            Some(&index) => index,
            None => {
                let mut material = original.clone();
                for &i in &key.1 {
                    apply(&specs[i], &mut material, &mut loaded.textures, &mut white);
                }
                let by_name = |&i: &usize| specs[i].selector.target == Target::Material;
                let index = if key.1.iter().all(by_name) {
                    loaded.materials[key.0 as usize] = material;
                    key.0
                } else {
                    loaded.materials.push(material);
                    let role = loaded.material_roles[key.0 as usize];
                    loaded.material_roles.push(role);
                    loaded.materials.len() as u32 - 1
                };
                made.insert(key, index);
                index
            }
        };
    }
    for (spec, _) in specs.iter().zip(used).filter(|&(_, used)| !used) {
        loaded
            .findings
            .push(idle(format!("material override `{}`", spec.selector)));
    }
}

/// `white` maps a texture to its copy with white colour and the same alpha.
fn apply(
    spec: &MaterialSpec,
    material: &mut Material,
    textures: &mut Vec<Texture>,
    white: &mut HashMap<u32, u32>,
) {
    if let Some(base_color) = spec.base_color {
        material.base_color = base_color;
        // The colour goes, but a mask keeps its holes.
        let mask = material
            .base_color_texture
            .filter(|_| material.alpha_cutoff.is_some());
        material.base_color_texture = mask.map(|mut mask| {
            mask.texture = *white.entry(mask.texture).or_insert_with(|| {
                let mut texture = textures[mask.texture as usize].clone();
                for texel in &mut texture.texels {
                    *texel = [255, 255, 255, texel[3]];
                }
                textures.push(texture);
                textures.len() as u32 - 1
            });
            mask
        });
    }
    if let Some(metallic) = spec.metallic {
        material.metallic = metallic;
        material.metallic_texture = None;
    }
    if let Some(emissive) = spec.emissive {
        material.emissive = emissive;
        material.emissive_texture = None;
    }
    if let Some(double_sided) = spec.double_sided {
        material.double_sided = double_sided;
    }
}

/// Albedo from which a surface is reported: light would hardly ever be absorbed.
const HIGH_ALBEDO: f32 = 0.98;

/// Makes factors usable: a value that is negative or not finite would spoil every sum it meets.
pub(super) fn sanitise(loaded: &mut Loaded) {
    let sane = |v: Vec3| v.is_finite() && v.min_element() >= 0.0;
    for material in &mut loaded.materials {
        let before = material.clone();
        for colour in [&mut material.base_color, &mut material.emissive] {
            *colour = if sane(*colour) { *colour } else { Vec3::ZERO };
        }
        material.metallic = material.metallic.clamp(0.0, 1.0);
        if before.base_color != material.base_color
            || before.emissive != material.emissive
            || before.metallic != material.metallic
        {
            let element = format!("material `{}`", material.name);
            let what = "has factors out of range or not finite: set to the nearest in range, or 0";
            loaded.findings.push(Finding {
                element,
                what: what.into(),
                count: 1,
            });
        }
    }
}

/// Reports materials in use whose albedo is above .98, or zero because they are metals.
pub(super) fn report_albedo(loaded: &mut Loaded) {
    let mut used = vec![false; loaded.materials.len()];
    for part in &loaded.parts {
        used[part.material as usize] = true;
    }
    for material in loaded
        .materials
        .iter()
        .zip(used)
        .filter_map(|(m, used)| used.then_some(m))
    {
        if let Some((what, count)) = albedo_flaw(material, &loaded.textures) {
            let element = format!("material `{}`", material.name);
            loaded.findings.push(Finding {
                element,
                what,
                count,
            });
        }
    }
}

/// What is unusual about a material's albedo, and for how many texels (1 without texture).
fn albedo_flaw(material: &Material, textures: &[Texture]) -> Option<(String, u64)> {
    if material.metallic >= 1.0 && material.metallic_texture.is_none() {
        return Some(("is all metal: its diffuse albedo is 0".into(), 1));
    }
    // Where metallic is a texture its least value counts: a bound, not a sample.
    let metal = material.metallic_texture.map_or(material.metallic, |t| {
        let least = textures[t.texture as usize]
            .texels
            .iter()
            .map(|t| t[2])
            .min();
        material.metallic * f32::from(least.unwrap_or(255)) / 255.0
    });
    let factor = material.base_color * (1.0 - metal);
    if factor.max_element() <= HIGH_ALBEDO {
        return None;
    }
    let Some(reference) = material.base_color_texture else {
        let what = format!(
            "has an albedo above {HIGH_ALBEDO}: {:.3}",
            factor.max_element()
        );
        return Some((what, 1));
    };
    let texture = &textures[reference.texture as usize];
    // Texels that a mask cuts away have no albedo.
    let there = |texel: &Vec4| {
        material
            .alpha_cutoff
            .is_none_or(|c| material.alpha * texel.w >= c)
    };
    let texels = texture
        .texels
        .iter()
        .map(|&t| texture.decode(t))
        .filter(there);
    let albedo = texels.map(|t| (factor * t.truncate()).max_element());
    let high = albedo.filter(|&a| a > HIGH_ALBEDO);
    let (count, highest) = high.fold((0, 0.0f32), |(n, top), a| (n + 1, top.max(a)));
    let what = format!("has texels with an albedo above {HIGH_ALBEDO}, up to {highest:.3}");
    (count > 0).then_some((what, count))
}
