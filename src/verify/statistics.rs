//! Error of baked indirect irradiance against the path-traced reference.

use super::poses::Pose;
use crate::domain::Domain;
use crate::error::Result;
use crate::gather::receiver;
use crate::progress::Progress;
use crate::trace::emitters::{Emitters, Receiver};
use crate::trace::path::{self, Options, Part};
use crate::trace::{Tracer, visibility};
use glam::{DVec3, Vec3};
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::Prm;
use serde::Serialize;

/// How much the comparison traces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Lamp poses.
    pub poses: u32,
    /// Reference points a pose, evenly by area.
    pub points: u32,
    /// Reference paths a point.
    pub paths: u32,
}

/// Error under one lamp pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseError {
    /// Lamp, metres, world.
    pub lamp: [f64; 3],
    /// Whether it stands .1 to .3 m from a surface.
    pub near_surface: bool,
    /// Mean reference irradiance for 1 W/sr, W/m².
    pub mean_irradiance: f64,
    /// Area-weighted RMS error over the reference's mean, the reference's own variance removed.
    pub relative_rms: f64,
    /// Half width of its 95 % confidence interval.
    pub interval: f64,
    /// Signed mean error over the reference's mean.
    pub relative_bias: f64,
    /// Standard error of the reference, RMS over points, over its mean.
    pub reference_noise: f64,
}

/// Errors over all poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Scene.
    pub scene: String,
    /// Digest of the asset compared: the plan key.
    pub plan_key: String,
    /// Points, paths a point.
    pub effort: [u32; 3],
    /// Relative RMS of the median pose.
    pub median: f64,
    /// Relative RMS of the worst pose.
    pub worst: f64,
    /// Median over the poses near a surface.
    pub median_near: f64,
    /// All poses.
    pub poses: Vec<PoseError>,
}

/// Visibility of every entry point from a point lamp at `position` (local), by rays.
pub fn entry_visibility(tracer: &Tracer, prm: &Prm, position: Vec3) -> Vec<f32> {
    let entries: Vec<Vec3> = prm.entry_position.iter().map(|&p| p.into()).collect();
    visibility::from_point(tracer, position, &entries)
}

/// A white point lamp of 1 W/sr at a local position.
pub fn unit_lamp(tracer: &Tracer, position: Vec3) -> Light {
    let position = position.as_dvec3() + tracer.scene().origin;
    Light::Point {
        position,
        intensity: Vec3::ONE,
        radius: 0.0,
    }
}

/// Indirect irradiance of every reference point from the asset, visibility by rays.
///
/// # Errors
/// Those of [`Prm::cell_irradiance`].
pub fn baked_irradiance(tracer: &Tracer, prm: &Prm, position: Vec3) -> Result<Vec<[f32; 3]>> {
    let visibility = entry_visibility(tracer, prm, position);
    let light = unit_lamp(tracer, position);
    let bad =
        |e: String| crate::error::Error::input("asset".as_ref(), "prm", e, "bake the asset again");
    let cells = prm
        .cell_irradiance(&[light], &visibility)
        .map_err(|e| bad(e.to_string()))?;
    prm.evaluate(&cells).map_err(|e| bad(e.to_string()))
}

/// Compares an asset with the reference under each pose.
///
/// The squared error is estimated as `(E - R1)(E - R2)` with two independent halves of the
/// reference, whose expectation holds none of the reference's variance.
///
/// # Errors
/// [`crate::error::Error::Interrupted`], or those of the asset's evaluation.
pub fn compare(
    tracer: &Tracer,
    domain: &Domain,
    prm: &Prm,
    poses: &[Pose],
    effort: &Effort,
    progress: &Progress,
) -> Result<Vec<PoseError>> {
    let filled: std::collections::HashSet<[u32; 3]> =
        prm.fill.iter().map(|f| [f[0], f[1], f[2]]).collect();
    progress.stage(
        &tracer.scene().name,
        "tracing the reference",
        poses.len() as u64,
    );
    poses
        .iter()
        .enumerate()
        .map(|(number, pose)| {
            progress.check()?;
            let chosen = choose(domain, effort.points, number as u32, &filled);
            let baked = baked_irradiance(tracer, prm, pose.position)?;
            let receivers: Vec<Receiver> = chosen
                .iter()
                .map(|&i| receiver(&domain.points[i]))
                .collect();
            let lamp = unit_lamp(tracer, pose.position);
            let halves = reference_halves(tracer, &lamp, &receivers, effort.paths, number as u32)?;
            progress.step(1);
            let found = chosen.iter().map(|&i| Vec3::from(baked[i]).as_dvec3());
            Ok(pose_error(pose, &lamp, found.collect(), &halves))
        })
        .collect()
}

/// Two independent halves of the reference indirect irradiance at `receivers`.
///
/// # Errors
/// Those of the lamp's values.
pub fn reference_halves(
    tracer: &Tracer,
    lamp: &Light,
    receivers: &[Receiver],
    paths: u32,
    seed: u32,
) -> Result<[Vec<DVec3>; 2]> {
    let emitters = Emitters::lamps(tracer.scene(), std::slice::from_ref(lamp))?;
    Ok([0, 1].map(|half| {
        let options = Options {
            part: Part::Indirect,
            paths: (paths / 16).max(1),
            scrambles: 8,
            max_bounces: None,
            seed: crate::trace::sampler::mix(0x51ed, 2 * seed + half),
        };
        path::irradiance(tracer, &emitters, receivers, &options)
            .iter()
            .map(|e| e.mean)
            .collect()
    }))
}

/// `count` points spread evenly by area over all points with data of their own.
fn choose(
    domain: &Domain,
    count: u32,
    salt: u32,
    filled: &std::collections::HashSet<[u32; 3]>,
) -> Vec<usize> {
    let own: Vec<usize> = (0..domain.points.len())
        .filter(|&i| {
            let p = &domain.points[i];
            !filled.contains(&[p.page.into(), p.texel[0].into(), p.texel[1].into()])
        })
        .collect();
    let mut sum = 0.0;
    let running: Vec<f64> = own
        .iter()
        .map(|&i| {
            sum += f64::from(domain.points[i].area);
            sum
        })
        .collect();
    let shift = f64::from(crate::trace::sampler::sobol(salt, 0, 0x77)[0]);
    (0..count)
        .map(|k| {
            let at = (f64::from(k) + shift) / f64::from(count) * sum;
            own[running.partition_point(|&r| r <= at).min(own.len() - 1)]
        })
        .collect()
}

fn pose_error(pose: &Pose, lamp: &Light, found: Vec<DVec3>, halves: &[Vec<DVec3>; 2]) -> PoseError {
    let n = found.len() as f64;
    let third = |v: DVec3| v.element_sum() / 3.0;
    let reference: Vec<DVec3> = halves[0]
        .iter()
        .zip(&halves[1])
        .map(|(a, b)| (*a + *b) * 0.5)
        .collect();
    let mean = reference.iter().map(|r| third(*r)).sum::<f64>() / n;
    let squares: Vec<f64> = (0..found.len())
        .map(|i| third((found[i] - halves[0][i]) * (found[i] - halves[1][i])))
        .collect();
    let square = squares.iter().sum::<f64>() / n;
    let spread = squares.iter().map(|s| (s - square).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let bias = (0..found.len())
        .map(|i| third(found[i] - reference[i]))
        .sum::<f64>()
        / n;
    let noise = (0..found.len())
        .map(|i| third(((halves[0][i] - halves[1][i]) * 0.5).powf(2.0)))
        .sum::<f64>()
        / n;
    let rms = square.max(0.0).sqrt();
    let Light::Point { position, .. } = lamp else {
        unreachable!("poses are point lamps")
    };
    PoseError {
        lamp: position.to_array(),
        near_surface: pose.near,
        mean_irradiance: mean,
        relative_rms: rms / mean,
        // d sqrt(s) = ds / (2 sqrt(s)); 1.96 standard errors of the mean square.
        interval: 1.96 * (spread / n).sqrt() / (2.0 * rms.max(f64::MIN_POSITIVE)) / mean,
        relative_bias: bias / mean,
        reference_noise: noise.sqrt() / mean,
    }
}

/// Median and worst over poses.
pub fn summarise(scene: &str, plan_key: &str, effort: &Effort, poses: Vec<PoseError>) -> Summary {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let n = values.len();
        if n == 0 {
            f64::NAN
        } else {
            0.5 * (values[(n - 1) / 2] + values[n / 2])
        }
    };
    let all: Vec<f64> = poses.iter().map(|p| p.relative_rms).collect();
    let near = poses
        .iter()
        .filter(|p| p.near_surface)
        .map(|p| p.relative_rms)
        .collect();
    Summary {
        scene: scene.into(),
        plan_key: plan_key.into(),
        effort: [effort.poses, effort.points, effort.paths],
        worst: all.iter().copied().fold(0.0, f64::max),
        median: median(all),
        median_near: median(near),
        poses,
    }
}
