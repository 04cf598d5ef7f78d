//! Lamps against closed forms.

use glam::{DVec3, Vec3};
use lightkiln_format::direct::Lamp;
use lightkiln_format::lighting::Light;

const ORIGIN: [f64; 3] = [4000.0, -10.0, 0.5];

fn lamp(light: Light) -> Lamp {
    Lamp::new(&light, 0, ORIGIN).unwrap()
}

fn point(height: f64, radius: f32) -> Light {
    let position = DVec3::from(ORIGIN) + DVec3::new(0.0, height, 0.0);
    Light::Point {
        position,
        intensity: Vec3::new(8.0, 4.0, 2.0),
        radius,
    }
}

#[test]
fn a_point_lamp_follows_the_inverse_square_outside_its_radius() {
    let up = Vec3::Y;
    let e = lamp(point(2.0, 0.0)).irradiance(Vec3::ZERO, up);
    assert_eq!(e, Vec3::new(2.0, 1.0, 0.5));
    let e = lamp(point(2.0, 4.0)).irradiance(Vec3::ZERO, up);
    assert_eq!(e, Vec3::new(8.0, 4.0, 2.0) / 16.0);
    assert_eq!(
        lamp(point(2.0, 0.0)).irradiance(Vec3::ZERO, -up),
        Vec3::ZERO
    );
    assert_eq!(lamp(point(0.0, 0.0)).irradiance(Vec3::ZERO, up), Vec3::ZERO);
    let slanted = Vec3::new(3.0_f32.sqrt(), 1.0, 0.0) / 2.0;
    let e = lamp(point(1.0, 0.0)).irradiance(Vec3::ZERO, slanted).x;
    assert!((e - 4.0).abs() < 1e-5, "{e}");
}

#[test]
fn the_flux_through_a_sphere_is_four_pi_intensity() {
    // Equal-area directions; the lamp stands in the middle.
    let n = 200_u32;
    let lamp = lamp(point(0.0, 0.0));
    let radius = 1.7;
    let direction = |i: u32| {
        let z = 1.0 - (2 * i + 1) as f32 / n as f32;
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    let sum: Vec3 = (0..n)
        .map(|i| lamp.irradiance(direction(i) * radius, -direction(i)))
        .sum();
    let flux = sum / n as f32 * 4.0 * std::f32::consts::PI * radius * radius;
    let expected = 4.0 * std::f32::consts::PI * Vec3::new(8.0, 4.0, 2.0);
    assert!(
        (flux - expected).abs().max_element() < 1e-3,
        "{flux} against {expected}"
    );
}

#[test]
fn a_spot_has_full_power_inside_and_none_outside() {
    let (inner_cone, outer_cone) = (0.3, 0.8);
    let spot = lamp(Light::Spot {
        position: ORIGIN.into(),
        direction: Vec3::NEG_Y * 3.0,
        intensity: Vec3::ONE,
        inner_cone,
        outer_cone,
        radius: 0.0,
    });
    let at = |angle: f32| {
        let away = Vec3::new(angle.sin(), -angle.cos(), 0.0);
        spot.irradiance(away, -away).x
    };
    assert!((at(0.29) - 1.0).abs() < 1e-5 && at(0.81) == 0.0);
    let expected =
        |a: f32| ((a.cos() - outer_cone.cos()) / (inner_cone.cos() - outer_cone.cos())).powi(2);
    for angle in [0.35, 0.5, 0.7] {
        assert!((at(angle) - expected(angle)).abs() < 1e-5);
    }
}

#[test]
fn directional_light_needs_no_unit_direction() {
    let sun = lamp(Light::Directional {
        direction: Vec3::new(0.0, -9.0, 0.0),
        irradiance: Vec3::ONE,
    });
    assert_eq!(sun.irradiance(Vec3::splat(1e6), Vec3::Y), Vec3::ONE);
    assert_eq!(sun.irradiance(Vec3::ZERO, Vec3::NEG_Y), Vec3::ZERO);
}

#[test]
fn lamps_outside_the_range_of_f32_are_refused() {
    let far = Light::Point {
        position: DVec3::splat(1e60),
        intensity: Vec3::ONE,
        radius: 0.0,
    };
    let strong = Light::Point {
        position: DVec3::ZERO,
        intensity: Vec3::splat(1e30),
        radius: 0.0,
    };
    for (light, field) in [(far, "position"), (strong, "intensity")] {
        let error = Lamp::new(&light, 7, ORIGIN).unwrap_err().to_string();
        assert!(
            error.contains("light 7") && error.contains(field),
            "{error}"
        );
    }
}
