//! A pipeline: how triangles or points of a WGSL text are drawn on the graphics card, the nearest on top.
//!
//! All read the same kinds of memory: binding 0 of group 0 is a uniform, those after it are storage; binding 0 of group 1 are the
//! parameters of one call.

use super::device::Opened;
use super::target::{DEPTH, TargetUse, WORDS};

/// Bytes from the parameters of one call to those of the next: what every adapter takes.
pub const CALL_BYTES: usize = 256;

/// Which of a text's entry points make a pipeline.
#[derive(Clone, Copy, Debug)]
pub struct PipelineParts {
    /// Where a vertex comes to.
    pub vertex: &'static str,
    /// What a sample shows, or whether it is drawn at all; `None` where depth is all.
    pub fragment: Option<&'static str>,
    /// Whether each vertex is a point of one sample; else three are a triangle.
    pub is_points: bool,
    /// Number of storage buffers.
    pub storage: u32,
}

/// A compiled pipeline.
#[derive(Debug)]
pub struct Pipeline {
    pub(super) pipeline: wgpu::RenderPipeline,
    pub(super) memory: wgpu::BindGroupLayout,
    pub(super) call: wgpu::BindGroupLayout,
}

/// One call: parameters, and how much is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrawCall {
    /// Place of its parameters in their buffer, [`CALL_BYTES`] each.
    pub parameters: u32,
    /// Vertices of an instance, or the indices that name them.
    pub vertices: u32,
    /// Instances.
    pub instances: u32,
}

impl Pipeline {
    pub(super) fn compile<const N: usize>(
        opened: &Opened,
        label: &str,
        wgsl: &str,
        usage: TargetUse,
        parts: [PipelineParts; N],
    ) -> [Self; N] {
        let module = opened.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        });
        parts.map(|parts| Self::of(opened, &module, usage, parts))
    }

    fn of(
        opened: &Opened,
        module: &wgpu::ShaderModule,
        usage: TargetUse,
        parts: PipelineParts,
    ) -> Self {
        let device = &opened.device;
        let entry = |binding: u32, ty: wgpu::BufferBindingType, is_of_call: bool| {
            wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty,
                    has_dynamic_offset: is_of_call,
                    min_binding_size: None,
                },
                count: None,
            }
        };
        let uniform = wgpu::BufferBindingType::Uniform;
        let storage = wgpu::BufferBindingType::Storage { read_only: true };
        let mut entries = vec![entry(0, uniform, false)];
        // fragments need no storage, and some cards give them none
        entries.extend((1..=parts.storage).map(|binding| wgpu::BindGroupLayoutEntry {
            visibility: wgpu::ShaderStages::VERTEX,
            ..entry(binding, storage, false)
        }));
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries })
        };
        let (memory, call) = (layout(&entries), layout(&[entry(0, uniform, true)]));
        let both = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&memory), Some(&call)],
            immediate_size: 0,
        });
        let has_words = usage == TargetUse::Words;
        let target = [has_words.then(|| WORDS.into())];
        let topology = if parts.is_points {
            wgpu::PrimitiveTopology::PointList
        } else {
            wgpu::PrimitiveTopology::TriangleList
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(parts.vertex),
            layout: Some(&both),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(parts.vertex),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState { topology, ..Default::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                // larger is nearer; of equals the first stays
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: parts.fragment.map(|entry_point| wgpu::FragmentState {
                module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: if has_words { &target } else { &[] },
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { pipeline, memory, call }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{BufferUse, Device};

    const SQUARES: &str = "
        struct Call { depth: f32, word: u32 }
        @group(0) @binding(0) var<uniform> scale: f32;
        @group(0) @binding(1) var<storage, read> corners: array<vec2<f32>>;
        @group(1) @binding(0) var<uniform> call: Call;
        @vertex fn place(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
            return vec4<f32>(corners[i] * scale, call.depth, 1.0);
        }
        @fragment fn show(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
            return vec4<u32>(call.word, u32(at.x), u32(at.y), 0u);
        }";

    #[test]
    fn the_nearer_square_is_seen_in_any_order() {
        let Some(device) = Device::open_for_tests().expect("an adapter that cannot be opened")
        else {
            assert!(std::env::var_os("REQUIRE_GPU").is_none(), "no adapter");
            eprintln!("skipped: no adapter");
            return;
        };
        let parts =
            PipelineParts { vertex: "place", fragment: Some("show"), is_points: false, storage: 1 };
        let [squares] = device.pipelines("squares", SQUARES, TargetUse::Words, [parts]).unwrap();
        let mut uniform = device.buffer("scale", BufferUse::Uniform);
        let mut corners = device.buffer("corners", BufferUse::Storage);
        let mut indices = device.buffer("indices", BufferUse::Indices);
        let mut parameters = device.buffer("calls", BufferUse::Calls);
        let mut answer = device.buffer("picture", BufferUse::Answer);
        uniform.write(&[0.5_f32]).unwrap();
        corners.write(&[[-1.0_f32, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]).unwrap();
        indices.write(&[0_u32, 1, 2, 0, 2, 3]).unwrap();
        // near, then far
        let call = |depth: f32, word: u32| {
            let mut words = [0; CALL_BYTES / 4];
            words[..2].copy_from_slice(&[depth.to_bits(), word]);
            words
        };
        parameters.write(&[call(0.9, 7), call(0.2, 8)]).unwrap();
        let target = device.target([8, 4], TargetUse::Words).unwrap();
        answer.reserve(target.copy_bytes()).unwrap();
        let of = |parameters| DrawCall { parameters, vertices: 6, instances: 1 };
        for order in [[of(0), of(1)], [of(1), of(0)]] {
            let memory = [&uniform, &corners];
            device
                .submit("squares", |commands| {
                    commands.begin(&target);
                    let indices = Some(&indices);
                    commands.draw(&target, &squares, &memory, indices, &parameters, &order);
                    commands.copy_picture(&target, &answer);
                })
                .unwrap();
            let row = target.row_bytes() as usize / 16;
            let read = device.read(&answer, row * 4, <[[u32; 4]]>::to_vec).unwrap();
            for (x, y) in (0..4_u32).flat_map(|y| (0..8_u32).map(move |x| (x, y))) {
                // half the picture each way
                let is_within = (2..6).contains(&x) && (1..3).contains(&y);
                let expected = if is_within { [7, x, y, 0] } else { [0; 4] };
                assert_eq!(read[y as usize * row + x as usize], expected, "column {x}, row {y}");
            }
        }
    }
}
