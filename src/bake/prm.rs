//! Precomputed radiance maps (S4, dossier 5.3): gathers the response of every reference point to
//! every entry cell and stores it as block x cell-list rows.

use crate::domain::atlas::dilation;
use crate::domain::cells::{CellOptions, Cells};
use crate::domain::{Domain, ReferencePoint};
use crate::error::{Error, Result};
use crate::gather::operator::{self, Continuation};
use crate::gather::{self, BLOCK, BackFaces, GatherOptions, Sink, Vertex};
use crate::plan::Parameters;
use crate::progress::Progress;
use crate::scene::{Finding, Scene};
use crate::trace::{NO_TRIANGLE, Ray, Tracer};
use half::f16;
use lightkiln_format::prm::{LANES, Prm, ROW, UNSOUND};
use serde::Serialize;

const _: () = assert!(BLOCK == LANES, "a gather block is an asset block");

/// A point more than this share of whose first hits are back faces lies inside a wall (dossier 5.5).
const BACK_FACE_LIMIT: f32 = 0.3;

/// Responses are dropped from a block, smallest first, as long as no point loses more than this
/// share of its total response: the error is at most this times what uniform irradiance of the
/// brightest cell's strength would give. 2^-11 is the rounding of the half floats stored.
const DROPPED_SHARE: f64 = 1.0 / 2048.0;

/// Texels by which charts are widened.
const DILATION: u32 = 4;

/// What the bake counted, for the index.
#[derive(Debug, Clone, Serialize)]
pub struct Statistics {
    /// Reference points.
    pub points: u64,
    /// Cells.
    pub cells: u64,
    /// Entry points.
    pub entry_points: u64,
    /// Rows stored.
    pub rows: u64,
    /// Rows a dense map would have.
    pub dense_rows: u64,
    /// Largest share of a point's total response that was dropped.
    pub dropped_share_bound: f64,
    /// Points found inside walls and refilled.
    pub refilled_points: u64,
    /// Share of first hits that met the back of a single-sided surface.
    pub back_face_share: f64,
    /// Residual of the bounce operator's solution.
    pub operator_residual: f64,
    /// Largest row sum of the bounce operator: below 1 the light dies out.
    pub operator_row_sum: f64,
}

/// A finished map with what there is to tell about it.
pub struct Baked {
    /// The map.
    pub prm: Prm,
    /// Counts.
    pub statistics: Statistics,
    /// Skips and repairs found while baking.
    pub findings: Vec<Finding>,
}

/// Bakes one scene.
///
/// # Errors
/// [`Error::Interrupted`], or [`Error::Input`] when the scene reflects all light for ever or needs
/// more cells than the format holds.
pub fn bake(
    tracer: &Tracer,
    domain: &Domain,
    parameters: &Parameters,
    progress: &Progress,
) -> Result<Baked> {
    let scene = tracer.scene();
    progress.stage(&scene.name, "clustering entry points", 0);
    let cells = entry_cells(tracer, parameters);
    if cells.len() > usize::from(u16::MAX) {
        return Err(Error::input(
            scene.name.as_ref(),
            "cells",
            format!("{} entry cells, more than the format's 65,535", cells.len()),
            "ask for fewer `cells` in [[scene.bake]]",
        ));
    }
    progress.check()?;
    progress.stage(&scene.name, "solving late bounces", cells.len() as u64);
    let continuation =
        operator::continuation(tracer, &cells, domain.seed, progress).ok_or(Error::Interrupted)?;
    check_solution(scene, &continuation)?;
    let sink = (
        Responses {
            cells: &cells,
            continuation: &continuation,
        },
        BackFaces { tracer },
    );
    let options = GatherOptions {
        samples: parameters.samples,
        bounces: parameters.bounces,
        seed: domain.seed,
    };
    progress.stage(
        &scene.name,
        "gathering",
        domain.points.len().div_ceil(BLOCK) as u64,
    );
    let blocks = gather::gather(
        tracer,
        |rays, hits| tracer.closest(rays, hits),
        &domain.points,
        &options,
        &sink,
        progress,
    )
    .ok_or(Error::Interrupted)?;
    progress.stage(&scene.name, "assembling", 0);
    Ok(assemble(scene, domain, &cells, &continuation, blocks))
}

/// Entry cells of a scene, sight answered by rays.
pub fn entry_cells(tracer: &Tracer, parameters: &Parameters) -> Cells {
    let options = CellOptions {
        cells: parameters.cells,
        entries_per_cell: parameters.entries_per_cell,
    };
    Cells::build(tracer.scene(), tracer.surfaces(), &options, &|pairs| {
        let rays: Vec<Ray> = pairs
            .iter()
            .map(|&(a, b)| Ray::segment(a, b, NO_TRIANGLE))
            .collect();
        let mut blocked = vec![false; rays.len()];
        tracer.occluded(&rays, &mut blocked);
        blocked.into_iter().map(|b| !b).collect()
    })
}

fn check_solution(scene: &Scene, continuation: &Continuation) -> Result<()> {
    // 1e-6: a millionth of the response, far below what f16 stores; f64 elimination leaves 1e-12
    // unless I - T is singular.
    let sound = continuation.residual < 1e-6;
    if sound
        && continuation
            .channels
            .iter()
            .flatten()
            .all(|x| x.is_finite() && *x >= -1e-6)
    {
        return Ok(());
    }
    Err(Error::input(
        scene.name.as_ref(),
        "materials",
        format!(
            "light never dies out: albedo reaches {:.4} in a closed space (residual {:.1e})",
            continuation.largest_row_sum, continuation.residual
        ),
        "lower the albedo below 1 with [[scene.material]] base_color",
    ))
}

/// The sink that fills the rows of one block.
pub struct Responses<'a> {
    /// Entry cells.
    pub cells: &'a Cells,
    /// What follows the last walked hit.
    pub continuation: &'a Continuation,
}

/// Sums of weights by lane and cell.
pub struct Sums {
    /// `lanes x cells` RGB (and padding): what is known from walked hits.
    walked: Vec<[f64; 4]>,
    /// Group of each lane: consecutive lanes of one chart. Where walks stop after some bounces is
    /// much the same for neighbours on one surface, so a group shares the distribution of its late
    /// bounces; each lane keeps its own amount.
    group: Vec<usize>,
    /// `groups x cells`, one array a channel: weights of walks that stopped, to be continued.
    tail: [Vec<f32>; 3],
    /// The same summed over cells, for each lane.
    stopped: Vec<[f64; 3]>,
}

/// Rows of one block.
pub struct Rows {
    cells: Vec<u16>,
    responses: Vec<f16>,
    /// Largest share of a lane's total response that was dropped.
    dropped: f64,
}

impl Sink for Responses<'_> {
    type State = Sums;
    type Output = Rows;

    fn start(&self, points: &[ReferencePoint]) -> Sums {
        let n = self.cells.len();
        let mut groups = 0;
        let group = (0..points.len())
            .map(|lane| {
                groups += usize::from(lane == 0 || points[lane].chart != points[lane - 1].chart);
                groups - 1
            })
            .collect();
        Sums {
            walked: vec![[0.0; 4]; points.len() * n],
            group,
            tail: std::array::from_fn(|_| vec![0.0; groups * n]),
            stopped: vec![[0.0; 3]; points.len()],
        }
    }

    fn record(&self, sums: &mut Sums, lane: usize, _bounce: u32, vertices: &[Vertex]) {
        let n = self.cells.len();
        let walked = &mut sums.walked[lane * n..(lane + 1) * n];
        for vertex in vertices {
            let cell = self.cells.find(&vertex.point) as usize;
            let weight = vertex.weight.to_array();
            for (sum, weight) in walked[cell].iter_mut().zip(weight) {
                *sum += f64::from(weight);
            }
            if vertex.last {
                let at = sums.group[lane] * n + cell;
                let stopped = &mut sums.stopped[lane];
                for ((tail, stopped), weight) in sums.tail.iter_mut().zip(stopped).zip(weight) {
                    tail[at] += weight;
                    *stopped += f64::from(weight);
                }
            }
        }
    }

    fn finish(&self, sums: Sums, samples: u32) -> Rows {
        let n = self.cells.len();
        let lanes = sums.group.len();
        let mut together = vec![[0.0_f64; 3]; sums.tail[0].len() / n];
        for (&group, stopped) in sums.group.iter().zip(&sums.stopped) {
            for (sum, stopped) in together[group].iter_mut().zip(stopped) {
                *sum += stopped;
            }
        }
        let responses: [Vec<f64>; 3] = std::array::from_fn(|k| {
            let late = self.continuation.apply(k, &sums.tail[k]);
            let mut responses = Vec::with_capacity(lanes * n);
            for lane in 0..lanes {
                let group = sums.group[lane];
                let total = together[group][k];
                let share = if total > 0.0 {
                    sums.stopped[lane][k] / total
                } else {
                    0.0
                };
                let walked = &sums.walked[lane * n..(lane + 1) * n];
                let late = &late[group * n..(group + 1) * n];
                let sum = |(w, l): (&[f64; 4], &f32)| w[k] + share * f64::from(*l);
                responses.extend(
                    walked
                        .iter()
                        .zip(late)
                        .map(|pair| sum(pair) / f64::from(samples)),
                );
            }
            responses
        });
        let (kept, dropped) = keep(&responses, lanes, n);
        let mut rows = Rows {
            cells: kept.iter().map(|&c| c as u16).collect(),
            responses: Vec::with_capacity(kept.len() * ROW),
            dropped,
        };
        for &cell in &kept {
            for channel in &responses {
                rows.responses.extend((0..LANES).map(|lane| {
                    let x = if lane < lanes {
                        channel[lane * n + cell]
                    } else {
                        0.0
                    };
                    f16::from_f64(x.max(0.0))
                }));
            }
        }
        rows
    }
}

/// Cells kept for a block, ascending, and the largest share of any lane's response dropped.
fn keep(responses: &[Vec<f64>; 3], points: usize, cells: usize) -> (Vec<usize>, f64) {
    let luminance = |at: usize| responses.iter().map(|r| r[at]).sum::<f64>();
    let totals: Vec<f64> = (0..points)
        .map(|p| (0..cells).map(|c| luminance(p * cells + c)).sum())
        .collect();
    let mut shares: Vec<(f64, usize)> = (0..cells)
        .map(|c| {
            let share = |p: usize| {
                if totals[p] > 0.0 {
                    luminance(p * cells + c) / totals[p]
                } else {
                    0.0
                }
            };
            ((0..points).map(share).fold(0.0, f64::max), c)
        })
        .collect();
    shares.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut dropped = 0.0;
    let first = shares
        .iter()
        .position(|&(share, _)| {
            let fits = dropped + share <= DROPPED_SHARE;
            if fits {
                dropped += share;
            }
            !fits
        })
        .unwrap_or(shares.len());
    let mut kept: Vec<usize> = shares[first..].iter().map(|s| s.1).collect();
    kept.sort_unstable();
    (kept, dropped)
}

fn assemble(
    scene: &Scene,
    domain: &Domain,
    cells: &Cells,
    continuation: &Continuation,
    blocks: Vec<(Rows, Vec<f32>)>,
) -> Baked {
    let back: Vec<f32> = blocks.iter().flat_map(|(_, b)| b.iter().copied()).collect();
    let mut valid: Vec<bool> = back.iter().map(|&share| share <= BACK_FACE_LIMIT).collect();
    let mut findings = Vec::new();
    refuse_hopeless_charts(domain, &mut valid, &mut findings);
    let refilled = valid.iter().filter(|v| !**v).count() as u64;
    if refilled > 0 {
        findings.push(Finding {
            element: "lightmap texels".into(),
            what: "lie inside a wall (over 30 % of what they see is back faces): filled from the \
                   nearest sound texel of their chart"
                .into(),
            count: refilled,
        });
    }
    if cells.hidden_pairs > 0 {
        findings.push(Finding {
            element: "entry cells".into(),
            what: "join points that do not all see each other and are too small to be split".into(),
            count: u64::from(cells.hidden_pairs),
        });
    }
    let mut prm = Prm {
        origin: scene.origin.to_array(),
        pages: domain.uvs.pages.clone(),
        entry_position: cells
            .entries
            .iter()
            .map(|e| e.position.to_array())
            .collect(),
        entry_normal: cells.entries.iter().map(|e| e.normal.to_array()).collect(),
        cell_entries: cells.first_entry.clone(),
        point_texel: domain
            .points
            .iter()
            .zip(&valid)
            .map(|(p, &valid)| {
                [
                    p.page,
                    p.texel[0],
                    p.texel[1],
                    if valid { 0 } else { UNSOUND },
                ]
            })
            .collect(),
        block_rows: vec![0],
        ..Prm::default()
    };
    let mut dropped = 0.0_f64;
    let total_rows: usize = blocks.iter().map(|(rows, _)| rows.cells.len()).sum();
    prm.row_cell.reserve_exact(total_rows);
    prm.row_response.reserve_exact(total_rows * ROW);
    for (index, (rows, _)) in blocks.into_iter().enumerate() {
        dropped = dropped.max(rows.dropped);
        let first = prm.row_response.len();
        prm.row_cell.extend(rows.cells);
        prm.row_response.extend(rows.responses);
        prm.block_rows.push(prm.row_cell.len() as u32);
        // Points inside walls store nothing; their texels are filled.
        let lanes = index * LANES..((index + 1) * LANES).min(valid.len());
        for lane in lanes.filter(|&i| !valid[i]).map(|i| i % LANES) {
            for value in prm.row_response[first..]
                .iter_mut()
                .skip(lane)
                .step_by(LANES)
            {
                *value = f16::ZERO;
            }
        }
    }
    prm.fill = dilation(&domain.uvs, &domain.points, &valid, DILATION)
        .into_iter()
        .map(|f| {
            [
                u32::from(f.page),
                u32::from(f.texel[0]),
                u32::from(f.texel[1]),
                f.source,
            ]
        })
        .collect();
    let statistics = Statistics {
        points: domain.points.len() as u64,
        cells: cells.len() as u64,
        entry_points: cells.entries.len() as u64,
        rows: prm.row_cell.len() as u64,
        dense_rows: (prm.blocks() * cells.len()) as u64,
        dropped_share_bound: dropped,
        refilled_points: refilled,
        back_face_share: back.iter().map(|&b| f64::from(b)).sum::<f64>() / back.len().max(1) as f64,
        operator_residual: continuation.residual,
        operator_row_sum: continuation.largest_row_sum,
    };
    Baked {
        prm,
        statistics,
        findings,
    }
}

/// A chart all of whose points see back faces has nothing to be filled from: it keeps its values
/// and is reported.
fn refuse_hopeless_charts(domain: &Domain, valid: &mut [bool], findings: &mut Vec<Finding>) {
    let charts = domain
        .points
        .iter()
        .map(|p| p.chart as usize + 1)
        .max()
        .unwrap_or(0);
    let mut hopeful = vec![false; charts];
    for (point, valid) in domain.points.iter().zip(valid.iter()) {
        hopeful[point.chart as usize] |= *valid;
    }
    let mut lost = 0;
    for (point, valid) in domain.points.iter().zip(valid.iter_mut()) {
        if !hopeful[point.chart as usize] {
            *valid = true;
            lost += 1;
        }
    }
    if lost > 0 {
        findings.push(Finding {
            element: "lightmap texels".into(),
            what: "belong to charts that lie wholly inside or behind walls: kept as they are; \
                   check the winding of these surfaces, or give them the role `occluder`"
                .into(),
            count: lost,
        });
    }
}
