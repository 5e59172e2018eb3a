//! How long work tells what it is doing: stages with progress, timings, peak memory, typed warnings, cancel.
//!
//! Library code reports to a [`Reporter`] and knows nothing of terminals; a [`Sink`] shows the events.

use std::fmt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Recoverable trouble: the run goes on, and the user should know.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Warning {
    /// The input names no coordinate reference system: local metres are assumed.
    NoCrs { path: PathBuf },
    /// Horizontal units are feet and the file is silent on the vertical unit: feet are assumed.
    VerticalUnitAssumedFeet { path: PathBuf },
    /// The input lay in another CRS and was resampled into a metric one.
    Warped { path: PathBuf, from: String, to: String },
    /// Cells with NaN or infinite heights, treated as nodata.
    NonFiniteCells { path: PathBuf, cells: usize },
    /// Cells with a value that programs use for nodata, though the file does not declare it.
    UndeclaredNodata { path: PathBuf, cells: usize },
    /// Heights that no forest can stand at, treated as nodata.
    ImplausibleHeights { path: PathBuf, cells: usize, lowest_m: f32, highest_m: f32 },
    /// The file names a CRS in a way that is not understood.
    CrsNotUnderstood { path: PathBuf, problem: String },
    /// Small holes filled from their rims.
    HolesFilled { cells: usize },
    /// Large voids (sea, lakes, tile edges) kept masked.
    VoidsKept { cells: usize },
    /// Isolated heights far above or below their surroundings, replaced.
    SpikesRemoved { cells: usize },
    /// The climate was measured far from the scene.
    ClimateFromElsewhere { climate_latitude_deg: f64, scene_latitude_deg: f64 },
    /// The user's CRS stands in place of the file's.
    CrsOverridden { path: PathBuf, file: String, given: String },
    /// No CRS to take the latitude from: the climate's is used.
    LatitudeFromClimate { latitude_deg: f64 },
    /// Cells where tiles overlap and disagree by more than a metre.
    TilesDisagree { cells: usize },
    /// Points of a cloud brought from another CRS into a metric one.
    Projected { path: PathBuf, from: String, to: String },
    /// The datum's shift grid is not at hand.
    ShiftGridMissing { crs: String },
    /// Points that the cloud itself marks as withheld or noise, left out.
    PointsDropped { points: u64 },
    /// Ground points far above or below their surroundings, left out.
    GroundOutliers { points: usize },
    /// Returns higher above ground than any tree, left out.
    ReturnsTooHigh { returns: u64, max_height_m: f32 },
    /// Returns from buildings, wires and bridges: no canopy.
    BuiltReturns { returns: u64 },
    /// Anything a stage must say that has no variant yet.
    Other { text: String },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoCrs { path } => write!(
                f,
                "{}: no coordinate reference system; taking coordinates as local metres (give --crs EPSG:n if you know it)",
                path.display()
            ),
            Self::VerticalUnitAssumedFeet { path } => write!(
                f,
                "{}: horizontal unit is feet, vertical unit not stated; taking heights as feet (give --vertical-unit m if they are metres)",
                path.display()
            ),
            Self::Warped { path, from, to } => {
                write!(f, "{}: resampled from {from} to {to}", path.display())
            }
            Self::NonFiniteCells { path, cells } => write!(
                f,
                "{}: {cells} cells are NaN or infinite; treated as nodata",
                path.display()
            ),
            Self::UndeclaredNodata { path, cells } => write!(
                f,
                "{}: {cells} cells hold −9999 or another usual mark of nodata, which the file does not declare; treated as nodata",
                path.display()
            ),
            Self::ImplausibleHeights { path, cells, lowest_m, highest_m } => write!(
                f,
                "{}: {cells} heights outside −500…9,000 m (lowest {lowest_m} m, highest {highest_m} m); treated as nodata",
                path.display()
            ),
            Self::CrsNotUnderstood { path, problem } => {
                write!(f, "{}: {problem}", path.display())
            }
            Self::HolesFilled { cells } => write!(f, "filled small holes: {cells} cells"),
            Self::VoidsKept { cells } => {
                write!(f, "large voids stay masked: {cells} cells (sea, lakes, tile edges)")
            }
            Self::SpikesRemoved { cells } => write!(f, "replaced spikes and pits: {cells} cells"),
            Self::ClimateFromElsewhere { climate_latitude_deg, scene_latitude_deg } => write!(
                f,
                "the scene lies at {scene_latitude_deg:.1}° latitude, its climate was measured at {climate_latitude_deg:.1}°: temperature, rain and clouds are of another place (give --biome or --climate FILE)"
            ),
            Self::CrsOverridden { path, file, given } => {
                write!(f, "{}: names {file}; using {given} as told", path.display())
            }
            Self::LatitudeFromClimate { latitude_deg } => write!(
                f,
                "latitude unknown; using the climate's {latitude_deg:.2}° (give --latitude to change it)"
            ),
            Self::TilesDisagree { cells } => write!(
                f,
                "tiles overlap and differ by more than 1 m in {cells} cells; the first tile named wins"
            ),
            Self::Projected { path, from, to } => {
                write!(f, "{}: points brought from {from} to {to}", path.display())
            }
            Self::ShiftGridMissing { crs } => write!(
                f,
                "{crs}: datum shift without its grid; the scene's place may be off by up to 30 m"
            ),
            Self::PointsDropped { points } => {
                write!(f, "left out {points} points marked as withheld or noise")
            }
            Self::GroundOutliers { points } => {
                write!(f, "left out {points} ground points far above or below their surroundings")
            }
            Self::ReturnsTooHigh { returns, max_height_m } => {
                write!(f, "left out {returns} returns more than {max_height_m} m above ground")
            }
            Self::BuiltReturns { returns } => write!(
                f,
                "{returns} returns from buildings, wires and bridges do not count as canopy"
            ),
            Self::Other { text } => f.write_str(text),
        }
    }
}

/// What one finished stage took.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StageRecord {
    /// The stage's name, e.g. `sunlight`.
    pub stage: &'static str,
    /// Wall time.
    pub seconds: f64,
    /// Units of work done (rows, cells, points …).
    pub count: u64,
    /// The process's peak resident memory when the stage ended, where the system tells it.
    pub peak_memory_mib: Option<f64>,
}

/// What a [`Sink`] is told.
#[derive(Debug)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the variants tell what the fields are")]
pub enum Event<'a> {
    /// A stage began; `total` units of work lie ahead.
    StageStarted { stage: &'static str, total: u64 },
    /// `done` of `total` units are done.
    Advanced { stage: &'static str, done: u64, total: u64 },
    /// A stage ended.
    StageFinished(&'a StageRecord),
    /// Recoverable trouble.
    Warned(&'a Warning),
}

/// Shows events to somebody: a terminal, a JSON stream, a window.
pub trait Sink: Send + Sync {
    /// Called from any thread; must be quick.
    fn event(&self, event: &Event<'_>);
}

struct Silence;
impl Sink for Silence {
    fn event(&self, _: &Event<'_>) {}
}

/// The run was cancelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Where stages report to. Shared by reference; all methods are thread-safe.
pub struct Reporter {
    sink: Box<dyn Sink>,
    cancelled: Arc<AtomicBool>,
    records: Mutex<Vec<StageRecord>>,
    warnings: Mutex<Vec<Warning>>,
}

impl Reporter {
    /// Reports to `sink`; setting `cancelled` stops the run at its next check.
    pub fn new(sink: Box<dyn Sink>, cancelled: Arc<AtomicBool>) -> Self {
        Self { sink, cancelled, records: Mutex::default(), warnings: Mutex::default() }
    }

    /// Keeps records and warnings, shows nothing.
    pub fn silent() -> Self {
        Self::new(Box::new(Silence), Arc::default())
    }

    /// A silent reporter that is cancelled with this one.
    pub fn silenced(&self) -> Self {
        Self::new(Box::new(Silence), Arc::clone(&self.cancelled))
    }

    /// Begins a stage of `total` units of work; it ends when the handle is dropped.
    pub fn stage(&self, stage: &'static str, total: u64) -> Stage<'_> {
        self.sink.event(&Event::StageStarted { stage, total });
        Stage { reporter: self, stage, total, done: AtomicU64::new(0), started: Instant::now() }
    }

    /// Tells and keeps a warning.
    pub fn warn(&self, warning: Warning) {
        self.sink.event(&Event::Warned(&warning));
        lock(&self.warnings).push(warning);
    }

    /// # Errors
    /// [`Cancelled`] once the run was cancelled.
    pub fn check_cancelled(&self) -> Result<(), Cancelled> {
        if self.cancelled.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) }
    }

    /// The finished stages so far, in the order they ended.
    pub fn records(&self) -> Vec<StageRecord> {
        lock(&self.records).clone()
    }

    /// The warnings so far.
    pub fn warnings(&self) -> Vec<Warning> {
        lock(&self.warnings).clone()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A stage under way.
pub struct Stage<'a> {
    reporter: &'a Reporter,
    stage: &'static str,
    total: u64,
    done: AtomicU64,
    started: Instant,
}

impl Stage<'_> {
    /// `units` more units of work are done.
    pub fn advance(&self, units: u64) {
        let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
        self.reporter.sink.event(&Event::Advanced { stage: self.stage, done, total: self.total });
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        let record = StageRecord {
            stage: self.stage,
            seconds: self.started.elapsed().as_secs_f64(),
            count: self.done.load(Ordering::Relaxed),
            peak_memory_mib: peak_memory_mib(),
        };
        self.reporter.sink.event(&Event::StageFinished(&record));
        lock(&self.reporter.records).push(record);
    }
}

/// The process's peak resident memory in MiB, where the system tells it (Linux).
pub fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

/// Starts [`peak_memory_mib`] anew from the memory resident now, where the system lets it (Linux).
pub fn reset_peak_memory() {
    let _ = std::fs::write("/proc/self/clear_refs", "5"); // elsewhere the peak stays that of the whole process
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_recorded_with_their_counts() {
        let reporter = Reporter::silent();
        {
            let stage = reporter.stage("slope", 3);
            stage.advance(2);
            stage.advance(1);
        }
        let records = reporter.records();
        assert_eq!((records[0].stage, records[0].count), ("slope", 3));
    }

    #[test]
    fn cancelling_is_seen() {
        let flag = Arc::new(AtomicBool::new(false));
        let reporter = Reporter::new(Box::new(Silence), Arc::clone(&flag));
        assert_eq!(reporter.check_cancelled(), Ok(()));
        flag.store(true, Ordering::Relaxed);
        assert_eq!(reporter.check_cancelled(), Err(Cancelled));
    }

    #[test]
    fn warnings_are_kept() {
        let reporter = Reporter::silent();
        reporter.warn(Warning::HolesFilled { cells: 4 });
        assert_eq!(reporter.warnings(), [Warning::HolesFilled { cells: 4 }]);
    }
}
