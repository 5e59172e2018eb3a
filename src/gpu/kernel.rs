//! A kernel: one entry point of a WGSL text, compiled for the graphics card.

use super::device::Opened;

/// A compiled entry point. What it binds is taken from the text.
#[derive(Debug)]
pub struct Kernel {
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) layout: wgpu::BindGroupLayout,
}

impl Kernel {
    pub(super) fn compile<const N: usize>(
        opened: &Opened,
        label: &str,
        wgsl: &str,
        entry_points: [&'static str; N],
    ) -> [Self; N] {
        let module = opened.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        });
        entry_points.map(|entry_point| {
            let pipeline =
                opened.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry_point),
                    layout: None,
                    module: &module,
                    entry_point: Some(entry_point),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    cache: None,
                });
            let layout = pipeline.get_bind_group_layout(0);
            Self { pipeline, layout }
        })
    }
}
