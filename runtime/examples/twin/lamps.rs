//! Where the compared lamps stand.

use glam::{DVec3, Vec3};
use lightkiln_format::lighting::Light;

/// White point lamps of 1 W/sr, spread over the scene's lamp volumes in turn, or over the middle half
/// of its bounds: a rank-one lattice of three dimensions (Roberts 2018) in each box.
pub fn spread(
    volumes: &[[[f64; 3]; 2]],
    positions: &[[f32; 3]],
    origin: [f64; 3],
    count: u32,
) -> Vec<Light> {
    let (low, high) = positions
        .iter()
        .map(|&p| Vec3::from(p).as_dvec3() + DVec3::from(origin))
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
            (l.min(p), h.max(p))
        });
    let quarter = (high - low) * 0.25;
    let stand_in = [[(low + quarter).to_array(), (high - quarter).to_array()]];
    let volumes = if volumes.is_empty() {
        &stand_in
    } else {
        volumes
    };
    // Powers of the real root of x^4 = x + 1.
    let step = DVec3::new(0.819_172_513_396, 0.671_043_606_704, 0.549_700_477_901);
    (0..count)
        .map(|i| {
            let [low, high] = volumes[i as usize % volumes.len()].map(DVec3::from);
            let at = (DVec3::splat(0.5) + step * f64::from(i)).fract();
            Light::Point {
                position: low + (high - low) * at,
                intensity: Vec3::ONE,
                radius: 0.0,
            }
        })
        .collect()
}
