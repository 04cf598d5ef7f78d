//! Wavefront gathering over a domain: from every reference point cosine-distributed paths walk the
//! scene, all paths of a point one bounce a batch, and sinks turn the same hits into coefficients
//! (the `gather` estimator, dossier 5.3; expected value that of S4 equation 4).
//!
//! The seed comes from the domain, so every sink of a domain sees the same rays bit for bit.

pub mod operator;

use crate::domain::ReferencePoint;
use crate::progress::Progress;
use crate::scene::surface::SurfacePoint;
use crate::trace::emitters::Receiver;
use crate::trace::{Hit, Ray, Tracer, sampler};
use glam::Vec3;
use rayon::prelude::*;

/// Reference points a block.
pub const BLOCK: usize = 64;

/// Paths below this throughput play Russian roulette: they survive with probability
/// `throughput / ROULETTE_BELOW` and carry `ROULETTE_BELOW` on, so the expectation stays.
const ROULETTE_BELOW: f32 = 1.0 / 128.0;

/// How much is traced.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GatherOptions {
    /// Paths a reference point, at most [`sampler::MAX_SAMPLES`].
    pub samples: u32,
    /// Surface hits walked one by one; what follows is left to the bounce operator.
    pub bounces: u32,
    /// Seed of the domain.
    pub seed: u32,
}

/// A hit of one path.
#[derive(Debug, Clone, Copy)]
pub struct Vertex {
    /// The surface.
    pub point: SurfacePoint,
    /// Product of all albedos up to and including this one, roulette accounted for; linear RGB.
    pub weight: Vec3,
    /// Whether the walk stops here although light goes on: the bounce operator takes over.
    pub last: bool,
}

/// Turns hits into coefficients, block by block.
pub trait Sink: Sync {
    /// Accumulator of one block.
    type State: Send;
    /// Result of one block.
    type Output: Send;

    /// An empty accumulator for a block.
    fn start(&self, points: &[ReferencePoint]) -> Self::State;
    /// Takes all vertices of one bounce (`bounce` 0: first hits) of one point of the block.
    fn record(&self, state: &mut Self::State, lane: usize, bounce: u32, vertices: &[Vertex]);
    /// Finishes a block; sums are over `samples` paths a point.
    fn finish(&self, state: Self::State, samples: u32) -> Self::Output;
}

impl<A: Sink, B: Sink> Sink for (A, B) {
    type State = (A::State, B::State);
    type Output = (A::Output, B::Output);

    fn start(&self, points: &[ReferencePoint]) -> Self::State {
        (self.0.start(points), self.1.start(points))
    }
    fn record(&self, state: &mut Self::State, lane: usize, bounce: u32, vertices: &[Vertex]) {
        self.0.record(&mut state.0, lane, bounce, vertices);
        self.1.record(&mut state.1, lane, bounce, vertices);
    }
    fn finish(&self, state: Self::State, samples: u32) -> Self::Output {
        (
            self.0.finish(state.0, samples),
            self.1.finish(state.1, samples),
        )
    }
}

/// Gathers over `points` in blocks of [`BLOCK`]; outputs in block order. `closest` traces a batch:
/// the tracer's own, or one that also listens. Cancelled work returns `None`.
pub fn gather<S: Sink>(
    tracer: &Tracer,
    closest: impl Fn(&[Ray], &mut [Hit]) + Sync,
    points: &[ReferencePoint],
    options: &GatherOptions,
    sink: &S,
    progress: &Progress,
) -> Option<Vec<S::Output>> {
    points
        .par_chunks(BLOCK)
        .enumerate()
        .map_init(Wavefront::default, |wavefront, (block, points)| {
            if progress.cancelled() {
                return None;
            }
            let mut state = sink.start(points);
            let mut rays = 0;
            for (lane, point) in points.iter().enumerate() {
                let seed = sampler::mix(options.seed, (block * BLOCK + lane) as u32);
                rays += wavefront.run(tracer, &closest, &receiver(point), options, seed, |b, v| {
                    sink.record(&mut state, lane, b, v);
                });
            }
            progress.rays(rays);
            progress.step(1);
            Some(sink.finish(state, options.samples))
        })
        .collect()
}

/// A reference point as the tracer sees it.
pub fn receiver(point: &ReferencePoint) -> Receiver {
    Receiver {
        position: point.position,
        normal: point.normal,
        geometric_normal: point.geometric_normal,
        triangle: point.triangle,
    }
}

/// A path in flight.
#[derive(Clone, Copy)]
struct Walk {
    index: u32,
    weight: Vec3,
    /// The two dimensions left over from the last draw of four.
    spare: [f32; 2],
}

/// Buffers of one point's paths, reused from point to point.
#[derive(Default)]
struct Wavefront {
    rays: Vec<Ray>,
    hits: Vec<Hit>,
    walks: Vec<Walk>,
    vertices: Vec<Vertex>,
}

impl Wavefront {
    fn run(
        &mut self,
        tracer: &Tracer,
        closest: &impl Fn(&[Ray], &mut [Hit]),
        receiver: &Receiver,
        options: &GatherOptions,
        seed: u32,
        mut record: impl FnMut(u32, &[Vertex]),
    ) -> u64 {
        let mut traced = 0;
        self.rays.clear();
        self.walks.clear();
        for index in 0..options.samples {
            let [u, v, spare @ ..] = sampler::sobol(index, 0, seed);
            let direction = sampler::cosine(receiver.normal, u, v);
            if receiver.geometric_normal.dot(direction) > 0.0 {
                self.rays
                    .push(Ray::new(receiver.position, direction, receiver.triangle));
                self.walks.push(Walk {
                    index,
                    weight: Vec3::ONE,
                    spare,
                });
            }
        }
        for bounce in 0..options.bounces {
            traced += self.rays.len() as u64;
            self.hits.clear();
            self.hits.resize(self.rays.len(), Hit::MISS);
            closest(&self.rays, &mut self.hits);
            self.vertices.clear();
            let last = bounce + 1 == options.bounces;
            let mut kept = 0;
            for i in 0..self.rays.len() {
                let hit = self.hits[i];
                if !hit.is_hit() {
                    continue;
                }
                let mut walk = self.walks[i];
                let point = tracer.surface(&self.rays[i], &hit);
                walk.weight *= point.albedo;
                self.vertices.push(Vertex {
                    point,
                    weight: walk.weight,
                    last,
                });
                let strength = walk.weight.max_element();
                if last || strength <= 0.0 {
                    continue;
                }
                if strength < ROULETTE_BELOW {
                    let survival = strength / ROULETTE_BELOW;
                    if unit(sampler::mix(seed ^ bounce, walk.index)) >= survival {
                        continue;
                    }
                    walk.weight /= survival;
                }
                let [u, v] = if bounce % 2 == 0 {
                    walk.spare
                } else {
                    let [u, v, spare @ ..] = sampler::sobol(walk.index, bounce.div_ceil(2), seed);
                    walk.spare = spare;
                    [u, v]
                };
                let direction = sampler::cosine(point.normal, u, v);
                self.rays[kept] = Ray::new(point.position, direction, point.triangle);
                self.walks[kept] = walk;
                kept += 1;
            }
            record(bounce, &self.vertices);
            self.rays.truncate(kept);
            self.walks.truncate(kept);
        }
        traced
    }
}

/// A hash as a number in `[0, 1)`.
fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Counts, for every point, the first hits on the back of opaque single-sided surfaces: a point
/// that sees many of them lies inside a wall (dossier 5.5).
pub struct BackFaces<'a> {
    /// The scene gathered over.
    pub tracer: &'a Tracer<'a>,
}

impl Sink for BackFaces<'_> {
    type State = Vec<u32>;
    /// Share of paths whose first hit is such a back face, one a point.
    type Output = Vec<f32>;

    fn start(&self, points: &[ReferencePoint]) -> Vec<u32> {
        vec![0; points.len()]
    }
    fn record(&self, state: &mut Vec<u32>, lane: usize, bounce: u32, vertices: &[Vertex]) {
        if bounce == 0 {
            let behind =
                |v: &&Vertex| !v.point.front && !self.tracer.facet(v.point.triangle).double_sided();
            state[lane] = vertices.iter().filter(behind).count() as u32;
        }
    }
    fn finish(&self, state: Vec<u32>, samples: u32) -> Vec<f32> {
        state
            .into_iter()
            .map(|n| n as f32 / samples as f32)
            .collect()
    }
}
