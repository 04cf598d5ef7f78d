//! What gathering costs beside tracing: the bake's own ray batches, traced once more alone.

use crate::Figure;
use lightkiln::bake::prm::{self, Responses};
use lightkiln::domain::ReferencePoint;
use lightkiln::error::{Error, Result};
use lightkiln::gather::{self, BLOCK, BackFaces, GatherOptions, operator};
use lightkiln::manifest::Manifest;
use lightkiln::progress::Progress;
use lightkiln::trace::{Build, Hit, Ray, Tracer};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// Threads of both.
const THREADS: usize = 2;

/// Gather and replay alternate this often; medians count.
const TURNS: usize = 5;

/// Blocks recorded at once: 48 of 1,024 paths hold 9 million rays at most, 300 MB.
const RECORDED: usize = 48;

/// Largest gather time over replay time.
const LIMIT: f64 = 1.4;

/// Wall seconds, and processor seconds of all threads.
#[derive(Clone, Copy, Default)]
struct Cost {
    wall: f64,
    processor: f64,
}

/// Seconds all threads of this process have run; zero where Linux does not tell.
fn processor_seconds() -> f64 {
    let Ok(threads) = std::fs::read_dir("/proc/self/task") else {
        return 0.0;
    };
    threads
        .flatten()
        .filter_map(|t| std::fs::read_to_string(t.path().join("schedstat")).ok())
        .filter_map(|text| text.split(' ').next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}

fn timed<T>(work: impl FnOnce() -> T) -> (Cost, T) {
    let (processor, started) = (processor_seconds(), Instant::now());
    let value = work();
    let cost = Cost {
        wall: started.elapsed().as_secs_f64(),
        processor: processor_seconds() - processor,
    };
    (cost, value)
}

/// Sum over groups of the median over turns.
fn medians(turns: &[Vec<Cost>], pick: impl Fn(&Cost) -> f64) -> f64 {
    turns
        .iter()
        .map(|costs| {
            let mut values: Vec<f64> = costs.iter().map(&pick).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        })
        .sum()
}

/// Gathers over every n-th block of a scene, so that about `rays` rays are traced, and replays them.
pub fn replay(manifest_file: &str, scene: &str, rays: u64) -> Result<Vec<Figure>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(THREADS)
        .build()
        .expect("a pool of two threads");
    pool.install(|| measure(Path::new(manifest_file), scene, rays))
        .map(|figure| vec![figure])
}

fn measure(manifest_file: &Path, name: &str, rays: u64) -> Result<Figure> {
    let progress = Progress::default();
    let manifest = Manifest::read(manifest_file)?;
    let spec = manifest
        .scenes
        .iter()
        .find(|s| s.name == name)
        .ok_or_else(|| {
            Error::manifest(
                manifest_file,
                "scene",
                format!("has no scene `{name}`"),
                "give the name of one of its scenes",
            )
        })?;
    let prepared = lightkiln::prepare(manifest_file, spec, &progress)?;
    let (domain, job) = (&prepared.domain, &prepared.jobs[0]);
    let tracer = Tracer::new(&prepared.scene, Build::Good);
    let cells = prm::entry_cells(&tracer, &job.parameters);
    let continuation = operator::continuation(&tracer, &cells, domain.seed, &progress)
        .ok_or(Error::Interrupted)?;
    let sink = (
        Responses {
            cells: &cells,
            continuation: &continuation,
        },
        BackFaces { tracer: &tracer },
    );
    let options = GatherOptions {
        samples: job.parameters.samples,
        bounces: job.parameters.bounces,
        seed: domain.seed,
    };
    let a_block = BLOCK as u64 * u64::from(options.samples) * u64::from(options.bounces);
    let wanted = rays.div_ceil(a_block).max(1) as usize;
    let blocks = domain.points.len().div_ceil(BLOCK);
    let step = (blocks / wanted).max(1);
    let chosen: Vec<&[ReferencePoint]> = domain.points.chunks(BLOCK).step_by(step).collect();

    let (mut gathers, mut replays, mut traced) = (Vec::new(), Vec::new(), 0);
    for group in chosen.chunks(RECORDED) {
        let points = group.concat();
        let gathered = |closest: &(dyn Fn(&[Ray], &mut [Hit]) + Sync)| {
            gather::gather(&tracer, closest, &points, &options, &sink, &progress)
        };
        let batches = record(&tracer, &gathered);
        traced += batches.iter().map(|b| b.len() as u64).sum::<u64>();
        let (mut gather_costs, mut replay_costs) = (Vec::new(), Vec::new());
        for _ in 0..TURNS {
            gather_costs.push(
                timed(|| {
                    gather::gather(
                        &tracer,
                        |rays, hits| tracer.closest(rays, hits),
                        &points,
                        &options,
                        &sink,
                        &progress,
                    )
                    .map(|rows| rows.len())
                })
                .0,
            );
            replay_costs.push(timed(|| trace(&tracer, &batches)).0);
        }
        gathers.push(gather_costs);
        replays.push(replay_costs);
    }
    let ratio = |pick: fn(&Cost) -> f64| medians(&gathers, pick) / medians(&replays, pick);
    let (wall, processor) = (ratio(|c| c.wall), ratio(|c| c.processor));
    let speed = |costs: &[Vec<Cost>]| traced as f64 / medians(costs, |c| c.wall) / 1e6;
    Ok(Figure {
        asked: format!("{name}: gather time over replay time {LIMIT} or less, {THREADS} threads"),
        measured: format!(
            "{wall:.2} ({processor:.2} in processor time); gather {:.2}, replay {:.2} million rays/s",
            speed(&gathers),
            speed(&replays)
        ),
        met: wall <= LIMIT,
        notes: format!(
            "{traced} rays of {} of {blocks} blocks, {} triangles, {} cells; medians of {TURNS} \
             turns, gather and replay alternating",
            chosen.len(),
            prepared.scene.triangles.len(),
            cells.len()
        ),
    })
}

/// The batches one gather traces.
fn record<T>(
    tracer: &Tracer,
    gathered: &impl Fn(&(dyn Fn(&[Ray], &mut [Hit]) + Sync)) -> T,
) -> Vec<Vec<Ray>> {
    let batches = Mutex::new(Vec::new());
    gathered(&|rays, hits| {
        tracer.closest(rays, hits);
        batches
            .lock()
            .expect("no batch panicked")
            .push(rays.to_vec());
    });
    batches.into_inner().expect("no batch panicked")
}

/// Traces recorded batches, each as it was; the hits found keep the work from being left out.
fn trace(tracer: &Tracer, batches: &[Vec<Ray>]) -> u64 {
    batches
        .par_iter()
        .map_init(Vec::new, |hits: &mut Vec<Hit>, rays| {
            hits.clear();
            hits.resize(rays.len(), Hit::MISS);
            tracer.closest(rays, hits);
            hits.iter().filter(|h| h.is_hit()).count() as u64
        })
        .sum()
}
