//! Lights a scene with Lightkiln's assets in real time, on wgpu.
//!
//! ```text
//! asset + lights + visibility → cell irradiance → irradiance lightmap → any host shader
//! ```
//!
//! Every shader has a CPU twin in `lightkiln-format` and is tested against it. Coordinates are
//! local: metres relative to the asset's origin.

//!
//! The host brings its device, its lights and the geometry that casts shadows; every frame it gets
//! a lightmap of indirect irradiance:
//!
//! ```
//! use lightkiln_format::lighting::Light;
//! use lightkiln_format::prm::Prm;
//! use lightkiln_runtime::prm::PrmRuntime;
//! use lightkiln_runtime::shadow_cube::{SceneMesh, ShadowCubes};
//! use std::path::Path;
//!
//! fn load(
//!     device: &wgpu::Device,
//!     queue: &wgpu::Queue,
//!     mesh: &SceneMesh<'_>, // metres, relative to the asset's origin
//! ) -> Result<(PrmRuntime, ShadowCubes), Box<dyn std::error::Error>> {
//!     let prm = Prm::read(Path::new("baked/den/prm.safetensors"))?;
//!     let runtime = PrmRuntime::new(device, queue, &prm)?;
//!     let cubes = ShadowCubes::new(device, queue, mesh, 512)?; // texels along a face's side
//!     Ok((runtime, cubes))
//! }
//!
//! fn frame(
//!     device: &wgpu::Device,
//!     queue: &wgpu::Queue,
//!     runtime: &mut PrmRuntime,
//!     cubes: &mut ShadowCubes,
//!     lights: &[Light], // world metres
//! ) -> Result<(), Box<dyn std::error::Error>> {
//!     runtime.set_lights(lights)?;
//!     let mut encoder = device.create_command_encoder(&Default::default());
//!     runtime.see_entries(&mut encoder, cubes)?; // which entry points each lamp sees
//!     runtime.encode(&mut encoder)?; // lamps -> cells -> points -> texels
//!     queue.submit([encoder.finish()]);
//!     // Bind `runtime.lightmap()` in the scene's shader; add `albedo / pi` times its texel.
//!     Ok(())
//! }
//! ```

pub mod device;
pub mod error;
pub mod prm;
pub mod shadow_cube;
