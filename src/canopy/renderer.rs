//! Which twin of the visibility step runs: the graphics card's where there is one, else the CPU's.

use super::visibility::RenderVisibility;
use crate::gpu::{Device, GpuError};

/// The visibility step on `device`, or `on_cpu` where there is none. Results are the same.
///
/// # Errors
/// If the card's driver cannot compile the kernels.
pub fn on_device_or(
    device: Option<&Device>,
    on_cpu: Box<dyn RenderVisibility>,
) -> Result<Box<dyn RenderVisibility>, GpuError> {
    match device {
        None => Ok(on_cpu),
        #[cfg(feature = "gpu")]
        Some(device) => Ok(Box::new(super::visibility_gpu::GpuVisibility::new(device)?)),
        #[cfg(not(feature = "gpu"))]
        Some(device) => match *device {},
    }
}
