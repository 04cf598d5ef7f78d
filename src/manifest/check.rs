//! Values of the manifest that parse but cannot be meant.

use super::{
    BakeSpec, MAX_CELLS, MAX_SAMPLES, Manifest, MaterialSpec, PortalSpec, SceneSpec, ViewSpec,
    line_at,
};
use crate::error::{Error, Result};
use glam::{DVec3, Vec3};
use std::collections::HashSet;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// Line of a field such as `scene[0].role[1].box`, or of the nearest table around it.
fn line_of(text: &str, field: &str) -> Option<usize> {
    let root = DeTable::parse(text).ok()?;
    let mut line = None;
    let mut value = &DeValue::Table(root.get_ref().clone());
    for step in field.split(['.', '[']) {
        let next = match step.strip_suffix(']').map(str::parse::<usize>) {
            Some(index) => value.get(index.ok()?),
            None => value.get(step),
        };
        let Some(next) = next else { break };
        line = Some(line_at(text, next.span().start));
        value = next.get_ref();
    }
    line
}

/// Checks the values of one manifest.
pub(super) struct Check<'a> {
    /// The manifest, for messages.
    pub file: &'a Path,
    /// Its text, to find lines.
    pub text: &'a str,
}

impl Check<'_> {
    fn that(&self, good: bool, field: &str, problem: &str, remedy: &str) -> Result<()> {
        if good {
            return Ok(());
        }
        let field = match line_of(self.text, field) {
            Some(line) => format!("{field} (line {line})"),
            None => field.into(),
        };
        Err(Error::manifest(self.file, field, problem, remedy))
    }

    /// The first value that is out of range, as an error.
    pub fn manifest(&self, manifest: &Manifest) -> Result<()> {
        let some = !manifest.scenes.is_empty();
        self.that(
            some,
            "scene",
            "there is no scene",
            "add a [[scene]] with name and path",
        )?;
        let mut names = HashSet::new();
        for (i, scene) in manifest.scenes.iter().enumerate() {
            let at = format!("scene[{i}]");
            let new = names.insert(scene.name.to_lowercase());
            let remedy = "give each scene its own name; upper and lower case count as the same";
            self.that(
                new,
                &format!("{at}.name"),
                "is already another scene's name",
                remedy,
            )?;
            self.scene(scene, &at)?;
        }
        Ok(())
    }

    fn scene(&self, scene: &SceneSpec, at: &str) -> Result<()> {
        self.that(
            is_plain_file_name(&scene.name),
            &format!("{at}.name"),
            "is not a plain file name",
            "use letters, digits, `-`, `_` and `.`: it becomes the name of a folder",
        )?;
        let has_path = !scene.path.as_os_str().is_empty();
        let remedy = "give the scene file, relative to the manifest";
        self.that(has_path, &format!("{at}.path"), "is empty", remedy)?;
        self.positive(scene.metres_per_unit, &format!("{at}.metres_per_unit"))?;
        for (i, role) in scene.roles.iter().enumerate() {
            let at = format!("{at}.role[{i}]");
            let one = role.selector.is_some() != role.bounds.is_some();
            self.that(
                one,
                &at,
                "needs exactly one of `match` and `box`",
                "keep one of them",
            )?;
            if let Some(bounds) = role.bounds {
                self.bounds(bounds, &format!("{at}.box"))?;
            }
        }
        for (i, material) in scene.materials.iter().enumerate() {
            self.material(material, &format!("{at}.material[{i}]"))?;
        }
        let mut portals = HashSet::new();
        for (i, portal) in scene.portals.iter().enumerate() {
            let at = format!("{at}.portal[{i}]");
            let new = portals.insert(portal.name.as_str());
            let remedy = "give each portal of a scene its own name";
            self.that(
                new,
                &format!("{at}.name"),
                "is already another portal's name",
                remedy,
            )?;
            self.portal(portal, &at)?;
        }
        for (i, volume) in scene.lamp_volumes.iter().enumerate() {
            self.bounds(volume.bounds, &format!("{at}.lamp_volume[{i}].box"))?;
        }
        if let Some(domain) = &scene.domain {
            self.positive(
                domain.texels_per_metre,
                &format!("{at}.domain.texels_per_metre"),
            )?;
            let good = domain.page_size.is_none_or(|s| (16..=16384).contains(&s));
            let field = format!("{at}.domain.page_size");
            self.that(good, &field, "is out of range", "choose 16 to 16384 texels")?;
        }
        if let Some(view) = &scene.view {
            self.view(view, &format!("{at}.view"))?;
        }
        for (i, bake) in scene.bakes.iter().enumerate() {
            self.bake(bake, &format!("{at}.bake[{i}]"))?;
        }
        Ok(())
    }

    fn material(&self, material: &MaterialSpec, at: &str) -> Result<()> {
        let within = |v: Vec3| v.is_finite() && v.min_element() >= 0.0 && v.max_element() <= 1.0;
        self.that(
            material.base_color.is_none_or(within),
            &format!("{at}.base_color"),
            "is out of range",
            "give three linear values from 0 to 1",
        )?;
        self.that(
            material.metallic.is_none_or(|m| (0.0..=1.0).contains(&m)),
            &format!("{at}.metallic"),
            "is out of range",
            "give a value from 0 to 1",
        )?;
        self.that(
            material
                .emissive
                .is_none_or(|e| e.is_finite() && e.min_element() >= 0.0),
            &format!("{at}.emissive"),
            "is negative or not finite",
            "give three radiances in W/(m² sr), each 0 or more",
        )
    }

    fn portal(&self, portal: &PortalSpec, at: &str) -> Result<()> {
        let [a, b, c, d] = portal.corners;
        let normal = (c - a).cross(d - b).normalize_or_zero();
        let finite = portal.corners.iter().all(|p| p.is_finite()) && normal != DVec3::ZERO;
        let field = format!("{at}.corners");
        self.that(
            finite,
            &field,
            "span no area or are not finite",
            "give four corners in order around the opening",
        )?;
        // A thousandth of the diagonal: far above what rounded coordinates of a flat opening give.
        let flat = (b - a).dot(normal).abs() <= 1e-3 * (c - a).length();
        self.that(
            flat,
            &field,
            "do not lie in one plane",
            "split the opening into several flat portals",
        )?;
        let inward = portal.inward.normalize_or_zero().dot(normal).abs();
        self.that(
            inward > 1e-3,
            &format!("{at}.inward"),
            "is zero or parallel to the portal",
            "give a direction from the portal into the room",
        )
    }

    fn view(&self, view: &ViewSpec, at: &str) -> Result<()> {
        let apart = (view.target - view.eye).try_normalize().is_some();
        let problem = "is not finite or equals `eye`";
        self.that(
            apart,
            &format!("{at}.target"),
            problem,
            "give a point in view",
        )?;
        self.that(
            view.fov_deg.is_none_or(|f| f > 0.0 && f < 180.0),
            &format!("{at}.fov_deg"),
            "is out of range",
            "give a vertical angle between 0 and 180 degrees",
        )
    }

    fn bake(&self, bake: &BakeSpec, at: &str) -> Result<()> {
        let counts = [
            ("samples", bake.samples, 1, MAX_SAMPLES),
            ("cells", bake.cells, 1, MAX_CELLS),
            ("entries_per_cell", bake.entries_per_cell, 1, 1 << 16),
            ("bounces", bake.bounces, 1, 64),
        ];
        for (key, value, least, most) in counts {
            self.that(
                value.is_none_or(|v| (least..=most).contains(&v)),
                &format!("{at}.{key}"),
                "is out of range",
                &format!("choose {least} to {most}, or leave it to the preset"),
            )?;
        }
        self.positive(bake.entry_density, &format!("{at}.entry_density"))
    }

    fn positive(&self, value: Option<f64>, field: &str) -> Result<()> {
        let good = value.is_none_or(|v| v.is_finite() && v > 0.0);
        self.that(
            good,
            field,
            "must be finite and above 0",
            "correct the number or leave it out",
        )
    }

    fn bounds(&self, [min, max]: [DVec3; 2], field: &str) -> Result<()> {
        let good = min.is_finite() && max.is_finite() && min.cmple(max).all();
        let remedy = "write [[least x, y, z], [greatest x, y, z]] in the scene file's units";
        self.that(
            good,
            field,
            "is not finite, or a least value exceeds the greatest",
            remedy,
        )
    }
}

fn is_plain_file_name(name: &str) -> bool {
    let bad = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    !name.is_empty()
        && !name.contains(bad)
        && !name.starts_with('.')
        && !name.ends_with(['.', ' '])
        && name.len() <= 200
}
