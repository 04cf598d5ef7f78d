//! The whole bake against closed forms (dossier 5.7), in memory.

use crate::Figure;
use crate::closed_forms::{self, sidak_t7};
use crate::shapes::Builder;
use glam::{DVec3, Vec3};
use lightkiln::bake::prm::{self, Baked};
use lightkiln::domain::Domain;
use lightkiln::domain::atlas::AtlasOptions;
use lightkiln::error::Result;
use lightkiln::manifest::{BakeSpec, Technique};
use lightkiln::plan::{self, Parameters};
use lightkiln::progress::Progress;
use lightkiln::scene::Scene;
use lightkiln::trace::{Build, Tracer};
use lightkiln::verify::statistics;
use lightkiln_format::prm::{Prm, UNSOUND};

const ALBEDOS: [f32; 4] = [0.2, 0.5, 0.8, 0.95];

/// Radius of the integrating sphere, metres, and how often its icosahedron is divided.
const RADIUS: f64 = 2.0;
const LEVEL: u32 = 5;

/// Lamps from the centre, in radii: those the figure counts, and those further out.
const WITHIN: [f64; 4] = [0.0, 0.4, 0.6, 0.8];
const BEYOND: [f64; 2] = [0.9, 0.95];

/// Directions of the lamps from the centre, none along a symmetry axis of the mesh.
const DIRECTIONS: [DVec3; 4] = [
    DVec3::new(0.62, -0.35, 0.41),
    DVec3::new(-0.17, 0.88, 0.29),
    DVec3::new(-0.53, -0.21, -0.77),
    DVec3::new(0.31, 0.12, -0.93),
];

/// The parameters of a `[[scene.bake]]` that says nothing.
fn defaults(scene: &Scene, domain: &Domain) -> Parameters {
    let surface = (0..scene.triangles.len() as u32)
        .map(|t| 0.5 * f64::from(scene.double_area_normal(t).length()))
        .sum();
    let spec = BakeSpec {
        technique: Technique::Prm,
        preset: None,
        samples: None,
        bounces: None,
        cells: None,
        entries_per_cell: None,
        entry_density: None,
    };
    plan::parameters(&spec, surface, domain.points.len() as u64)
}

fn bake(tracer: &Tracer) -> Result<(Domain, Baked)> {
    let progress = Progress::default();
    let scene = tracer.scene();
    let domain = Domain::atlas(scene, &AtlasOptions::default(), &progress)?;
    let baked = prm::bake(tracer, &domain, &defaults(scene, &domain), &progress)?;
    Ok((domain, baked))
}

/// Values of the sound points with their areas.
fn sound<'a>(
    domain: &'a Domain,
    prm: &'a Prm,
    values: &'a [[f32; 3]],
) -> impl Iterator<Item = (f64, f64)> + 'a {
    prm.point_texel
        .iter()
        .zip(&domain.points)
        .zip(values)
        .filter(|((texel, _), _)| texel[3] != UNSOUND)
        .map(|((_, point), v)| (f64::from(v[0]), f64::from(point.area)))
}

/// Relative deviations from a closed form: of the area mean, and of the texels, sorted by size.
struct Deviation {
    mean: f64,
    texels: Vec<f64>,
}

impl Deviation {
    fn of(values: impl Iterator<Item = (f64, f64)>, expected: f64) -> Self {
        let (mut sum, mut area, mut texels) = (0.0, 0.0, Vec::new());
        for (value, weight) in values {
            sum += value * weight;
            area += weight;
            texels.push((value / expected - 1.0).abs());
        }
        texels.sort_by(f64::total_cmp);
        Self {
            mean: sum / area / expected - 1.0,
            texels,
        }
    }

    fn quantile(&self, share: f64) -> f64 {
        self.texels[((self.texels.len() - 1) as f64 * share) as usize]
    }
}

/// Largest deviations over several lamps.
#[derive(Default, Clone, Copy)]
struct Worst {
    mean: f64,
    rms: f64,
    percentile: f64,
    texel: f64,
}

impl Worst {
    fn take(&mut self, d: &Deviation) {
        let squares: f64 = d.texels.iter().map(|x| x * x).sum();
        self.mean = self.mean.max(d.mean.abs());
        self.rms = self.rms.max((squares / d.texels.len() as f64).sqrt());
        self.percentile = self.percentile.max(d.quantile(0.99));
        self.texel = self.texel.max(d.quantile(1.0));
    }

    fn text(&self) -> String {
        format!(
            "mean {:.3} %, RMS over texels {:.2} %, 99th percentile {:.2} %, worst texel {:.2} %",
            100.0 * self.mean,
            100.0 * self.rms,
            100.0 * self.percentile,
            100.0 * self.texel
        )
    }
}

/// A lamp anywhere in a closed sphere: indirect irradiance is rho/(1-rho) Phi/(4 pi R^2) everywhere.
///
/// In any closed room of one albedo the area mean is exactly rho/(1-rho) Phi/A: the polyhedron's
/// smaller area is the whole of its own correction.
pub fn sphere() -> Result<Vec<Figure>> {
    let mut worst = [Worst::default(); WITHIN.len() + BEYOND.len()];
    let mut notes = Vec::new();
    for albedo in ALBEDOS {
        let scene = Builder::default()
            .grey(albedo)
            .sphere(DVec3::ZERO, RADIUS, LEVEL, true)
            .build();
        let tracer = Tracer::new(&scene, Build::Good);
        let (domain, Baked { prm, .. }) = bake(&tracer)?;
        let rho = f64::from(albedo);
        let expected = rho / (1.0 - rho) / (RADIUS * RADIUS);
        let mut own = Worst::default();
        for (k, &distance) in WITHIN.iter().chain(&BEYOND).enumerate() {
            for direction in DIRECTIONS {
                let lamp = (direction.normalize() * distance * RADIUS).as_vec3();
                let lit = statistics::baked_irradiance(&tracer, &prm, lamp)?;
                let deviation = Deviation::of(sound(&domain, &prm, &lit), expected);
                worst[k].take(&deviation);
                if k < WITHIN.len() {
                    own.take(&deviation);
                }
            }
        }
        notes.push(format!("albedo {albedo}: {}", own.text()));
        if notes.len() == ALBEDOS.len() {
            let area: f64 = (0..scene.triangles.len() as u32)
                .map(|t| tracer.facet(t).area())
                .sum();
            let ball = 4.0 * std::f64::consts::PI * RADIUS * RADIUS;
            notes.push(format!(
                "{} triangles, {} texels; the polyhedron's area is {:.3} % less, so its own mean is \
                 {:+.3} % from the closed form",
                scene.triangles.len(),
                domain.points.len(),
                100.0 * (1.0 - area / ball),
                100.0 * (ball / area - 1.0)
            ));
        }
    }
    let within = worst[..WITHIN.len()]
        .iter()
        .fold(Worst::default(), |a, b| Worst {
            mean: a.mean.max(b.mean),
            rms: a.rms.max(b.rms),
            percentile: a.percentile.max(b.percentile),
            texel: a.texel.max(b.texel),
        });
    for (distance, worst) in WITHIN.iter().chain(&BEYOND).zip(&worst) {
        notes.push(format!("lamps at {distance} R: {}", worst.text()));
    }
    Ok(vec![Figure {
        asked: "integrating sphere, lamp within .8 R, albedo .2 .5 .8 .95: indirect irradiance \
                within .5 % of rho/(1-rho) Phi/(4 pi R^2)"
            .into(),
        measured: format!("largest deviation: {}", within.text()),
        met: within.texel <= 0.005,
        notes: format!(
            "the mean {} the target, the 99th percentile {}, every texel {}; {}",
            verdict(within.mean),
            verdict(within.percentile),
            verdict(within.texel),
            notes.join("; ")
        ),
    }])
}

fn verdict(deviation: f64) -> &'static str {
    if deviation <= 0.005 {
        "meets"
    } else {
        "misses"
    }
}

/// A closed room of one albedo: every point's responses add up to rho/(1-rho).
pub fn room() -> Result<Vec<Figure>> {
    let (mut worst, mut worst_mean, mut notes) = (0.0_f64, 0.0_f64, Vec::new());
    for albedo in ALBEDOS {
        let scene = Builder::default()
            .grey(albedo)
            .room(DVec3::ZERO, DVec3::new(4.0, 3.0, 5.0), 4)
            // A block standing free in the room (corners swapped: it faces out).
            .room(DVec3::new(2.0, 1.5, 3.0), DVec3::new(1.0, 0.5, 1.2), 2)
            .build();
        let tracer = Tracer::new(&scene, Build::Good);
        let (
            domain,
            Baked {
                prm, statistics, ..
            },
        ) = bake(&tracer)?;
        let total = prm
            .evaluate(&vec![Vec3::ONE.to_array(); prm.cells()])
            .expect("one value a cell");
        let rho = f64::from(albedo);
        let deviation = Deviation::of(sound(&domain, &prm, &total), rho / (1.0 - rho));
        let most = deviation.quantile(1.0);
        worst = worst.max(most);
        worst_mean = worst_mean.max(deviation.mean.abs());
        notes.push(format!(
            "albedo {albedo}: mean {:+.1e}, worst of {} texels {most:.1e}, 99th percentile {:.1e}, \
             largest share dropped {:.1e}, first hits on back faces {:.1e}",
            deviation.mean,
            domain.points.len(),
            deviation.quantile(0.99),
            statistics.dropped_share_bound,
            statistics.back_face_share
        ));
    }
    Ok(vec![Figure {
        asked: "closed uniform room: sum of responses within 1e-3 of rho/(1-rho), albedo .2 .5 .8 \
                .95, every texel"
            .into(),
        measured: format!("largest relative deviation: texel {worst:.1e}, mean {worst_mean:.1e}"),
        met: worst <= 1e-3,
        notes: notes.join("; "),
    }])
}

/// Unit squares seen from each other.
pub fn form_factors() -> Vec<Figure> {
    let bound = sidak_t7(2);
    closed_forms::form_factors()
        .iter()
        .map(|f| {
            let z = (f.mean - f.expected) / f.error;
            Figure {
                asked: format!(
                    "form factor of {} unit squares {:.6}, standard error 1e-4 or less, abs(z) \
                     within {bound:.2}",
                    f.name, f.expected
                ),
                measured: format!("{:.6} +- {:.1e}, z {z:+.2}", f.mean, f.error),
                met: f.error <= 1e-4 && z.abs() <= bound,
                notes: String::new(),
            }
        })
        .collect()
}
