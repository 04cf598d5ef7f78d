//! Precomputed radiance maps on the GPU: lamps to an irradiance lightmap.
//!
//! L. Szécsi, L. Szirmay-Kalos, M. Sbert 2006, section 5.2; layout and CPU twin in
//! [`lightkiln_format::prm`], shader in `shaders/prm.wgsl`.
//!
//! The lightmap is an `rgba16float` array, a layer a page: every device filters it and writes it as
//! storage (`rgba32float` is filterable on request only), at half the bandwidth. Devices round to
//! half precision up or down, which costs at most 2⁻¹⁰ of a value: about what the responses' own
//! half precision does. Irradiance above 65504 W/m² is clamped. The unrounded f32 values stay in
//! [`PrmRuntime::points`].

use crate::device::{bind, storage, supported, uniform, upload, within};
use crate::error::RuntimeError;
use crate::shadow_cube::{CUBE_WGSL, ShadowCubes};
use lightkiln_format::direct::Lamp;
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::{LANES, Prm, ROW, UNSOUND, validate_visibility};

/// WGSL for host shaders: `Lamp` and `irradiance(lamp, position, normal)`.
pub const LAMP_WGSL: &str = include_str!("../shaders/shared/lamp.wgsl");

/// Format of the lightmap.
pub const LIGHTMAP_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Most bytes of responses in one buffer: what every WebGPU device can bind.
const RESPONSE_PAGE: u64 = 128 << 20;

/// Bytes of a row of responses.
const ROW_BYTES: u64 = 2 * ROW as u64;

/// Numbers of things, as in `prm.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Counts {
    lamps: u32,
    entries: u32,
    cells: u32,
    texels: u32,
}

/// The part of the responses that one buffer holds.
#[derive(Debug)]
struct Chunk {
    blocks: u32,
    group: wgpu::BindGroup,
}

#[derive(Debug)]
struct Pipelines {
    see_entries: wgpu::ComputePipeline,
    weigh_entries: wgpu::ComputePipeline,
    average_cells: wgpu::ComputePipeline,
    combine: wgpu::ComputePipeline,
    write_texels: wgpu::ComputePipeline,
}

/// A precomputed radiance map on the GPU.
///
/// A frame: [`set_lights`](Self::set_lights); visibility by
/// [`see_entries`](Self::see_entries) or [`set_visibility`](Self::set_visibility); then
/// [`encode`](Self::encode), and sample [`lightmap`](Self::lightmap). Lights are set once a
/// submission: they are written when it starts.
#[derive(Debug)]
pub struct PrmRuntime {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: Pipelines,
    origin: [f64; 3],
    counts: Counts,
    counts_buffer: wgpu::Buffer,
    entries: wgpu::Buffer,
    entry_irradiance: wgpu::Buffer,
    cell_irradiance: wgpu::Buffer,
    points: wgpu::Buffer,
    average: wgpu::BindGroup,
    write: wgpu::BindGroup,
    chunks: Vec<Chunk>,
    lamps: Vec<Lamp>,
    /// Whether each light's visibility is known.
    visibility_known: Vec<bool>,
    lamp_buffer: wgpu::Buffer,
    visibility: wgpu::Buffer,
    lightmap: wgpu::TextureView,
    page_scale: Vec<[f32; 2]>,
}

impl PrmRuntime {
    /// Validates and uploads `prm`. The map itself is not needed afterwards.
    ///
    /// # Errors
    /// [`RuntimeError::Array`] for an invalid map; [`RuntimeError::TooLarge`] and
    /// [`RuntimeError::OpenGl`] for a device that does not do.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        prm: &Prm,
    ) -> Result<Self, RuntimeError> {
        supported(device)?;
        prm.validate()?;
        let pipelines = Pipelines::new(device);
        let texels = texels(prm);
        let counts = Counts {
            lamps: 0,
            entries: prm.entry_position.len() as u32,
            cells: prm.cells() as u32,
            texels: texels.len() as u32,
        };
        let counts_buffer = uniform(device, queue, "counts", &counts);
        let padded = |v: &[f32; 3]| [v[0], v[1], v[2], 0.0];
        let pair = prm.entry_position.iter().zip(&prm.entry_normal);
        let entries: Vec<_> = pair.map(|(p, n)| [padded(p), padded(n)]).collect();
        let entries = upload(device, queue, "entry points", &entries)?;
        let cell_entries = upload(device, queue, "cell entries", &prm.cell_entries)?;
        let vectors = |what, n: usize| storage(device, what, 16 * n as u64);
        let entry_irradiance = vectors("entry irradiance", prm.entry_position.len())?;
        let cell_irradiance = vectors("cell irradiance", prm.cells())?;
        let points = vectors("reference points", prm.blocks() * LANES)?;
        let texels = upload(device, queue, "lightmap texels", &texels)?;
        let (lightmap, page_scale) = lightmap(device, &prm.pages)?;
        let average = bind(
            device,
            &pipelines.average_cells.get_bind_group_layout(0),
            &[
                counts_buffer.as_entire_binding(),
                entry_irradiance.as_entire_binding(),
                cell_entries.as_entire_binding(),
                cell_irradiance.as_entire_binding(),
            ],
        );
        let write = bind(
            device,
            &pipelines.write_texels.get_bind_group_layout(0),
            &[
                counts_buffer.as_entire_binding(),
                texels.as_entire_binding(),
                points.as_entire_binding(),
                wgpu::BindingResource::TextureView(&lightmap),
            ],
        );
        let layout = pipelines.combine.get_bind_group_layout(0);
        let chunks = chunks(device, queue, prm, &layout, &cell_irradiance, &points)?;
        Ok(Self {
            device: device.clone(),
            queue: queue.clone(),
            pipelines,
            origin: prm.origin,
            counts,
            counts_buffer,
            entries,
            entry_irradiance,
            cell_irradiance,
            points,
            average,
            write,
            chunks,
            lamps: Vec::new(),
            visibility_known: Vec::new(),
            lamp_buffer: storage(device, "lamps", 0)?,
            visibility: storage(device, "visibility", 0)?,
            lightmap,
            page_scale,
        })
    }

    /// Replaces the lights; their visibility is unknown until given or rendered.
    ///
    /// # Errors
    /// [`RuntimeError::Lighting`] names the light; [`RuntimeError::TooLarge`]. The old lights stay.
    pub fn set_lights(&mut self, lights: &[Light]) -> Result<(), RuntimeError> {
        let lamp = |(i, light)| Lamp::new(light, i, self.origin);
        let lamps = lights
            .iter()
            .enumerate()
            .map(lamp)
            .collect::<Result<Vec<_>, _>>()?;
        let lamp_bytes = size_of_val(lamps.as_slice()) as u64;
        if lamp_bytes > self.lamp_buffer.size() {
            let seen = lights.len() as u64 * u64::from(self.counts.entries);
            let visibility = storage(&self.device, "visibility", 4 * seen)?;
            self.lamp_buffer = storage(&self.device, "lamps", lamp_bytes)?;
            self.visibility = visibility;
        }
        self.queue
            .write_buffer(&self.lamp_buffer, 0, bytemuck::cast_slice(&lamps));
        self.counts.lamps = lamps.len() as u32;
        self.queue
            .write_buffer(&self.counts_buffer, 0, bytemuck::bytes_of(&self.counts));
        self.visibility_known = vec![false; lamps.len()];
        self.lamps = lamps;
        Ok(())
    }

    /// Gives the visibility, 0 to 1, of every entry point from one light, found by the host.
    ///
    /// # Errors
    /// [`RuntimeError::NoSuchLight`]; [`RuntimeError::Array`] for a wrong length or value.
    pub fn set_visibility(&mut self, light: usize, values: &[f32]) -> Result<(), RuntimeError> {
        let count = self.lamps.len();
        let Some(known) = self.visibility_known.get_mut(light) else {
            return Err(RuntimeError::NoSuchLight { light, count });
        };
        validate_visibility(values, self.counts.entries as usize)?;
        let offset = 4 * light as u64 * u64::from(self.counts.entries);
        self.queue
            .write_buffer(&self.visibility, offset, bytemuck::cast_slice(values));
        *known = true;
        Ok(())
    }

    /// Records depth cubes for all point lamps and spots, and looks up their entry points in them.
    /// Directional lights keep what [`set_visibility`](Self::set_visibility) gave them.
    ///
    /// # Errors
    /// [`RuntimeError::TooLarge`] if there are too many lamps for one texture.
    pub fn see_entries(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        cubes: &mut ShadowCubes,
    ) -> Result<(), RuntimeError> {
        cubes.render(encoder, &self.lamps)?;
        let group = bind(
            &self.device,
            &self.pipelines.see_entries.get_bind_group_layout(0),
            &[
                self.counts_buffer.as_entire_binding(),
                self.lamp_buffer.as_entire_binding(),
                self.entries.as_entire_binding(),
                self.visibility.as_entire_binding(),
                wgpu::BindingResource::TextureView(cubes.view()),
                cubes.near().as_entire_binding(),
            ],
        );
        let mut pass = encoder.begin_compute_pass(&Default::default());
        let lookups = self.lamps.len() as u64 * u64::from(self.counts.entries);
        let groups = lookups.div_ceil(LANES as u64);
        self.dispatch(&mut pass, &self.pipelines.see_entries, &group, groups);
        for (lamp, known) in self.lamps.iter().zip(&mut self.visibility_known) {
            *known |= lamp.is_local();
        }
        Ok(())
    }

    /// Records weights, combination and lightmap.
    ///
    /// # Errors
    /// [`RuntimeError::VisibilityMissing`] names a light without visibility.
    pub fn encode(&self, encoder: &mut wgpu::CommandEncoder) -> Result<(), RuntimeError> {
        let missing = self.visibility_known.iter().position(|known| !known);
        if let Some(light) = missing {
            return Err(RuntimeError::VisibilityMissing { light });
        }
        let weigh = bind(
            &self.device,
            &self.pipelines.weigh_entries.get_bind_group_layout(0),
            &[
                self.counts_buffer.as_entire_binding(),
                self.lamp_buffer.as_entire_binding(),
                self.entries.as_entire_binding(),
                self.visibility.as_entire_binding(),
                self.entry_irradiance.as_entire_binding(),
            ],
        );
        let groups = |threads: u32| u64::from(threads).div_ceil(LANES as u64);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        let p = &self.pipelines;
        self.dispatch(
            &mut pass,
            &p.weigh_entries,
            &weigh,
            groups(self.counts.entries),
        );
        self.dispatch(
            &mut pass,
            &p.average_cells,
            &self.average,
            groups(self.counts.cells),
        );
        for chunk in &self.chunks {
            self.dispatch(&mut pass, &p.combine, &chunk.group, u64::from(chunk.blocks));
        }
        self.dispatch(
            &mut pass,
            &p.write_texels,
            &self.write,
            groups(self.counts.texels),
        );
        Ok(())
    }

    /// Dispatches at least `groups` workgroups, as a rectangle within the device's limits.
    fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        groups: u64,
    ) {
        let limit = u64::from(self.device.limits().max_compute_workgroups_per_dimension);
        let width = groups.min(limit);
        if width == 0 {
            return;
        }
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width as u32, groups.div_ceil(width) as u32, 1);
    }

    /// Irradiance lightmap, W/m², linear RGB: a `texture_2d_array<f32>`, a layer a page.
    ///
    /// A page fills the corner at (0, 0) of its layer: sample at the normalised coordinates within
    /// the page times [`page_scale`](Self::page_scale). Radiance is `albedo / π` times the value.
    pub fn lightmap(&self) -> &wgpu::TextureView {
        &self.lightmap
    }

    /// Size of a page over that of a layer; `None` for a page that does not exist.
    pub fn page_scale(&self, page: usize) -> Option<[f32; 2]> {
        self.page_scale.get(page).copied()
    }

    /// Indirect irradiance, W/m², of the reference points: a `vec4<f32>` each, in blocks.
    pub fn points(&self) -> &wgpu::Buffer {
        &self.points
    }

    /// Mean direct irradiance, W/m², of the cells: a `vec4<f32>` each.
    pub fn cell_irradiance(&self) -> &wgpu::Buffer {
        &self.cell_irradiance
    }

    /// Visibility in use: an `f32` for each entry point, light by light.
    pub fn visibility(&self) -> &wgpu::Buffer {
        &self.visibility
    }

    /// The lamps as uploaded, for the host's direct light.
    pub fn lamps(&self) -> &[Lamp] {
        &self.lamps
    }
}

impl Pipelines {
    fn new(device: &wgpu::Device) -> Self {
        let source = [LAMP_WGSL, CUBE_WGSL, include_str!("../shaders/prm.wgsl")].concat();
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("prm.wgsl"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let pipeline = |entry_point| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: None,
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        Self {
            see_entries: pipeline("see_entries"),
            weigh_entries: pipeline("weigh_entries"),
            average_cells: pipeline("average_cells"),
            combine: pipeline("combine"),
            write_texels: pipeline("write_texels"),
        }
    }
}

/// Page, x, y and point of every texel that has a value.
fn texels(prm: &Prm) -> Vec<[u32; 4]> {
    let own = prm
        .point_texel
        .iter()
        .enumerate()
        .filter(|(_, t)| t[3] != UNSOUND);
    let own = own.map(|(i, t)| [t[0].into(), t[1].into(), t[2].into(), i as u32]);
    own.chain(prm.fill.iter().copied()).collect()
}

/// Uploads the responses in chunks of whole blocks.
fn chunks(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    prm: &Prm,
    layout: &wgpu::BindGroupLayout,
    cell_irradiance: &wgpu::Buffer,
    points: &wgpu::Buffer,
) -> Result<Vec<Chunk>, RuntimeError> {
    let block_rows = upload(device, queue, "block rows", &prm.block_rows)?;
    let row_cell: Vec<_> = prm.row_cell.iter().map(|&cell| u32::from(cell)).collect();
    let row_cell = upload(device, queue, "row cells", &row_cell)?;
    let limits = device.limits();
    let page = RESPONSE_PAGE
        .min(limits.max_storage_buffer_binding_size)
        .min(limits.max_buffer_size);
    let mut chunks = Vec::new();
    let mut first = 0;
    while first < prm.blocks() {
        let row = prm.block_rows[first];
        let fits = |&end: &u32| u64::from(end - row) * ROW_BYTES <= page;
        let blocks = prm.block_rows[first + 1..]
            .iter()
            .take_while(|end| fits(end))
            .count()
            .max(1);
        let end = prm.block_rows[first + blocks];
        let responses = &prm.row_response[row as usize * ROW..end as usize * ROW];
        // A block beyond the page is refused here, by name.
        let responses = upload(device, queue, "responses of a block", responses)?;
        let chunk = uniform(
            device,
            queue,
            "chunk",
            &[first as u32, blocks as u32, row, 0],
        );
        let resources = [
            chunk.as_entire_binding(),
            block_rows.as_entire_binding(),
            row_cell.as_entire_binding(),
            responses.as_entire_binding(),
            cell_irradiance.as_entire_binding(),
            points.as_entire_binding(),
        ];
        chunks.push(Chunk {
            blocks: blocks as u32,
            group: bind(device, layout, &resources),
        });
        first += blocks;
    }
    Ok(chunks)
}

/// The lightmap, as large as the largest page, and each page's share of it.
fn lightmap(
    device: &wgpu::Device,
    pages: &[[u32; 2]],
) -> Result<(wgpu::TextureView, Vec<[f32; 2]>), RuntimeError> {
    let limits = device.limits();
    let width = pages.iter().map(|p| p[0]).max().unwrap_or(1);
    let height = pages.iter().map(|p| p[1]).max().unwrap_or(1);
    let side = u64::from(limits.max_texture_dimension_2d);
    within(
        "lightmap pages",
        width.max(height).into(),
        "max_texture_dimension_2d",
        side,
    )?;
    let layers = u64::from(limits.max_texture_array_layers);
    within(
        "lightmap pages",
        pages.len() as u64,
        "max_texture_array_layers",
        layers,
    )?;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("irradiance lightmap"),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: pages.len().max(1) as u32,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: LIGHTMAP_FORMAT,
        usage: wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    let scale = |p: &[u32; 2]| [p[0] as f32 / width as f32, p[1] as f32 / height as f32];
    Ok((view, pages.iter().map(scale).collect()))
}
