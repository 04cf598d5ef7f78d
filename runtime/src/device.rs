//! Opening a device, and sizes checked against its limits.

use crate::error::RuntimeError;
use lightkiln_format::prm::LANES;

/// Storage buffers of the pass with the most, `combine`.
const STORAGE_BUFFERS: u64 = 5;

/// Opens the default adapter with all its limits: responses of a map may need large buffers.
/// OpenGL is left out, see [`RuntimeError::OpenGl`].
///
/// A host that has a device of its own does not need this.
///
/// # Errors
/// [`RuntimeError::NoAdapter`].
pub async fn open() -> Result<(wgpu::Adapter, wgpu::Device, wgpu::Queue), RuntimeError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter = instance
        .request_adapter(&wgpu::RequestAdapterOptions::default())
        .await
        .map_err(|e| RuntimeError::NoAdapter(e.to_string()))?;
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("lightkiln"),
        required_limits: adapter.limits(),
        ..Default::default()
    };
    let opened = adapter.request_device(&descriptor).await;
    let (device, queue) = opened.map_err(|e| RuntimeError::NoAdapter(e.to_string()))?;
    Ok((adapter, device, queue))
}

/// Refuses a device that cannot run the shaders.
pub(crate) fn supported(device: &wgpu::Device) -> Result<(), RuntimeError> {
    if device.adapter_info().backend == wgpu::Backend::Gl {
        return Err(RuntimeError::OpenGl);
    }
    let limits = device.limits();
    let threads = limits.max_compute_workgroup_size_x;
    within(
        "blocks",
        LANES as u64,
        "max_compute_workgroup_size_x",
        threads.into(),
    )?;
    let buffers = limits.max_storage_buffers_per_shader_stage;
    let limit_name = "max_storage_buffers_per_shader_stage";
    within("passes", STORAGE_BUFFERS, limit_name, buffers.into())
}

/// Refuses `needed` above `limit`.
pub(crate) fn within(
    what: &'static str,
    needed: u64,
    limit_name: &'static str,
    limit: u64,
) -> Result<(), RuntimeError> {
    if needed <= limit {
        return Ok(());
    }
    Err(RuntimeError::TooLarge {
        what,
        needed,
        limit_name,
        limit,
    })
}

/// An empty storage buffer of at least one element of 16 bytes, since bindings are never empty.
pub(crate) fn storage(
    device: &wgpu::Device,
    what: &'static str,
    bytes: u64,
) -> Result<wgpu::Buffer, RuntimeError> {
    let limits = device.limits();
    let binding = limits.max_storage_buffer_binding_size;
    within(what, bytes, "max_storage_buffer_binding_size", binding)?;
    within(what, bytes, "max_buffer_size", limits.max_buffer_size)?;
    Ok(device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(what),
        size: bytes.max(16).next_multiple_of(4),
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    }))
}

/// A storage buffer that holds `data`.
pub(crate) fn upload<T: bytemuck::NoUninit>(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    what: &'static str,
    data: &[T],
) -> Result<wgpu::Buffer, RuntimeError> {
    let bytes: &[u8] = bytemuck::cast_slice(data);
    let buffer = storage(device, what, bytes.len() as u64)?;
    queue.write_buffer(&buffer, 0, bytes);
    Ok(buffer)
}

/// A uniform buffer that holds `value`.
pub(crate) fn uniform<T: bytemuck::NoUninit>(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    label: &str,
    value: &T,
) -> wgpu::Buffer {
    let bytes = bytemuck::bytes_of(value);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: (bytes.len() as u64).next_multiple_of(16),
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// A bind group of `resources` at bindings 0, 1, 2 ...
pub(crate) fn bind<'a>(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'a>],
) -> wgpu::BindGroup {
    let entry =
        |(binding, resource): (usize, &wgpu::BindingResource<'a>)| wgpu::BindGroupEntry::<'a> {
            binding: binding as u32,
            resource: resource.clone(),
        };
    let entries: Vec<_> = resources.iter().enumerate().map(entry).collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &entries,
    })
}
