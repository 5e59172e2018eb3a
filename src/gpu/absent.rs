//! No graphics card: what a crate built without the feature `gpu` has in its place.

use super::{Adapter, GpuChoice, GpuError};

/// An open graphics card, of which this build has none.
#[derive(Clone, Debug)]
pub enum Device {}

impl Device {
    /// No device.
    ///
    /// # Errors
    /// If one is required.
    pub fn open(choice: GpuChoice) -> Result<Option<Self>, GpuError> {
        match choice {
            GpuChoice::Auto | GpuChoice::Off => Ok(None),
            GpuChoice::Require => Err(GpuError::NotBuilt),
        }
    }

    /// The adapter it is.
    pub fn adapter(&self) -> &Adapter {
        match *self {}
    }
}

/// No adapters: this build cannot look for any.
pub fn adapters() -> Vec<Adapter> {
    Vec::new()
}

/// Whether a panic comes from the graphics driver's library, which this build lacks.
pub fn is_caught_panic(_: &std::panic::PanicHookInfo<'_>) -> bool {
    false
}
