//! The reference: an unbiased path tracer for irradiance at given points, with next-event
//! estimation, multiple importance sampling (balance heuristic) and Russian roulette.
//!
//! Surfaces are Lambertian. Interior vertices scatter about the geometric normal; a receiver's
//! cosine is about its shading normal.

use super::emitters::{Emitters, Incident, Receiver};
use super::sampler::{self, Estimate};
use super::{Hit, Ray, Tracer};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Which part of the light is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Straight from the sources.
    Direct,
    /// After at least one reflection.
    Indirect,
    /// Both.
    Full,
}

/// What and how much to trace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Which part of the light.
    pub part: Part,
    /// Paths a scramble, at most [`sampler::MAX_SAMPLES`].
    pub paths: u32,
    /// Independent scrambles; the standard error comes from their spread.
    pub scrambles: u32,
    /// Most reflections; `None` for all.
    pub max_bounces: Option<u32>,
    /// Seed; each point's own seeds derive from it and the point's number.
    pub seed: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            part: Part::Full,
            paths: 256,
            scrambles: 8,
            max_bounces: None,
            seed: 0,
        }
    }
}

/// Reflections after which Russian roulette starts.
const ROULETTE_FROM: u32 = 3;

/// Paths in flight a batch.
const BATCH: u32 = 1024;

/// Irradiance (W/m², linear RGB) with its standard error at each receiver. Unbiased for any number
/// of paths; the same result for any number of threads.
pub fn irradiance(
    tracer: &Tracer,
    emitters: &Emitters,
    receivers: &[Receiver],
    options: &Options,
) -> Vec<Estimate> {
    let estimate = |index: usize, receiver: &Receiver| {
        let point_seed = sampler::mix(options.seed, index as u32);
        let means: Vec<DVec3> = (0..options.scrambles)
            .map(|s| {
                scramble(
                    tracer,
                    emitters,
                    receiver,
                    options,
                    sampler::mix(point_seed, s),
                )
            })
            .collect();
        Estimate::of(&means)
    };
    receivers
        .par_iter()
        .enumerate()
        .map(|(i, r)| estimate(i, r))
        .collect()
}

/// A path being extended.
struct Walk {
    index: u32,
    ray: Ray,
    /// `pi` times the product of albedos so far, over survival probabilities.
    throughput: Vec3,
    /// Density of the ray's direction, 1/sr.
    pdf: f32,
}

fn scramble(
    tracer: &Tracer,
    emitters: &Emitters,
    receiver: &Receiver,
    options: &Options,
    seed: u32,
) -> DVec3 {
    let mut sum = DVec3::ZERO;
    let mut next_event = NextEvent::default();
    let mut walks: Vec<Walk> = Vec::new();
    let mut rays = Vec::new();
    let mut hits = Vec::new();
    let (direct, indirect) = match options.part {
        Part::Direct => (true, false),
        Part::Indirect => (false, true),
        Part::Full => (true, true),
    };
    let most = if indirect {
        options.max_bounces.unwrap_or(u32::MAX)
    } else {
        0
    };
    for start in (0..options.paths).step_by(BATCH as usize) {
        walks.clear();
        for index in start..options.paths.min(start + BATCH) {
            if direct {
                next_event.add(tracer, emitters, receiver, Vec3::ONE, index, 0, seed);
            }
            let [u, v, ..] = sampler::sobol(index, 0, seed);
            let direction = sampler::cosine(receiver.normal, u, v);
            if receiver.geometric_normal.dot(direction) > 0.0 {
                walks.push(Walk {
                    index,
                    ray: Ray::new(receiver.position, direction, receiver.triangle),
                    throughput: Vec3::splat(PI),
                    pdf: receiver.normal.dot(direction) * FRAC_1_PI,
                });
            }
        }
        sum += next_event.resolve(tracer);
        let mut bounce = 0;
        while !walks.is_empty() {
            rays.clear();
            rays.extend(walks.iter().map(|w| w.ray));
            hits.clear();
            hits.resize(rays.len(), Hit::MISS);
            tracer.closest(&rays, &mut hits);
            let counted = if bounce == 0 { direct } else { true };
            let mut hit = hits.iter();
            walks.retain_mut(|walk| {
                let Some(hit) = hit.next() else { return false };
                if !hit.is_hit() {
                    if counted {
                        let sky = emitters.escaped(walk.ray.direction, walk.pdf);
                        sum += (walk.throughput * sky).as_dvec3();
                    }
                    return false;
                }
                if counted {
                    let emitted = emitters.emitted(tracer, &walk.ray, hit, walk.pdf);
                    sum += (walk.throughput * emitted).as_dvec3();
                }
                if bounce >= most {
                    return false;
                }
                let point = tracer.surface(&walk.ray, hit);
                walk.throughput *= point.albedo;
                if walk.throughput.max_element() <= 0.0 {
                    return false;
                }
                let at = Receiver {
                    position: point.position,
                    normal: point.normal,
                    geometric_normal: point.normal,
                    triangle: point.triangle,
                };
                let weight = walk.throughput * FRAC_1_PI;
                next_event.add(tracer, emitters, &at, weight, walk.index, bounce + 1, seed);
                let [u, v, survive, _] = sampler::sobol(walk.index, 2 * (bounce + 1), seed);
                if bounce + 1 >= ROULETTE_FROM {
                    let probability = (walk.throughput.max_element() * FRAC_1_PI).min(1.0);
                    if survive >= probability {
                        return false;
                    }
                    walk.throughput /= probability;
                }
                let direction = sampler::cosine(point.normal, u, v);
                walk.ray = Ray::new(point.position, direction, point.triangle);
                walk.pdf = point.normal.dot(direction) * FRAC_1_PI;
                walk.pdf > 0.0
            });
            sum += next_event.resolve(tracer);
            bounce += 1;
        }
    }
    sum / f64::from(options.paths)
}

/// Shadow rays collected over a batch and answered together.
#[derive(Default)]
struct NextEvent {
    incident: Vec<Incident>,
    rays: Vec<Ray>,
    blocked: Vec<bool>,
}

impl NextEvent {
    #[allow(
        clippy::too_many_arguments,
        reason = "the seven things a light sample depends on"
    )]
    fn add(
        &mut self,
        tracer: &Tracer,
        emitters: &Emitters,
        at: &Receiver,
        weight: Vec3,
        index: u32,
        vertex: u32,
        seed: u32,
    ) {
        let first = self.incident.len();
        let random = sampler::sobol(index, 2 * vertex + 1, seed);
        emitters.incident(tracer, at, random, &mut self.incident);
        for incident in &mut self.incident[first..] {
            incident.irradiance *= weight;
        }
    }

    fn resolve(&mut self, tracer: &Tracer) -> DVec3 {
        self.rays.clear();
        self.rays.extend(self.incident.iter().map(|i| i.ray));
        self.blocked.clear();
        self.blocked.resize(self.rays.len(), false);
        tracer.occluded(&self.rays, &mut self.blocked);
        let lit = self
            .incident
            .iter()
            .zip(&self.blocked)
            .filter(|(_, blocked)| !**blocked);
        let sum = lit.map(|(i, _)| i.irradiance.as_dvec3()).sum();
        self.incident.clear();
        sum
    }
}
