//! Graphics cards: whether one is used, and what kernels and pictures need of it. The only users of wgpu.
//!
//! Reading order: [`GpuChoice`] (what the user wants), `adapter` (what the machine has), `device` (one of them, opened),
//! `buffer` and `kernel` (memory and programs on it), `target` and `pipeline` (what it draws into, and how), `commands` (what it
//! is told to do). Without the cargo feature
//! `gpu` there is never a device (`absent`). A kernel lies beside its CPU twin and speaks to this module alone.

mod adapter;

#[cfg(not(feature = "gpu"))]
mod absent;
#[cfg(feature = "gpu")]
mod buffer;
#[cfg(feature = "gpu")]
mod commands;
#[cfg(feature = "gpu")]
mod device;
#[cfg(feature = "gpu")]
mod kernel;
#[cfg(feature = "gpu")]
mod pipeline;
#[cfg(feature = "gpu")]
mod target;

use std::fmt;
use std::str::FromStr;

pub use adapter::Adapter;

#[cfg(not(feature = "gpu"))]
pub use absent::{Device, adapters, is_caught_panic};
#[cfg(feature = "gpu")]
pub use buffer::{Buffer, BufferUse};
#[cfg(feature = "gpu")]
pub use commands::Commands;
#[cfg(feature = "gpu")]
pub use device::{Device, adapters, is_caught_panic};
#[cfg(feature = "gpu")]
pub use kernel::Kernel;
#[cfg(feature = "gpu")]
pub use pipeline::{CALL_BYTES, DrawCall, Pipeline, PipelineParts};
#[cfg(feature = "gpu")]
pub use target::{Target, TargetUse};

/// Whether to work on a graphics card.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GpuChoice {
    /// Where there is one; a software adapter is none, because the CPU's own code is faster.
    #[default]
    Auto,
    /// Never.
    Off,
    /// Fail where there is none.
    Require,
}

impl GpuChoice {
    /// All choices, in the order they are told to users.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Off, Self::Require];

    /// The choice's name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Off => "off",
            Self::Require => "require",
        }
    }
}

impl fmt::Display for GpuChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A word that names no [`GpuChoice`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is none of auto, off, require")]
pub struct UnknownChoice(String);

impl FromStr for GpuChoice {
    type Err = UnknownChoice;

    fn from_str(name: &str) -> Result<Self, UnknownChoice> {
        Self::ALL
            .into_iter()
            .find(|choice| choice.name() == name)
            .ok_or_else(|| UnknownChoice(name.to_owned()))
    }
}

/// Why there is no graphics card to work on, or why it failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum GpuError {
    #[error(
        "a GPU is required, but this wildwood was built without the feature `gpu`: build it with `cargo build --release`, or give --gpu auto"
    )]
    NotBuilt,
    #[error(
        "a GPU is required, but no graphics card with a Vulkan, Metal or DirectX 12 driver was found{}: install its driver (`wildwood doctor` lists what is found), or give --gpu auto",
        software_note(software)
    )]
    NoAdapter { software: Vec<String> },
    #[error(
        "{adapter}: cannot be opened: {problem}; update its driver, or give --gpu off to work without it"
    )]
    NotOpened { adapter: String, problem: String },
    #[error(
        "{adapter}: out of memory ({what}); close other programs that use the graphics card, or give --gpu off"
    )]
    OutOfMemory { adapter: String, what: String },
    #[error(
        "{adapter}: {what} needs {bytes} bytes, the graphics card takes {limit_bytes} at once; give --gpu off"
    )]
    TooLarge { adapter: String, what: String, bytes: u64, limit_bytes: u64 },
    #[error(
        "{adapter}: the graphics card was lost ({problem}); run again, with --gpu off if it happens twice"
    )]
    Lost { adapter: String, problem: String },
    #[error(
        "{adapter}: no answer from the graphics card within {seconds} s; run again, with --gpu off if it happens twice"
    )]
    NoAnswer { adapter: String, seconds: u64 },
    #[error("{adapter}: {what} failed: {problem}; give --gpu off, and report this error")]
    Failed { adapter: String, what: String, problem: String },
}

fn software_note(software: &[String]) -> String {
    if software.is_empty() {
        String::new()
    } else {
        format!(" (only {}, which is software)", software.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_by_their_names() {
        for choice in GpuChoice::ALL {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        let error = "cuda".parse::<GpuChoice>().unwrap_err();
        assert_eq!(error.to_string(), "`cuda` is none of auto, off, require");
    }

    #[test]
    fn off_opens_nothing() {
        assert!(Device::open(GpuChoice::Off).unwrap().is_none());
    }

    #[test]
    fn auto_is_no_error_and_require_says_what_to_do() {
        let hardware = adapters().iter().any(|adapter| !adapter.is_software);
        assert!(Device::open(GpuChoice::Auto).is_ok());
        if !hardware {
            assert!(Device::open(GpuChoice::Auto).unwrap().is_none());
            let Err(error) = Device::open(GpuChoice::Require) else {
                panic!("a device without an adapter")
            };
            assert!(error.to_string().contains("--gpu auto"), "{error}");
        }
    }

    #[test]
    fn a_software_adapter_is_named_in_the_error() {
        let error = GpuError::NoAdapter { software: vec!["llvmpipe".to_owned()] };
        assert!(error.to_string().contains("only llvmpipe, which is software"), "{error}");
    }
}
