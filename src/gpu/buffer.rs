//! Memory on the graphics card that is kept between rounds and grows when needed.

use bytemuck::NoUninit;

use super::GpuError;
use super::device::Device;

/// What a buffer is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BufferUse {
    /// Few values that all lanes of a kernel read.
    Uniform,
    /// What kernels read and write.
    Storage,
    /// Which vertices make triangles.
    Indices,
    /// Parameters of many calls of pipelines, each [`super::CALL_BYTES`] long.
    Calls,
    /// What the CPU reads.
    Answer,
}

/// Memory on the graphics card.
#[derive(Debug)]
pub struct Buffer {
    device: Device,
    label: &'static str,
    usage: BufferUse,
    raw: Option<wgpu::Buffer>,
}

/// Sizes are rounded up to this. Copies are whole words of 4; structs of WGSL are often multiples of 16.
const GRAIN_BYTES: u64 = 16;

impl Buffer {
    pub(super) fn new(device: Device, label: &'static str, usage: BufferUse) -> Self {
        Self { device, label, usage, raw: None }
    }

    /// Makes room for `bytes`. Where the buffer grows, its content is lost.
    ///
    /// # Errors
    /// If the card has no room or takes no buffer this large.
    pub fn reserve(&mut self, bytes: u64) -> Result<(), GpuError> {
        let held = self.raw.as_ref().map_or(0, wgpu::Buffer::size);
        if held >= bytes.max(1) {
            return Ok(());
        }
        let limits = &self.device.opened().limits;
        let limit_bytes = match self.usage {
            BufferUse::Uniform => limits.max_uniform_buffer_binding_size,
            BufferUse::Storage => self.device.largest_storage_bytes(),
            BufferUse::Indices | BufferUse::Calls | BufferUse::Answer => limits.max_buffer_size,
        } / GRAIN_BYTES
            * GRAIN_BYTES;
        if bytes > limit_bytes {
            let adapter = self.device.adapter().to_string();
            let what = self.label.to_owned();
            return Err(GpuError::TooLarge { adapter, what, bytes, limit_bytes });
        }
        // crowns come and go by a few from round to round: half as much again saves most regrowths
        let wanted = bytes.max(held + held / 2).max(1).next_multiple_of(GRAIN_BYTES);
        let usage = match self.usage {
            BufferUse::Uniform | BufferUse::Calls => {
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST
            }
            BufferUse::Indices => wgpu::BufferUsages::INDEX | wgpu::BufferUsages::COPY_DST,
            BufferUse::Storage => {
                wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC
            }
            BufferUse::Answer => wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        };
        self.raw = None;
        let made = self.device.guarded(self.label, |opened| {
            opened.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(self.label),
                size: wanted.min(limit_bytes),
                usage,
                mapped_at_creation: false,
            })
        })?;
        self.raw = Some(made);
        Ok(())
    }

    /// Puts `values` at the buffer's start, growing it if needed, before the work that is handed over next.
    ///
    /// # Errors
    /// As [`Self::reserve`].
    pub fn write<T: NoUninit>(&mut self, values: &[T]) -> Result<(), GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        self.reserve(bytes.len() as u64)?; // usize is at most 64 bits
        let Some(raw) = &self.raw else { return Ok(()) };
        self.device.guarded(self.label, |opened| {
            // copies are of whole words
            let (words, tail) = bytes.split_at(bytes.len() / 4 * 4);
            if !words.is_empty() {
                opened.queue.write_buffer(raw, 0, words);
            }
            if !tail.is_empty() {
                let mut word = [0; 4];
                word[..tail.len()].copy_from_slice(tail);
                opened.queue.write_buffer(raw, words.len() as u64, &word);
            }
        })
    }

    pub(super) fn label(&self) -> &'static str {
        self.label
    }

    pub(super) fn raw(&self) -> Option<&wgpu::Buffer> {
        self.raw.as_ref()
    }
}
