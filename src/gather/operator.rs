//! The bounce operator between entry cells: what follows the last walked hit, summed to infinity
//! without truncation or roulette (dossier 5.3, 5.8).
//!
//! `T[c][c']` is the mean over points `y` of cell `c` of the albedo-weighted probability that a
//! cosine-distributed ray from `y` hits cell `c'`. A walk that stops in `c` with weight `w` goes on
//! to contribute `w (T + T² + ...) = w T (I - T)^-1` to the cells' responses.
//! Approximation: within a cell the reflected light of these late bounces is taken as uniform.

use crate::domain::cells::Cells;
use crate::progress::Progress;
use crate::trace::{Hit, Ray, Tracer, sampler};
use faer::linalg::solvers::Solve;
use faer::{Mat, Par};
use rayon::prelude::*;

/// Rays a cell: its 256 or so samples times this many.
const RAYS_PER_SAMPLE: u32 = 16;

/// `T (I - T)^-1`, row-major, one matrix a colour channel, and how well it was solved.
pub struct Continuation {
    /// Cells.
    pub cells: usize,
    /// `channel[k][c * cells + c']`.
    pub channels: [Vec<f32>; 3],
    /// Largest absolute entry of `F - T - F T`.
    pub residual: f64,
    /// Largest row sum of `T`: a bound of its spectral radius.
    pub largest_row_sum: f64,
}

/// Traces and solves the continuation. `None` when cancelled.
pub fn continuation(
    tracer: &Tracer,
    cells: &Cells,
    seed: u32,
    progress: &Progress,
) -> Option<Continuation> {
    // One thread inside faer: its sums must not depend on how many there are.
    faer::set_global_parallelism(Par::Seq);
    let n = cells.len();
    let rows: Option<Vec<Vec<[f64; 3]>>> = (0..n)
        .into_par_iter()
        .map(|cell| {
            (!progress.cancelled()).then(|| {
                let row = row(tracer, cells, cell, seed, progress);
                progress.step(1);
                row
            })
        })
        .collect();
    let rows = rows?;
    let mut residual = 0.0_f64;
    let mut largest_row_sum = 0.0_f64;
    let channels = [0, 1, 2].map(|k| {
        let transfer = Mat::<f64>::from_fn(n, n, |i, j| rows[i][j][k]);
        for row in &rows {
            largest_row_sum = largest_row_sum.max(row.iter().map(|x| x[k]).sum());
        }
        let system = Mat::<f64>::from_fn(n, n, |i, j| f64::from(u8::from(i == j)) - rows[j][i][k]);
        // F (I - T) = T, transposed: (I - T)^t F^t = T^t.
        let solved = system.partial_piv_lu().solve(transfer.transpose());
        let full = solved.transpose();
        let product = full * &transfer;
        for i in 0..n {
            for j in 0..n {
                let rest = (full[(i, j)] - transfer[(i, j)] - product[(i, j)]).abs();
                residual = if rest.is_finite() {
                    residual.max(rest)
                } else {
                    f64::INFINITY
                };
            }
        }
        let mut flat = Vec::with_capacity(n * n);
        for i in 0..n {
            flat.extend((0..n).map(|j| full[(i, j)] as f32));
        }
        flat
    });
    Some(Continuation {
        cells: n,
        channels,
        residual,
        largest_row_sum,
    })
}

/// One row of `T`.
fn row(
    tracer: &Tracer,
    cells: &Cells,
    cell: usize,
    seed: u32,
    progress: &Progress,
) -> Vec<[f64; 3]> {
    let range = cells.first_sample[cell] as usize..cells.first_sample[cell + 1] as usize;
    let samples = &cells.samples[range];
    let mut rays = Vec::with_capacity(samples.len() * RAYS_PER_SAMPLE as usize);
    let seed = sampler::mix(seed, cell as u32);
    for sample in samples {
        for _ in 0..RAYS_PER_SAMPLE {
            let [u, v, ..] = sampler::sobol(rays.len() as u32 % sampler::MAX_SAMPLES, 0, seed);
            let direction = sampler::cosine(sample.normal, u, v);
            rays.push(Ray::new(sample.position, direction, sample.triangle));
        }
    }
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    progress.rays(rays.len() as u64);
    let mut row = vec![[0.0; 3]; cells.len()];
    let share = 1.0 / rays.len() as f64;
    for (ray, hit) in rays.iter().zip(&hits).filter(|(_, h)| h.is_hit()) {
        let point = tracer.surface(ray, hit);
        if point.albedo.max_element() > 0.0 {
            let to = &mut row[cells.find(&point) as usize];
            for (sum, albedo) in to.iter_mut().zip(point.albedo.to_array()) {
                *sum += f64::from(albedo) * share;
            }
        }
    }
    row
}

impl Continuation {
    /// `tail F` for `rows x cells` values of one colour channel, row-major.
    pub fn apply(&self, channel: usize, tail: &[f32]) -> Vec<f32> {
        let n = self.cells;
        let matrix = &self.channels[channel];
        let mut result = vec![0.0_f32; tail.len()];
        // Four rows share each row of F while it is in cache. The terms are positive: f32 partial
        // sums of n of them are good to n roundings.
        for (tails, results) in tail.chunks(4 * n).zip(result.chunks_mut(4 * n)) {
            for c in 0..n {
                let row = &matrix[c * n..(c + 1) * n];
                for (tail, result) in tails.chunks(n).zip(results.chunks_mut(n)) {
                    let weight = tail[c];
                    if weight > 0.0 {
                        for (sum, f) in result.iter_mut().zip(row) {
                            *sum += weight * f;
                        }
                    }
                }
            }
        }
        result
    }
}
