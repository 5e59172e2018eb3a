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
