//! Who draws: the CPU, or a graphics card. Either decides what each sample of a picture shows and how far the sun's light reaches; light,
//! exposure and tone are worked out from that by the same code.

#[cfg(feature = "gpu")]
use super::picture_gpu::GpuPainter;
use crate::gpu::{Device, GpuError};

/// Who draws.
#[derive(Debug, Default)]
pub enum Painter {
    /// The CPU: the same bits everywhere.
    #[default]
    Cpu,
    /// A graphics card: the same picture but for roundings.
    #[cfg(feature = "gpu")]
    Gpu(Box<GpuPainter>),
}

impl Painter {
    /// The graphics card `device`, or the CPU where there is none.
    ///
    /// # Errors
    /// If the card's driver cannot compile the pipelines.
    pub fn on(device: Option<&Device>) -> Result<Self, GpuError> {
        match device {
            None => Ok(Self::Cpu),
            #[cfg(feature = "gpu")]
            Some(device) => Ok(Self::Gpu(Box::new(GpuPainter::new(device)?))),
            #[cfg(not(feature = "gpu"))]
            Some(device) => match *device {},
        }
    }
}
