//! An open graphics card; whatever goes wrong on it becomes a [`GpuError`].
//!
//! A card may be lost, run out of memory or never answer, and its driver's library panics on what it has no error for.
//! None of this may end or hang a run.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytemuck::AnyBitPattern;

use super::buffer::{Buffer, BufferUse};
use super::commands::Commands;
use super::kernel::Kernel;
use super::pipeline::{Pipeline, PipelineParts};
use super::target::{Target, TargetUse};
use super::{Adapter, GpuChoice, GpuError};

/// Longest wait for an answer. Chosen: kernels here take milliseconds on a card and seconds on a busy software adapter,
/// and operating systems reset a card that hangs for some seconds.
const LONGEST_WAIT: Duration = Duration::from_secs(120);

/// An open graphics card; clones are the same card.
#[derive(Clone, Debug)]
pub struct Device(Arc<Opened>);

/// The card and what went wrong on it so far.
#[derive(Debug)]
pub(super) struct Opened {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    adapter: Adapter,
    pub(super) limits: wgpu::Limits,
    fault: Arc<Mutex<Option<Fault>>>,
}

/// What the driver complained of.
#[derive(Clone, Debug)]
enum Fault {
    Lost(String),
    NoAnswer,
    OutOfMemory,
    Other(String),
}

impl Fault {
    /// Whether the card is of no use any more.
    fn is_final(&self) -> bool {
        matches!(self, Self::Lost(_) | Self::NoAnswer)
    }
}

/// Notes a fault; the first that ends the card stays, of others the first until it is told.
fn note(slot: &Mutex<Option<Fault>>, fault: Fault) {
    let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
    match &*slot {
        Some(earlier) if earlier.is_final() || !fault.is_final() => {}
        _ => *slot = Some(fault),
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        let slot = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        if slot.as_ref().is_some_and(Fault::is_final) {
            // closing waits for the card's last work, which may never end: leave it to the operating system
            std::mem::forget((self.device.clone(), self.queue.clone()));
        }
    }
}

impl Device {
    /// The graphics card to work on, `None` where there is none and none is required. A software adapter is none.
    ///
    /// # Errors
    /// If a card is required, and none is found or it cannot be opened. Under [`GpuChoice::Auto`] a card that cannot be
    /// opened is as good as none.
    pub fn open(choice: GpuChoice) -> Result<Option<Self>, GpuError> {
        if choice == GpuChoice::Off || (choice == GpuChoice::Auto && !may_have_card()) {
            return Ok(None);
        }
        match (Self::open_first(|adapter| !adapter.is_software), choice) {
            (Ok(device), _) => Ok(Some(device)),
            (Err(_), GpuChoice::Auto) => Ok(None),
            (Err(error), _) => Err(error),
        }
    }

    /// Any adapter, software included, `None` where there is none: for tests of kernels, which want the same results
    /// from all.
    ///
    /// # Errors
    /// If adapters are found but none can be opened.
    pub fn open_for_tests() -> Result<Option<Self>, GpuError> {
        match Self::open_first(|_| true) {
            Ok(device) => Ok(Some(device)),
            Err(GpuError::NoAdapter { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The best of the adapters that are `wanted` and can be opened.
    fn open_first(wanted: impl Fn(&Adapter) -> bool) -> Result<Self, GpuError> {
        let found = find();
        let mut first_error = None;
        for (raw, adapter) in found.iter().filter(|(_, adapter)| wanted(adapter)) {
            match Self::open_adapter(raw, adapter) {
                Ok(device) => return Ok(device),
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        Err(first_error.unwrap_or_else(|| GpuError::NoAdapter {
            software: found
                .into_iter()
                .filter(|(_, adapter)| adapter.is_software)
                .map(|(_, adapter)| adapter.name)
                .collect(),
        }))
    }

    fn open_adapter(raw: &wgpu::Adapter, adapter: &Adapter) -> Result<Self, GpuError> {
        // what every adapter has, but for the size of buffers and pictures
        let of_adapter = raw.limits();
        let mut limits = wgpu::Limits::downlevel_defaults();
        limits.max_buffer_size = of_adapter.max_buffer_size;
        limits.max_storage_buffer_binding_size = of_adapter.max_storage_buffer_binding_size;
        limits.max_texture_dimension_2d = of_adapter.max_texture_dimension_2d;
        let limits = limits.or_worse_values_from(&of_adapter);
        let description = wgpu::DeviceDescriptor {
            label: Some("wildwood"),
            required_limits: limits.clone(),
            ..Default::default()
        };
        let opened = caught(|| pollster::block_on(raw.request_device(&description)));
        let (device, queue) =
            opened
                .and_then(|result| result.map_err(|error| error.to_string()))
                .map_err(|problem| GpuError::NotOpened { adapter: adapter.to_string(), problem })?;

        let fault = Arc::new(Mutex::new(None));
        let on_error = Arc::clone(&fault);
        device.on_uncaptured_error(Arc::new(move |error| {
            let seen = match error {
                wgpu::Error::OutOfMemory { .. } => Fault::OutOfMemory,
                other => Fault::Other(other.to_string()),
            };
            note(&on_error, seen);
        }));
        let on_loss = Arc::clone(&fault);
        device.set_device_lost_callback(move |_, message| note(&on_loss, Fault::Lost(message)));
        Ok(Self(Arc::new(Opened { device, queue, adapter: adapter.clone(), limits, fault })))
    }

    /// The adapter it is.
    pub fn adapter(&self) -> &Adapter {
        &self.0.adapter
    }

    /// Most bytes a kernel can have of one buffer.
    pub fn largest_storage_bytes(&self) -> u64 {
        let limits = &self.0.limits;
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// A buffer of no size yet; see [`Buffer::reserve`].
    pub fn buffer(&self, label: &'static str, usage: BufferUse) -> Buffer {
        Buffer::new(self.clone(), label, usage)
    }

    /// The kernels at `entry_points` of one WGSL text.
    ///
    /// # Errors
    /// If the text is no valid WGSL or the driver cannot compile it.
    pub fn kernels<const N: usize>(
        &self,
        label: &'static str,
        wgsl: &str,
        entry_points: [&'static str; N],
    ) -> Result<[Kernel; N], GpuError> {
        self.guarded(label, |opened| Kernel::compile(opened, label, wgsl, entry_points))
    }

    /// The pipelines made of `parts` of one WGSL text, for targets of one use.
    ///
    /// # Errors
    /// If the text is no valid WGSL or the driver cannot compile it.
    pub fn pipelines<const N: usize>(
        &self,
        label: &'static str,
        wgsl: &str,
        usage: TargetUse,
        parts: [PipelineParts; N],
    ) -> Result<[Pipeline; N], GpuError> {
        self.guarded(label, |opened| Pipeline::compile(opened, label, wgsl, usage, parts))
    }

    /// Most samples each way of a [`Target`].
    pub fn largest_side_px(&self) -> u32 {
        self.0.limits.max_texture_dimension_2d
    }

    /// Most bytes of a buffer that the CPU reads.
    pub fn largest_answer_bytes(&self) -> u64 {
        self.0.limits.max_buffer_size
    }

    /// A picture to draw into, of unknown content.
    ///
    /// # Errors
    /// If the card has no room or takes no picture this large.
    pub fn target(&self, size_px: [u32; 2], usage: TargetUse) -> Result<Target, GpuError> {
        self.guarded("picture", |opened| Target::new(opened, size_px, usage))
    }

    /// Hands the card the work that `record` writes down; it runs after everything handed over before.
    ///
    /// # Errors
    /// If the card fails or refuses.
    pub fn submit(
        &self,
        label: &'static str,
        record: impl FnOnce(&mut Commands<'_>),
    ) -> Result<(), GpuError> {
        self.guarded(label, |opened| {
            let mut commands = Commands::new(opened, label);
            record(&mut commands);
            opened.queue.submit([commands.finish()]);
        })
    }

    /// What `take` makes of the first `count` values of `buffer`, once all work handed over is done.
    ///
    /// # Errors
    /// If the card fails or does not answer.
    pub fn read<T: AnyBitPattern, R>(
        &self,
        buffer: &Buffer,
        count: usize,
        take: impl FnOnce(&[T]) -> R,
    ) -> Result<R, GpuError> {
        let what = buffer.label();
        let bytes = (count * size_of::<T>()) as u64; // usize is at most 64 bits
        let taken = self.guarded(what, |opened| {
            let raw = buffer.raw().ok_or("the buffer is empty")?;
            let view = raw.slice(..bytes);
            let mapped = Arc::new(Mutex::new(None));
            let on_mapped = Arc::clone(&mapped);
            view.map_async(wgpu::MapMode::Read, move |result| {
                *on_mapped.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            });
            let waited = opened
                .device
                .poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(LONGEST_WAIT) });
            match waited {
                Ok(_) => {}
                Err(wgpu::PollError::Timeout) => {
                    note(&opened.fault, Fault::NoAnswer);
                    return Err("no answer");
                }
                Err(_) => return Err("the last work was refused"),
            }
            match *mapped.lock().unwrap_or_else(PoisonError::into_inner) {
                Some(Ok(())) => {}
                _ => return Err("its memory cannot be read"),
            }
            let result = {
                let bytes = view.get_mapped_range().map_err(|_| "its memory cannot be read")?;
                let values = bytemuck::try_cast_slice(&bytes);
                // what panics in `take` is no fault of the card's
                let took = |values: &[T]| catch_unwind(AssertUnwindSafe(|| take(values)));
                values.map(took).map_err(|_| "its memory is misaligned")
            };
            raw.unmap();
            result
        })?;
        let taken = taken.map_err(|problem| self.failed(what, problem.to_owned()))?;
        Ok(taken.unwrap_or_else(|panic| resume_unwind(panic)))
    }

    /// Does `work` unless the card was lost before; tells what went wrong meanwhile.
    pub(super) fn guarded<T>(
        &self,
        what: &str,
        work: impl FnOnce(&Opened) -> T,
    ) -> Result<T, GpuError> {
        self.fault(what)?;
        let result = caught(|| work(&self.0));
        if let Err(message) = &result {
            // nobody knows in which state the driver's library is now
            note(&self.0.fault, Fault::Lost(message.clone()));
        }
        self.hear_of_loss();
        self.fault(what)?;
        result.map_err(|message| self.failed(what, message))
    }

    /// Notes whether a complaint comes from a lost card: the library tells of a loss only when it is next asked.
    fn hear_of_loss(&self) {
        let slot = self.0.fault.lock().unwrap_or_else(PoisonError::into_inner);
        let is_open = slot.as_ref().is_some_and(|seen| !seen.is_final());
        drop(slot);
        if is_open && let Err(message) = caught(|| self.0.device.poll(wgpu::PollType::Poll)) {
            note(&self.0.fault, Fault::Lost(message));
        }
    }

    /// What the driver complained of, as an error. A lost card stays lost; other faults are told once.
    fn fault(&self, what: &str) -> Result<(), GpuError> {
        let mut slot = self.0.fault.lock().unwrap_or_else(PoisonError::into_inner);
        let seen = match &*slot {
            None => return Ok(()),
            Some(seen) if seen.is_final() => seen.clone(),
            Some(seen) => {
                let seen = seen.clone();
                *slot = None;
                seen
            }
        };
        let adapter = self.0.adapter.to_string();
        let what = what.to_owned();
        Err(match seen {
            Fault::Lost(problem) => GpuError::Lost { adapter, problem },
            Fault::NoAnswer => GpuError::NoAnswer { adapter, seconds: LONGEST_WAIT.as_secs() },
            Fault::OutOfMemory => GpuError::OutOfMemory { adapter, what },
            Fault::Other(problem) => GpuError::Failed { adapter, what, problem },
        })
    }

    pub(super) fn failed(&self, what: &str, problem: String) -> GpuError {
        GpuError::Failed { adapter: self.0.adapter.to_string(), what: what.to_owned(), problem }
    }

    pub(super) fn opened(&self) -> &Opened {
        &self.0
    }
}

/// Whether the system shows a graphics card at all. Where it does not, drivers are not asked: they take a tenth of a
/// second to say no, and Mesa's complains on standard error of a missing desktop.
fn may_have_card() -> bool {
    // of Linux: most drivers, Nvidia's own, Windows beneath, and three of small boards
    const DEVICES: [&str; 6] =
        ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/nvmap", "/dev/kgsl-3d0", "/dev/mali0"];
    !cfg!(target_os = "linux") || DEVICES.iter().any(|path| Path::new(path).exists())
}

/// All adapters of this machine, the most powerful first.
pub fn adapters() -> Vec<Adapter> {
    find().into_iter().map(|(_, adapter)| adapter).collect()
}

/// The adapters that can run kernels, opened by none yet.
fn find() -> Vec<(wgpu::Adapter, Adapter)> {
    let description = wgpu::InstanceDescriptor {
        // the drivers' own checks are for those who write drivers
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let found = caught(|| {
        let instance = wgpu::Instance::new(description);
        pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
    });
    // a driver that cannot even be asked is no driver
    let mut found = found.unwrap_or_default();
    found.retain(|raw| {
        raw.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS)
    });
    found.sort_by_key(|raw| match raw.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
    let described = found.into_iter().map(|raw| {
        let adapter = describe(&raw.get_info());
        (raw, adapter)
    });
    described.collect()
}

fn describe(info: &wgpu::AdapterInfo) -> Adapter {
    Adapter {
        name: info.name.clone(),
        api: info.backend.to_string(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        is_software: info.device_type == wgpu::DeviceType::Cpu,
    }
}

/// What `work` gives, or the message of its panic: wgpu panics on what it has no error for, a lost card among it.
fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        text.or_else(|| panic.downcast_ref::<&str>().copied())
            .unwrap_or("the driver's library gave up")
            .trim()
            .to_owned()
    })
}

/// Whether a panic comes from the driver's library, which is caught here and told as an error.
/// For panic hooks, which see it before it is caught.
pub fn is_caught_panic(info: &std::panic::PanicHookInfo<'_>) -> bool {
    info.location().is_some_and(|location| location.file().contains("/wgpu-"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device, or `None` where the machine has no adapter, and says so.
    fn any_device() -> Option<Device> {
        let device = Device::open_for_tests().expect("an adapter that cannot be opened");
        if device.is_none() {
            assert!(std::env::var_os("REQUIRE_GPU").is_none(), "no adapter");
            eprintln!("skipped: no adapter");
        }
        device
    }

    const DOUBLE: &str = "
        @group(0) @binding(0) var<storage, read_write> values: array<u32>;
        @compute @workgroup_size(1)
        fn double(@builtin(workgroup_id) workgroup: vec3<u32>) {
            values[workgroup.x] = 2u * values[workgroup.x];
        }";

    fn doubled(device: &Device, values: &[u32]) -> Result<Vec<u32>, GpuError> {
        let [double] = device.kernels("double", DOUBLE, ["double"])?;
        let bytes = size_of_val(values) as u64;
        let mut numbers = device.buffer("numbers", BufferUse::Storage);
        let mut answer = device.buffer("answer", BufferUse::Answer);
        numbers.write(values)?;
        answer.reserve(bytes)?;
        device.submit("double", |commands| {
            commands.dispatch(&double, &[(0, &numbers)], values.len() as u32);
            commands.copy(&numbers, &answer, 0, bytes);
        })?;
        device.read(&answer, values.len(), <[u32]>::to_vec)
    }

    #[test]
    fn a_kernel_doubles_numbers() {
        let Some(device) = any_device() else { return };
        assert_eq!(doubled(&device, &[1, 2, 21]).unwrap(), [2, 4, 42]);
    }

    #[test]
    fn a_lost_device_is_an_error_and_stays_one() {
        let Some(device) = any_device() else { return };
        device.opened().device.destroy();
        for _ in 0..2 {
            let error = doubled(&device, &[1]).unwrap_err();
            assert!(matches!(error, GpuError::Lost { .. }), "{error}");
        }
    }

    #[test]
    fn a_device_lost_at_work_is_an_error() {
        let Some(device) = any_device() else { return };
        let mut answer = device.buffer("answer", BufferUse::Answer);
        answer.reserve(4).unwrap();
        device.opened().device.destroy();
        assert!(device.read(&answer, 1, <[u32]>::to_vec).is_err());
    }

    #[test]
    fn a_panic_of_the_driver_is_an_error_and_ends_the_device() {
        let Some(device) = any_device() else { return };
        let error = device.guarded("work", |_| panic!("driver bug")).unwrap_err();
        assert!(matches!(&error, GpuError::Lost { problem, .. } if problem == "driver bug"));
        assert!(matches!(doubled(&device, &[1]), Err(GpuError::Lost { .. })));
    }

    #[test]
    fn faults_that_leave_the_device_whole_are_told_once() {
        let Some(device) = any_device() else { return };
        note(&device.0.fault, Fault::OutOfMemory);
        let error = doubled(&device, &[1]).unwrap_err();
        assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
        assert_eq!(doubled(&device, &[1]).unwrap(), [2]);
        assert!(matches!(device.kernels("no WGSL", "fn", ["f"]), Err(GpuError::Failed { .. })));
        assert_eq!(doubled(&device, &[1]).unwrap(), [2]);
    }

    #[test]
    fn a_buffer_beyond_the_limits_is_an_error() {
        let Some(device) = any_device() else { return };
        let mut buffer = device.buffer("numbers", BufferUse::Storage);
        let error = buffer.reserve(device.largest_storage_bytes() + 1).unwrap_err();
        assert!(matches!(error, GpuError::TooLarge { .. }), "{error}");
    }
}
