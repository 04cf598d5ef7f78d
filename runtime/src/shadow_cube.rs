//! Depth cubes: what each lamp sees, for entry points and for the host's own direct shadows.
//!
//! L. Szécsi et al. 2006, section 3.2: the visibility of entry points comes for free with the
//! shadow maps of direct light. A cube is six layers of a `Depth32Float` array, 90° each. Depth is
//! reversed and has no far plane (`near / z`): a float then has the same relative precision at
//! every distance. The bias is a lift along the normal by the texel's footprint; `cube_lift` in
//! `shaders/shared/cube.wgsl` derives it.

use crate::device::{self, within};
use crate::error::RuntimeError;
use glam::Vec3;
use lightkiln_format::direct::Lamp;
use lightkiln_format::error::InvalidArray;

/// WGSL for host shaders: `cube_visibility(cubes, near, lamp, from_lamp, normal)`.
pub const CUBE_WGSL: &str = include_str!("../shaders/shared/cube.wgsl");

/// The near plane's share of the largest distance between a lamp and the geometry. Geometry nearer
/// to the lamp than that casts no shadow: 10 µm in a room of 10 m. The reversed float depth keeps
/// its precision whatever the value.
const NEAR_SHARE: f32 = 1.0 / (1 << 20) as f32;

/// Format of the cubes.
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Triangles that block light.
#[derive(Debug, Clone, Copy)]
pub struct SceneMesh<'a> {
    /// Positions, metres, relative to the asset's origin.
    pub positions: &'a [[f32; 3]],
    /// Three a triangle; both sides block.
    pub indices: &'a [u32],
}

/// Uniform of one face, as in `shadow_cube.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Face {
    lamp: [f32; 3],
    near: f32,
    face: u32,
    padding: [u32; 3],
}

/// Depth cubes of a set of lamps.
#[derive(Debug)]
pub struct ShadowCubes {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipeline: wgpu::RenderPipeline,
    positions: wgpu::Buffer,
    indices: wgpu::Buffer,
    index_count: u32,
    bounds: [Vec3; 2],
    resolution: u32,
    near: wgpu::Buffer,
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl ShadowCubes {
    /// Uploads `mesh`; faces will have `resolution × resolution` texels.
    ///
    /// # Errors
    /// [`RuntimeError::Array`] names the position or index that is wrong;
    /// [`RuntimeError::TooLarge`] and [`RuntimeError::OpenGl`] for a device that does not do.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        mesh: &SceneMesh<'_>,
        resolution: u32,
    ) -> Result<Self, RuntimeError> {
        device::supported(device)?;
        mesh.validate()?;
        let limits = device.limits();
        let side = u64::from(limits.max_texture_dimension_2d);
        within(
            "depth cubes",
            u64::from(resolution),
            "max_texture_dimension_2d",
            side,
        )?;
        // A footprint needs texels: the lift of `cube_lift` has to stay below the distance.
        if resolution < 4 {
            let problem = format!("is {resolution}; a face has at least 4 texels a side");
            return Err(InvalidArray::new("resolution", 0, problem).into());
        }
        let buffer = |what, bytes: &[u8], usage| {
            within(
                what,
                bytes.len() as u64,
                "max_buffer_size",
                limits.max_buffer_size,
            )?;
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: bytes.len().max(12) as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            queue.write_buffer(&buffer, 0, bytes);
            Ok::<_, RuntimeError>(buffer)
        };
        let positions = bytemuck::cast_slice(mesh.positions);
        let positions = buffer("mesh positions", positions, wgpu::BufferUsages::VERTEX)?;
        let indices = bytemuck::cast_slice(mesh.indices);
        let indices = buffer("mesh indices", indices, wgpu::BufferUsages::INDEX)?;
        let (texture, view) = cubes(device, resolution, 1);
        Ok(Self {
            device: device.clone(),
            queue: queue.clone(),
            pipeline: pipeline(device),
            positions,
            indices,
            index_count: mesh.indices.len() as u32,
            bounds: mesh.bounds(),
            resolution,
            near: device::uniform(device, queue, "near plane", &0.0_f32),
            texture,
            view,
        })
    }

    /// Records the drawing of a cube for each lamp that has a position; the layers of directional
    /// lamps stay unused. Once a submission: the lamps are written when it starts.
    ///
    /// # Errors
    /// [`RuntimeError::TooLarge`] if there are more lamps than texture layers.
    pub fn render(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        lamps: &[Lamp],
    ) -> Result<(), RuntimeError> {
        let layers = 6 * lamps.len().max(1) as u64;
        let limit = u64::from(self.device.limits().max_texture_array_layers);
        within("depth cubes", layers, "max_texture_array_layers", limit)?;
        if u64::from(self.texture.depth_or_array_layers()) < layers {
            (self.texture, self.view) = cubes(&self.device, self.resolution, lamps.len() as u32);
        }
        let [low, high] = self.bounds;
        let reach = |lamp: &Lamp| {
            let lamp = Vec3::from(lamp.position);
            (lamp - low).abs().max((high - lamp).abs()).max_element()
        };
        let local = || lamps.iter().enumerate().filter(|(_, lamp)| lamp.is_local());
        let reach = local()
            .map(|(_, lamp)| reach(lamp))
            .fold(f32::MIN_POSITIVE, f32::max);
        let near = (reach * NEAR_SHARE).max(f32::MIN_POSITIVE);
        self.queue
            .write_buffer(&self.near, 0, bytemuck::bytes_of(&near));
        for (i, lamp) in local() {
            for face in 0..6 {
                self.render_face(encoder, 6 * i as u32 + face, lamp.position, near, face);
            }
        }
        Ok(())
    }

    fn render_face(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        layer: u32,
        lamp: [f32; 3],
        near: f32,
        face: u32,
    ) {
        let uniform = Face {
            lamp,
            near,
            face,
            padding: [0; 3],
        };
        let uniform = device::uniform(&self.device, &self.queue, "cube face", &uniform);
        let layout = self.pipeline.get_bind_group_layout(0);
        let group = device::bind(&self.device, &layout, &[uniform.as_entire_binding()]);
        let view = self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        });
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("depth cube face"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..self.index_count, 0, 0..1);
    }

    /// The cubes, a `texture_depth_2d_array`: layers `6 i .. 6 i + 6` are those of lamp `i`.
    /// Changes when `render` meets more lamps than before.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Uniform buffer with the near plane, an `f32` in metres.
    pub fn near(&self) -> &wgpu::Buffer {
        &self.near
    }
}

impl SceneMesh<'_> {
    fn validate(&self) -> Result<(), InvalidArray> {
        if let Some(i) = self
            .positions
            .iter()
            .position(|p| !Vec3::from(*p).is_finite())
        {
            return Err(InvalidArray::new("positions", i, "is not finite"));
        }
        if !self.indices.len().is_multiple_of(3) || u32::try_from(self.indices.len()).is_err() {
            let problem = "the indices are not triangles, or more than 2^32";
            return Err(InvalidArray::new("indices", self.indices.len(), problem));
        }
        let count = self.positions.len();
        if let Some(i) = self.indices.iter().position(|&v| v as usize >= count) {
            let problem = format!("is vertex {} of {count}", self.indices[i]);
            return Err(InvalidArray::new("indices", i, problem));
        }
        Ok(())
    }

    /// Lowest and highest corner; the origin for a mesh without positions.
    fn bounds(&self) -> [Vec3; 2] {
        let positions = || self.positions.iter().map(|&p| Vec3::from(p));
        let low = positions().reduce(Vec3::min).unwrap_or_default();
        [low, positions().reduce(Vec3::max).unwrap_or_default()]
    }
}

fn cubes(device: &wgpu::Device, resolution: u32, lamps: u32) -> (wgpu::Texture, wgpu::TextureView) {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("depth cubes"),
        size: wgpu::Extent3d {
            width: resolution,
            height: resolution,
            depth_or_array_layers: 6 * lamps,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: DEPTH,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    (texture, view)
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let source = [CUBE_WGSL, include_str!("../shaders/shadow_cube.wgsl")].concat();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("shadow_cube.wgsl"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("depth cube face"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("draw_face"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 12,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}
