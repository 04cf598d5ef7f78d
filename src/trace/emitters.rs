//! Light sources as the path tracer samples them.

use super::sampler;
use super::{Ray, Tracer};
use crate::scene::Scene;
use crate::scene::environment::Environment;
use crate::scene::surface::Facet;
use glam::{DVec3, Quat, Vec2, Vec3};
use lightkiln_format::direct::Lamp;
use lightkiln_format::lighting::{Light, LightingError};

/// Everything that emits: lamps, emissive triangles, sky.
pub struct Emitters<'a> {
    sources: Vec<Source>,
    surfaces: Option<EmissiveSurfaces>,
    sky: Option<Sky<'a>>,
}

/// An environment as it stands over the scene.
#[derive(Clone, Copy)]
pub struct Sky<'a> {
    /// The image.
    pub map: &'a Environment,
    /// Rotation about `+Y`, radians.
    pub rotation: f32,
    /// Factor on its radiance.
    pub scale: f32,
}

impl Sky<'_> {
    fn turned(&self, direction: Vec3, angle: f32) -> Vec3 {
        if angle == 0.0 {
            direction
        } else {
            Quat::from_rotation_y(angle) * direction
        }
    }

    fn radiance(&self, direction: Vec3) -> Vec3 {
        self.map.lookup(self.turned(direction, -self.rotation)) * self.scale
    }

    fn pdf(&self, direction: Vec3) -> f32 {
        self.map.pdf(self.turned(direction, -self.rotation))
    }

    /// Direction, radiance and density (1/sr).
    fn sample(&self, u: Vec2) -> (Vec3, Vec3, f32) {
        let (direction, radiance, pdf) = self.map.sample(u);
        (
            self.turned(direction, self.rotation),
            radiance * self.scale,
            pdf,
        )
    }
}

/// A source that moves at run time, in local coordinates.
enum Source {
    /// Point lamp, spot or directional light, evaluated as the runtime does.
    Lamp(Lamp),
    /// One-sided rectangle, sampled by area.
    Rectangle {
        centre: Vec3,
        half_u: Vec3,
        half_v: Vec3,
        radiance: Vec3,
    },
}

/// Emissive triangles with a cumulative distribution by power.
struct EmissiveSurfaces {
    triangles: Vec<u32>,
    /// Running sum of selection probabilities; the last is 1.
    cumulative: Vec<f64>,
    /// Density per m² on each scene triangle; zero where nothing is emitted.
    density: Vec<f32>,
}

/// Light arriving along a segment, before visibility: one candidate of next-event estimation.
#[derive(Debug, Clone, Copy)]
pub struct Incident {
    /// Shadow ray; unoccluded means lit.
    pub ray: Ray,
    /// Contribution to the irradiance estimate, W/m², linear RGB.
    pub irradiance: Vec3,
}

/// A point that light falls on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receiver {
    /// Position lifted off its surface, metres, local.
    pub position: Vec3,
    /// Unit normal of the cosine.
    pub normal: Vec3,
    /// Unit geometric normal: nothing arrives from below it.
    pub geometric_normal: Vec3,
    /// Triangle it lies on, or `NO_TRIANGLE`.
    pub triangle: u32,
}

impl Receiver {
    /// Cosine factor for unit direction `w`; zero from below either normal.
    #[inline]
    fn cosine(&self, w: Vec3) -> f32 {
        if self.geometric_normal.dot(w) > 0.0 {
            self.normal.dot(w).max(0.0)
        } else {
            0.0
        }
    }
}

impl<'a> Emitters<'a> {
    /// Collects lamps (world space), the scene's emissive triangles if `surfaces`, and a sky.
    ///
    /// # Errors
    /// [`LightingError::Value`] for the first light with a value out of range.
    pub fn new(
        scene: &Scene,
        lights: &[Light],
        surfaces: bool,
        sky: Option<Sky<'a>>,
    ) -> Result<Self, LightingError> {
        let source = |(index, light)| Source::of(scene, index, light);
        let sources = lights
            .iter()
            .enumerate()
            .map(source)
            .collect::<Result<_, _>>()?;
        let surfaces = if surfaces {
            EmissiveSurfaces::of(scene)
        } else {
            None
        };
        Ok(Self {
            sources,
            surfaces,
            sky,
        })
    }

    /// Lamps alone: what moves at run time.
    ///
    /// # Errors
    /// As [`Emitters::new`].
    pub fn lamps(scene: &Scene, lights: &[Light]) -> Result<Self, LightingError> {
        Self::new(scene, lights, false, None)
    }

    /// Appends one shadow ray and its unoccluded contribution per light source that can reach `at`.
    /// `random`: four numbers for emissive surfaces and rectangles, then sky.
    #[inline]
    pub fn incident(
        &self,
        tracer: &Tracer,
        at: &Receiver,
        random: [f32; 4],
        out: &mut Vec<Incident>,
    ) {
        for source in &self.sources {
            out.extend(source.incident(at, random));
        }
        if let Some(surfaces) = &self.surfaces {
            out.extend(surfaces.incident(tracer, at, random));
        }
        if let Some(sky) = &self.sky {
            let (direction, radiance, pdf) = sky.sample(Vec2::new(random[2], random[3]));
            let cosine = at.cosine(direction);
            if cosine > 0.0 && pdf > 0.0 {
                // Balance heuristic against the cosine-distributed ray.
                let weight = pdf / (pdf + cosine * std::f32::consts::FRAC_1_PI);
                out.push(Incident {
                    ray: Ray::new(at.position, direction, at.triangle),
                    irradiance: radiance * (cosine * weight / pdf),
                });
            }
        }
    }

    /// Radiance met by a cosine-distributed ray that escaped, times its MIS weight.
    pub fn escaped(&self, direction: Vec3, cosine_pdf: f32) -> Vec3 {
        self.sky.as_ref().map_or(Vec3::ZERO, |sky| {
            sky.radiance(direction) * (cosine_pdf / (cosine_pdf + sky.pdf(direction)))
        })
    }

    /// Radiance emitted towards a cosine-distributed ray that hit `triangle`, times its MIS weight.
    pub fn emitted(&self, tracer: &Tracer, ray: &Ray, hit: &super::Hit, cosine_pdf: f32) -> Vec3 {
        let Some(surfaces) = &self.surfaces else {
            return Vec3::ZERO;
        };
        let density = surfaces.density[hit.triangle as usize];
        let facet = tracer.facet(hit.triangle);
        let toward = -facet.normal.dot(ray.direction);
        if toward <= 0.0 && !facet.double_sided() {
            return Vec3::ZERO;
        }
        let scene = tracer.scene();
        let radiance = scene
            .material_of(hit.triangle)
            .emission(&scene.textures, scene.uv_at(hit.triangle, hit.u, hit.v));
        // `ray.direction` has unit length, so `t` is the distance.
        let light_pdf = density * hit.t * hit.t / toward.abs();
        radiance * (cosine_pdf / (cosine_pdf + light_pdf))
    }
}

impl Source {
    fn of(scene: &Scene, index: usize, light: &Light) -> Result<Self, LightingError> {
        match *light {
            Light::Rectangle {
                position,
                half_u,
                half_v,
                radiance,
            } => {
                light.validate(index)?;
                Ok(Self::Rectangle {
                    centre: scene.to_local(position),
                    half_u,
                    half_v,
                    radiance,
                })
            }
            _ => Lamp::new(light, index, scene.origin.to_array()).map(Self::Lamp),
        }
    }

    fn incident(&self, at: &Receiver, random: [f32; 4]) -> Option<Incident> {
        let (ray, irradiance) = match self {
            Self::Lamp(lamp) => {
                let ray = if lamp.is_local() {
                    Ray::segment(at.position, lamp.position.into(), at.triangle)
                } else {
                    Ray::new(at.position, -Vec3::from(lamp.direction), at.triangle)
                };
                let above = at.geometric_normal.dot(ray.direction) > 0.0;
                let irradiance = if above {
                    lamp.irradiance(at.position, at.normal)
                } else {
                    Vec3::ZERO
                };
                (ray, irradiance)
            }
            Self::Rectangle {
                centre,
                half_u,
                half_v,
                radiance,
            } => {
                let point =
                    centre + half_u * (2.0 * random[0] - 1.0) + half_v * (2.0 * random[1] - 1.0);
                let to = point - at.position;
                let d2 = to.length_squared();
                let w = to / d2.sqrt();
                let area_normal = half_u.cross(*half_v) * 4.0;
                let toward = (-area_normal.dot(w)).max(0.0);
                let ray = Ray::segment(at.position, point, at.triangle);
                (ray, radiance * (at.cosine(w) * toward / d2))
            }
        };
        (irradiance.max_element() > 0.0 && irradiance.is_finite())
            .then_some(Incident { ray, irradiance })
    }
}

impl EmissiveSurfaces {
    fn of(scene: &Scene) -> Option<Self> {
        let mut triangles = Vec::new();
        let mut power = Vec::new();
        let mut density = vec![0.0; scene.triangles.len()];
        for t in 0..scene.triangles.len() as u32 {
            let material = scene.material_of(t);
            if !material.emits() || !scene.role_of(t).blocks_light() {
                continue;
            }
            // Mean emission from a fixed 4x4 pattern: it only steers the sampling.
            let mean: DVec3 = (0..16)
                .map(|i| {
                    let (u, v) = ((i % 4) as f32 + 0.5, (i / 4) as f32 + 0.5);
                    let (u, v) = sampler::triangle(u / 4.0, v / 4.0);
                    material
                        .emission(&scene.textures, scene.uv_at(t, u, v))
                        .as_dvec3()
                })
                .sum();
            let weight = mean.element_sum() * Facet::of(scene, t).area();
            if weight > 0.0 {
                triangles.push(t);
                power.push(weight);
            }
        }
        let total: f64 = power.iter().sum();
        if total <= 0.0 {
            return None;
        }
        let mut cumulative = Vec::with_capacity(power.len());
        let mut sum = 0.0;
        for (&t, &p) in triangles.iter().zip(&power) {
            sum += p;
            cumulative.push(sum / total);
            density[t as usize] = (p / total / Facet::of(scene, t).area()) as f32;
        }
        Some(Self {
            triangles,
            cumulative,
            density,
        })
    }

    fn incident(&self, tracer: &Tracer, at: &Receiver, random: [f32; 4]) -> Option<Incident> {
        let pick = f64::from(random[0]);
        let k = self
            .cumulative
            .partition_point(|&c| c <= pick)
            .min(self.triangles.len() - 1);
        let low = if k == 0 { 0.0 } else { self.cumulative[k - 1] };
        let rescaled = ((pick - low) / (self.cumulative[k] - low)).clamp(0.0, 1.0) as f32;
        let triangle = self.triangles[k];
        let (u, v) = sampler::triangle(rescaled, random[1]);
        let facet = tracer.facet(triangle);
        let [a, b, c] = facet.corners();
        let point = a * (1.0 - u - v) + b * u + c * v;
        let front = facet.normal.dot(at.position - point) > 0.0;
        if triangle == at.triangle || (!front && !facet.double_sided()) {
            return None;
        }
        let target = tracer.surfaces().lifted(triangle, u, v, front);
        let to = target - at.position;
        let d2 = to.length_squared();
        let w = to / d2.sqrt();
        let cosine = at.cosine(w);
        let toward = facet.normal.dot(w).abs();
        if cosine <= 0.0 || toward <= 0.0 {
            return None;
        }
        let pdf = self.density[triangle as usize] * d2 / toward;
        let weight = pdf / (pdf + cosine * std::f32::consts::FRAC_1_PI);
        let scene = tracer.scene();
        let radiance = scene
            .material_of(triangle)
            .emission(&scene.textures, scene.uv_at(triangle, u, v));
        Some(Incident {
            ray: Ray::segment(at.position, target, at.triangle),
            irradiance: radiance * (cosine * weight / pdf),
        })
    }
}
