//! What the graphics card is told to do, in order: clear, run kernels, draw, copy.

use super::buffer::Buffer;
use super::device::Opened;
use super::kernel::Kernel;
use super::pipeline::{CALL_BYTES, DrawCall, Pipeline};
use super::target::Target;

/// Work written down, to be handed over in one go. Each step sees what those before it wrote.
#[derive(Debug)]
pub struct Commands<'a> {
    opened: &'a Opened,
    encoder: wgpu::CommandEncoder,
}

impl<'a> Commands<'a> {
    pub(super) fn new(opened: &'a Opened, label: &str) -> Self {
        let description = wgpu::CommandEncoderDescriptor { label: Some(label) };
        Self { opened, encoder: opened.device.create_command_encoder(&description) }
    }

    /// Sets the first `bytes` of `buffer` to zero; a multiple of 4.
    pub fn clear(&mut self, buffer: &Buffer, bytes: u64) {
        if let (Some(raw), 1..) = (buffer.raw(), bytes) {
            self.encoder.clear_buffer(raw, 0, Some(bytes));
        }
    }

    /// Runs `kernel` in `workgroups` workgroups on `bindings` (number in the text, buffer). Workgroups are laid out in
    /// rows, because one dimension may be too short for all: theirs is number `y · width + x`, and the last row may
    /// have more than asked for.
    pub fn dispatch(&mut self, kernel: &Kernel, bindings: &[(u32, &Buffer)], workgroups: u32) {
        if workgroups == 0 {
            return;
        }
        let entries: Vec<wgpu::BindGroupEntry<'_>> = bindings
            .iter()
            .filter_map(|(binding, buffer)| {
                let resource = buffer.raw()?.as_entire_binding();
                Some(wgpu::BindGroupEntry { binding: *binding, resource })
            })
            .collect();
        let group = self.opened.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.layout,
            entries: &entries,
        });
        let [width, height] =
            layout(workgroups, self.opened.limits.max_compute_workgroups_per_dimension);
        let mut pass = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(width, height, 1);
    }

    /// Copies the first `bytes` of `from` to byte `at` of `to`; both multiples of 4.
    pub fn copy(&mut self, from: &Buffer, to: &Buffer, at: u64, bytes: u64) {
        if let (Some(from), Some(to), 1..) = (from.raw(), to.raw(), bytes) {
            self.encoder.copy_buffer_to_buffer(from, 0, to, at, bytes);
        }
    }

    /// Empties `target`: words of 0, and depths of 0, which are farthest.
    pub fn begin(&mut self, target: &Target) {
        drop(self.pass(target, true));
    }

    /// Draws `calls` of `pipeline` into `target`, one after the other; `memory` are its uniform and its storage buffers, in the
    /// order of bindings. With `indices` (words), vertices are those that they name.
    pub fn draw(
        &mut self,
        target: &Target,
        pipeline: &Pipeline,
        memory: &[&Buffer],
        indices: Option<&Buffer>,
        parameters: &Buffer,
        calls: &[DrawCall],
    ) {
        let Some(parameters) = parameters.raw() else { return };
        let group = |layout: &wgpu::BindGroupLayout, entries: &[wgpu::BindGroupEntry<'_>]| {
            self.opened.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout,
                entries,
            })
        };
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(memory)
            .filter_map(|(binding, buffer)| {
                let resource = buffer.raw()?.as_entire_binding();
                Some(wgpu::BindGroupEntry { binding, resource })
            })
            .collect();
        let bytes = CALL_BYTES as u64; // 256
        let of_call = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: parameters,
            offset: 0,
            size: std::num::NonZeroU64::new(bytes),
        });
        let memory = group(&pipeline.memory, &entries);
        let call_group =
            group(&pipeline.call, &[wgpu::BindGroupEntry { binding: 0, resource: of_call }]);
        let mut pass = self.pass(target, false);
        pass.set_pipeline(&pipeline.pipeline);
        pass.set_bind_group(0, &memory, &[]);
        let indices = indices.and_then(Buffer::raw);
        if let Some(indices) = indices {
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        }
        for call in calls.iter().filter(|call| call.vertices > 0 && call.instances > 0) {
            // calls of one buffer are below 2³² bytes
            pass.set_bind_group(1, &call_group, &[call.parameters * CALL_BYTES as u32]);
            match indices {
                Some(_) => pass.draw_indexed(0..call.vertices, 0, 0..call.instances),
                None => pass.draw(0..call.vertices, 0..call.instances),
            }
        }
    }

    fn pass(&mut self, target: &Target, clears: bool) -> wgpu::RenderPass<'_> {
        let words = target.words.as_ref().map(|(_, view)| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: if clears {
                    wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)
                } else {
                    wgpu::LoadOp::Load
                },
                store: wgpu::StoreOp::Store,
            },
        });
        let load = if clears { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load };
        let attachments = [words];
        let has_words = attachments[0].is_some();
        self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: if has_words { &attachments } else { &[] },
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &target.depth.1,
                depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        })
    }

    /// Copies `target`'s words, or its depths where it has none, to the start of `to`; rows are [`Target::row_bytes`] apart.
    pub fn copy_picture(&mut self, target: &Target, to: &Buffer) {
        let Some(buffer) = to.raw() else { return };
        let texture = target.words.as_ref().map_or(&target.depth.0, |(texture, _)| texture);
        let [width, height] = target.size_px;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: u32::try_from(target.row_bytes()).ok(),
            rows_per_image: None,
        };
        self.encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer, layout },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }

    pub(super) fn finish(self) -> wgpu::CommandBuffer {
        self.encoder.finish()
    }
}

/// Width and height of the fewest rows, none longer than `longest`, that hold `workgroups`.
fn layout(workgroups: u32, longest: u32) -> [u32; 2] {
    let height = workgroups.div_ceil(longest);
    [workgroups.div_ceil(height), height]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workgroups_fit_in_rows() {
        assert_eq!(layout(1, 65535), [1, 1]);
        assert_eq!(layout(65535, 65535), [65535, 1]);
        assert_eq!(layout(65536, 65535), [32768, 2]);
        for (workgroups, longest) in [(7, 3), (1_000_000, 65535), (10, 10), (11, 10)] {
            let [width, height] = layout(workgroups, longest);
            assert!(width <= longest && width * height >= workgroups);
            assert!(width * height - workgroups < height);
        }
    }
}
