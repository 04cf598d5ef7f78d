//! Bakes in, pictures out: the lightmap and one forward pass.

use crate::picture::{self, Radiance};
use crate::scene::{Scene, Vertex};
use glam::camera::rh::{proj::directx, view};
use glam::{DVec3, Vec3};
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::Prm;
use lightkiln_runtime::prm::{LAMP_WGSL, PrmRuntime};
use lightkiln_runtime::shadow_cube::{CUBE_WGSL, SceneMesh, ShadowCubes};
use std::path::PathBuf;

/// Samples a pixel, in each direction.
const SUPERSAMPLING: u32 = 2;

/// Texels of a side of a depth cube's face.
const CUBE_SIZE: u32 = 1024;

/// What to draw.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Folder with `scene.lit.glb` and `prm.safetensors`.
    pub dir: PathBuf,
    /// Folder for the pictures.
    pub out: PathBuf,
    /// Position of the lamp, world metres.
    pub lamp: Option<DVec3>,
    /// Radiant intensity, W/sr.
    pub intensity: Vec3,
    /// Eye, world metres.
    pub camera: Option<DVec3>,
    /// Point looked at, world metres.
    pub target: Option<DVec3>,
    /// Vertical field of view, degrees.
    pub fov: f32,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Factor on radiance; by default the 98th percentile of luminance becomes white.
    pub exposure: Option<f32>,
}

impl Options {
    /// Reads the command line, program name excluded.
    ///
    /// # Errors
    /// A message with the argument that is wrong.
    pub fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Self, String> {
        let dir = PathBuf::from(arguments.next().ok_or("the folder is missing")?);
        let mut options = Self {
            out: dir.clone(),
            dir,
            lamp: None,
            intensity: Vec3::splat(10.0),
            camera: None,
            target: None,
            fov: 70.0,
            size: [960, 640],
            exposure: None,
        };
        while let Some(key) = arguments.next() {
            let value = arguments
                .next()
                .ok_or_else(|| format!("`{key}` needs a value"))?;
            let bad = || format!("`{key}`: `{value}` is malformed");
            let one = || {
                value
                    .parse::<f32>()
                    .ok()
                    .filter(|v| *v > 0.0 && v.is_finite())
            };
            let three = || {
                let numbers: Vec<f64> = value.split(',').map_while(|v| v.parse().ok()).collect();
                let numbers = <[f64; 3]>::try_from(numbers).ok()?;
                Some(DVec3::from(numbers)).filter(|v| v.is_finite())
            };
            match key.as_str() {
                "--out" => options.out = PathBuf::from(&value),
                "--lamp" => options.lamp = Some(three().ok_or_else(bad)?),
                "--intensity" => options.intensity = three().ok_or_else(bad)?.as_vec3(),
                "--camera" => options.camera = Some(three().ok_or_else(bad)?),
                "--target" => options.target = Some(three().ok_or_else(bad)?),
                "--fov" => options.fov = one().filter(|v| *v < 180.0).ok_or_else(bad)?,
                "--exposure" => options.exposure = Some(one().ok_or_else(bad)?),
                "--size" => {
                    let (width, height) = value.split_once('x').ok_or_else(bad)?;
                    let size = [width, height].map(|v| v.parse().unwrap_or(0));
                    options.size = Some(size)
                        .filter(|s| s.iter().all(|v| *v > 0))
                        .ok_or_else(bad)?;
                }
                _ => return Err(format!("`{key}` is unknown")),
            }
        }
        Ok(options)
    }
}

/// Uniform of the forward pass.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct View {
    projection: [[f32; 4]; 4],
    eye: [f32; 3],
    lamps: u32,
}

/// Draws, writes the pictures and says what was drawn.
///
/// # Errors
/// A message with the file or element that is wrong.
pub fn run(options: &Options) -> Result<String, String> {
    let prm = Prm::read(&options.dir.join("prm.safetensors")).map_err(|e| e.to_string())?;
    let mut scene = Scene::read(&options.dir.join("scene.lit.glb"), prm.origin)?;
    let volume = scene.lamp_volumes.first().map(|v| v.map(DVec3::from));
    let inside = |share: DVec3| volume.map(|[low, high]| low + (high - low) * share);
    let or_default = |given: Option<DVec3>, share: [f64; 3], name: &str| {
        let default = given.or_else(|| inside(share.into()));
        default.ok_or_else(|| format!("the scene has no lamp volume: give --{name}"))
    };
    let lamp = or_default(options.lamp, [0.5, 0.5, 0.5], "lamp")?;
    let camera = or_default(options.camera, [0.04, 0.65, 0.04], "camera")?;
    let target = or_default(options.target, [0.7, 0.25, 0.7], "target")?;
    let light = Light::Point {
        position: lamp,
        intensity: options.intensity,
        radius: 0.01,
    };

    let (adapter, device, queue) =
        pollster::block_on(lightkiln_runtime::device::open()).map_err(|e| e.to_string())?;
    let mut runtime = PrmRuntime::new(&device, &queue, &prm).map_err(|e| e.to_string())?;
    for vertex in &mut scene.vertices {
        if vertex.page >= 0.0 {
            let page = vertex.page as usize;
            let scale = runtime
                .page_scale(page)
                .ok_or(format!("the map has no page {page}"))?;
            (0..2).for_each(|k| vertex.lightmap[k] *= scale[k]);
        }
    }
    let positions: Vec<_> = scene.vertices.iter().map(|v| v.position).collect();
    let indices = [scene.single_sided.as_slice(), &scene.double_sided].concat();
    let mesh = SceneMesh {
        positions: &positions,
        indices: &indices,
    };
    let mut cubes =
        ShadowCubes::new(&device, &queue, &mesh, CUBE_SIZE).map_err(|e| e.to_string())?;
    runtime.set_lights(&[light]).map_err(|e| e.to_string())?;
    let mut encoder = device.create_command_encoder(&Default::default());
    runtime
        .see_entries(&mut encoder, &mut cubes)
        .map_err(|e| e.to_string())?;
    runtime.encode(&mut encoder).map_err(|e| e.to_string())?;
    queue.submit([encoder.finish()]);

    let origin = DVec3::from(prm.origin);
    let eye = (camera - origin).as_vec3();
    let size = options.size.map(|v| v * SUPERSAMPLING);
    let aspect = size[0] as f32 / size[1] as f32;
    // Reversed, without a far plane; nothing is looked at from nearer than 2 cm.
    let perspective = directx::perspective_infinite_reverse(options.fov.to_radians(), aspect, 0.02);
    let look = view::look_at_mat4(eye, (target - origin).as_vec3(), Vec3::Y);
    let projection = (perspective * look).to_cols_array_2d();
    let view = View {
        projection,
        eye: eye.into(),
        lamps: runtime.lamps().len() as u32,
    };
    let pass = Pass {
        device: &device,
        queue: &queue,
        size,
    };
    let [direct, indirect] = pass.draw(&scene, &view, &runtime, &cubes)?;

    let direct = direct.shrink(SUPERSAMPLING as usize);
    let indirect = indirect.shrink(SUPERSAMPLING as usize);
    let lit = direct.plus(&indirect);
    // A picture without light has no percentile to expose for.
    let exposure = options
        .exposure
        .unwrap_or(1.0 / lit.quantile(0.98).max(f32::MIN_POSITIVE));
    let scale = indirect.quantile(0.99).max(f32::MIN_POSITIVE);
    let pictures = [
        direct.exposed(exposure),
        lit.exposed(exposure),
        indirect.false_colour(scale),
    ];
    std::fs::create_dir_all(&options.out).map_err(|e| format!("{}: {e}", options.out.display()))?;
    for (name, image) in ["direct.png", "lit.png", "difference.png"]
        .iter()
        .zip(&pictures)
    {
        picture::write(&options.out.join(name), image)?;
    }
    picture::write_sheet(&options.out.join("sheet.png"), &pictures)?;
    Ok(format!(
        "{}: lamp at {lamp}, eye at {camera}; mean radiance direct {:.4}, indirect {:.4} \
         W/(m² sr); exposure {exposure:.3}, clipped, sRGB; false colour: white = {scale:.4}",
        adapter.get_info().name,
        direct.mean(),
        indirect.mean()
    ))
}

/// The forward pass.
struct Pass<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    size: [u32; 2],
}

impl Pass<'_> {
    /// Direct and indirect radiance.
    fn draw(
        &self,
        scene: &Scene,
        view: &View,
        runtime: &PrmRuntime,
        cubes: &ShadowCubes,
    ) -> Result<[Radiance; 2], String> {
        let single = self.pipeline(Some(wgpu::Face::Back));
        let double = self.pipeline(None);
        let targets = [(); 2].map(|()| self.target(wgpu::TextureFormat::Rgba32Float));
        let depth = self.target(wgpu::TextureFormat::Depth32Float);
        let views = targets
            .each_ref()
            .map(|t| t.create_view(&Default::default()));
        let depth_view = depth.create_view(&Default::default());
        let attachment = |view| {
            Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })
        };
        let vertices = self.buffer(&scene.vertices, wgpu::BufferUsages::VERTEX);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("forward"),
            color_attachments: &[attachment(&views[0]), attachment(&views[1])],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth_view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_vertex_buffer(0, vertices.slice(..));
        for (pipeline, indices) in [
            (&single, &scene.single_sided),
            (&double, &scene.double_sided),
        ] {
            let group = self.bind(pipeline, view, scene, runtime, cubes);
            let buffer = self.buffer(indices, wgpu::BufferUsages::INDEX);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.set_index_buffer(buffer.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..indices.len() as u32, 0, 0..1);
        }
        drop(pass);
        self.queue.submit([encoder.finish()]);
        let [direct, indirect] = targets.map(|target| self.read(&target));
        Ok([direct?, indirect?])
    }

    fn target(&self, format: wgpu::TextureFormat) -> wgpu::Texture {
        let [width, height] = self.size;
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    fn buffer<T: bytemuck::NoUninit>(&self, data: &[T], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: (size_of_val(data) as u64).max(64),
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue
            .write_buffer(&buffer, 0, bytemuck::cast_slice(data));
        buffer
    }

    fn bind(
        &self,
        pipeline: &wgpu::RenderPipeline,
        view: &View,
        scene: &Scene,
        runtime: &PrmRuntime,
        cubes: &ShadowCubes,
    ) -> wgpu::BindGroup {
        let view = self.buffer(&[*view], wgpu::BufferUsages::UNIFORM);
        let lamps = self.buffer(runtime.lamps(), wgpu::BufferUsages::STORAGE);
        let sampler = self.device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let headers = self.buffer(&scene.textures.headers, wgpu::BufferUsages::STORAGE);
        let texels = self.buffer(&scene.textures.texels, wgpu::BufferUsages::STORAGE);
        let resources = [
            view.as_entire_binding(),
            lamps.as_entire_binding(),
            wgpu::BindingResource::TextureView(cubes.view()),
            cubes.near().as_entire_binding(),
            wgpu::BindingResource::TextureView(runtime.lightmap()),
            wgpu::BindingResource::Sampler(&sampler),
            headers.as_entire_binding(),
            texels.as_entire_binding(),
        ];
        let entries = [0, 1, 2, 3, 4, 5, 6, 7].map(|binding| wgpu::BindGroupEntry {
            binding,
            resource: resources[binding as usize].clone(),
        });
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }

    fn pipeline(&self, cull_mode: Option<wgpu::Face>) -> wgpu::RenderPipeline {
        let source = [LAMP_WGSL, CUBE_WGSL, include_str!("forward.wgsl")].concat();
        let module = self
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("forward.wgsl"),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
        let attributes = wgpu::vertex_attr_array![
            0 => Float32x3, 1 => Float32x3, 2 => Float32x2, 3 => Float32x3, 4 => Float32,
            5 => Float32x2, 6 => Float32
        ];
        let target = || Some(wgpu::TextureFormat::Rgba32Float.into());
        self.device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("forward"),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("place"),
                    compilation_options: Default::default(),
                    buffers: &[Some(wgpu::VertexBufferLayout {
                        array_stride: size_of::<Vertex>() as u64,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &attributes,
                    })],
                },
                primitive: wgpu::PrimitiveState {
                    cull_mode,
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: wgpu::TextureFormat::Depth32Float,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("shade"),
                    compilation_options: Default::default(),
                    targets: &[target(), target()],
                }),
                multiview_mask: None,
                cache: None,
            })
    }

    fn read(&self, texture: &wgpu::Texture) -> Result<Radiance, String> {
        let [width, height] = self.size;
        let stride = (width * 16).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(stride) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(stride),
                    rows_per_image: None,
                },
            },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        let (send, receive) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver waits below; if it is gone, so is the reason to send.
            let _ = send.send(result);
        });
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| e.to_string())?;
        receive
            .recv()
            .map_err(|e| e.to_string())?
            .map_err(|e| e.to_string())?;
        let bytes = buffer.get_mapped_range(..).map_err(|e| e.to_string())?;
        let texels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&bytes);
        let row = |y: u32| &texels[(y * stride / 16) as usize..][..width as usize];
        let pixels = (0..height)
            .flat_map(row)
            .map(|t| [t[0], t[1], t[2]])
            .collect();
        Ok(Radiance { width, pixels })
    }
}
