//! Lights: `KHR_lights_punctual` for what it can hold, extras for rectangles.

use super::{number, numbers};
use crate::scene::Scene;
use glam::{Quat, Vec3};
use lightkiln_format::lighting::Light;
use serde_json::{Value, json};
use std::f32::consts::FRAC_PI_2;

pub(super) const EXTENSION: &str = "KHR_lights_punctual";

/// Colour in `[0, 1]` and intensity of a linear RGB power.
fn colour(power: Vec3) -> (Value, Value) {
    let most = power.max_element();
    let colour = if most > 0.0 { power / most } else { Vec3::ONE };
    (numbers(colour.to_array()), number(most))
}

/// The extension's light array: every light but rectangles, in order.
pub(super) fn punctual(scene: &Scene) -> Vec<Value> {
    let written = scene.lights.iter().filter_map(|light| {
        let (kind, power, radius) = match *light {
            Light::Point {
                intensity, radius, ..
            } => ("point", intensity, radius),
            Light::Spot {
                intensity, radius, ..
            } => ("spot", intensity, radius),
            Light::Directional { irradiance, .. } => ("directional", irradiance, 0.0),
            Light::Rectangle { .. } => return None,
        };
        let (color, intensity) = colour(power);
        let mut written = json!({ "type": kind, "color": color, "intensity": intensity });
        if let Light::Spot {
            inner_cone,
            outer_cone,
            ..
        } = *light
        {
            // The extension wants 0 <= inner < outer <= pi/2.
            let outer = outer_cone.min(FRAC_PI_2);
            let inner = inner_cone.min(outer.next_down()).max(0.0);
            written["spot"] =
                json!({ "innerConeAngle": number(inner), "outerConeAngle": number(outer) });
        }
        if radius > 0.0 {
            written["extras"] = json!({ "lightkiln": { "radius": number(radius) } });
        }
        Some(written)
    });
    written.collect()
}

/// One node for each of [`punctual`], local to the root node.
pub(super) fn nodes(scene: &Scene) -> Vec<Value> {
    let placed = scene.lights.iter().filter_map(|light| match *light {
        Light::Point { position, .. } => Some((position, None)),
        Light::Spot {
            position,
            direction,
            ..
        } => Some((position, Some(direction))),
        Light::Directional { direction, .. } => Some((scene.origin, Some(direction))),
        Light::Rectangle { .. } => None,
    });
    let written = placed.enumerate().map(|(i, (position, direction))| {
        let mut node = json!({
            "name": format!("light {i}"),
            "extensions": { EXTENSION: { "light": i } },
        });
        if position != scene.origin {
            node["translation"] = json!((position - scene.origin).to_array());
        }
        if let Some(direction) = direction {
            let turn = Quat::from_rotation_arc(Vec3::NEG_Z, direction.normalize_or(Vec3::NEG_Z));
            node["rotation"] = numbers(turn.normalize().to_array());
        }
        node
    });
    written.collect()
}

/// Rectangle lights, world metres and W/(m² sr), for the scene's extras.
pub(super) fn rectangles(scene: &Scene) -> Vec<Value> {
    let written = scene.lights.iter().filter_map(|light| {
        let Light::Rectangle {
            position,
            half_u,
            half_v,
            radiance,
        } = *light
        else {
            return None;
        };
        Some(json!({
            "position": position.to_array(),
            "half_u": numbers(half_u.to_array()),
            "half_v": numbers(half_v.to_array()),
            "radiance": numbers(radiance.to_array()),
        }))
    });
    written.collect()
}
