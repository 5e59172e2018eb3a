//! What the graphics card draws into: four words a sample and its depth, or depths alone.

use super::device::Opened;

/// What a target holds of each sample besides its depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetUse {
    /// Four words.
    Words,
    /// Nothing.
    Depth,
}

/// Rows are copied to buffers at multiples of this many bytes.
const ROW_GRAIN_BYTES: u64 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as u64;

pub(super) const WORDS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A picture on the graphics card.
#[derive(Debug)]
pub struct Target {
    pub(super) size_px: [u32; 2],
    pub(super) words: Option<(wgpu::Texture, wgpu::TextureView)>,
    pub(super) depth: (wgpu::Texture, wgpu::TextureView),
}

impl Target {
    pub(super) fn new(opened: &Opened, size_px: [u32; 2], usage: TargetUse) -> Self {
        let texture = |format: wgpu::TextureFormat, is_read: bool| {
            let read =
                if is_read { wgpu::TextureUsages::COPY_SRC } else { wgpu::TextureUsages::empty() };
            let texture = opened.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("picture"),
                size: wgpu::Extent3d {
                    width: size_px[0],
                    height: size_px[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | read,
                view_formats: &[],
            });
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            (texture, view)
        };
        let words = (usage == TargetUse::Words).then(|| texture(WORDS, true));
        Self { size_px, depth: texture(DEPTH, words.is_none()), words }
    }

    /// What it holds.
    pub fn usage(&self) -> TargetUse {
        if self.words.is_some() { TargetUse::Words } else { TargetUse::Depth }
    }

    /// Bytes from one row of its copy to the next: a few more than a row's samples have.
    pub fn row_bytes(&self) -> u64 {
        let sample_bytes = if self.words.is_some() { 16 } else { 4 };
        (u64::from(self.size_px[0]) * sample_bytes).next_multiple_of(ROW_GRAIN_BYTES)
    }

    /// Bytes of its copy: rows of words, or of depths.
    pub fn copy_bytes(&self) -> u64 {
        self.row_bytes() * u64::from(self.size_px[1])
    }
}
