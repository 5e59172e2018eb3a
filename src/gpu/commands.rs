//! What the graphics card is told to do, in order: clear, run kernels, copy.

use super::buffer::Buffer;
use super::device::Opened;
use super::kernel::Kernel;

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
