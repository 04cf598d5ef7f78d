//! Opening the device, reading buffers back.

/// A device, unless `LIGHTKILN_NO_GPU=1` says to skip.
pub fn open() -> Option<(wgpu::Device, wgpu::Queue)> {
    open_with(|_| ())
}

/// A device with changed limits.
pub fn open_with(change: impl Fn(&mut wgpu::Limits)) -> Option<(wgpu::Device, wgpu::Queue)> {
    if std::env::var("LIGHTKILN_NO_GPU").is_ok_and(|v| v == "1") {
        println!("skipped: LIGHTKILN_NO_GPU=1");
        return None;
    }
    let opened = pollster::block_on(async {
        let (adapter, ..) = lightkiln_runtime::device::open().await?;
        let mut limits = adapter.limits();
        change(&mut limits);
        let descriptor = wgpu::DeviceDescriptor {
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = adapter.request_device(&descriptor).await.expect("a device");
        println!("on {}", adapter.get_info().name);
        Ok::<_, lightkiln_runtime::error::RuntimeError>((device, queue))
    });
    Some(opened.unwrap_or_else(|e| panic!("{e}; or set LIGHTKILN_NO_GPU=1 to skip")))
}

/// Records and submits.
pub fn submit<T>(
    (device, queue): &(wgpu::Device, wgpu::Queue),
    record: impl FnOnce(&mut wgpu::CommandEncoder) -> T,
) -> T {
    let mut encoder = device.create_command_encoder(&Default::default());
    let result = record(&mut encoder);
    queue.submit([encoder.finish()]);
    result
}

/// The whole content of a buffer with `COPY_SRC`.
pub fn read<T: bytemuck::Pod>(gpu: &(wgpu::Device, wgpu::Queue), buffer: &wgpu::Buffer) -> Vec<T> {
    let target = mappable(gpu, buffer.size());
    submit(gpu, |e| {
        e.copy_buffer_to_buffer(buffer, 0, &target, 0, buffer.size())
    });
    map(gpu, &target)
}

/// The texels of one layer of an `rgba16float` texture, widened.
pub fn read_layer(
    gpu: &(wgpu::Device, wgpu::Queue),
    texture: &wgpu::Texture,
    layer: u32,
) -> Vec<[f32; 4]> {
    let (width, height) = (texture.width(), texture.height());
    let stride = (width * 8).next_multiple_of(256);
    let target = mappable(gpu, u64::from(stride * height));
    submit(gpu, |encoder| {
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d {
                    x: 0,
                    y: 0,
                    z: layer,
                },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &target,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(stride),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
        );
    });
    let texels: Vec<[half::f16; 4]> = map(gpu, &target);
    let row = |y: u32| &texels[(y * stride / 8) as usize..][..width as usize];
    (0..height)
        .flat_map(row)
        .map(|t| t.map(half::f16::to_f32))
        .collect()
}

fn mappable((device, _): &(wgpu::Device, wgpu::Queue), size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    })
}

fn map<T: bytemuck::Pod>(
    (device, _): &(wgpu::Device, wgpu::Queue),
    buffer: &wgpu::Buffer,
) -> Vec<T> {
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    bytemuck::pod_collect_to_vec(&buffer.get_mapped_range(..).unwrap())
}
