//! How a run shows itself: a progress bar on a terminal, plain lines otherwise, JSON lines for machines.

use std::io::{IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::progress::{Event, Sink};

/// The sink for this process's standard error and output.
pub fn sink(json: bool, quiet: bool) -> Box<dyn Sink> {
    match (json, quiet) {
        (true, _) => Box::new(JsonLines { quiet }),
        (false, true) => Box::new(Quiet),
        (false, false) if std::io::stderr().is_terminal() => Box::new(Bars::default()),
        (false, false) => Box::new(PlainLines),
    }
}

/// Tells why the run failed: on standard error, and as a JSON line where asked.
pub fn fail(json: bool, error: &dyn std::error::Error, exit_code: u8) {
    if json {
        line(&json!({"event": "error", "message": error.to_string(), "exit_code": exit_code}));
    }
    let _ = writeln!(std::io::stderr(), "error: {error}");
}

/// Prints one JSON object on a line of standard output.
pub fn line(value: &serde_json::Value) {
    // a reader that went away is no reason to panic
    let _ = writeln!(std::io::stdout(), "{value}");
}

/// Prints a line of text on standard output.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

struct Quiet;
impl Sink for Quiet {
    fn event(&self, _: &Event<'_>) {}
}

struct JsonLines {
    quiet: bool,
}

impl Sink for JsonLines {
    fn event(&self, event: &Event<'_>) {
        match event {
            _ if self.quiet => {}
            Event::StageFinished(record) => {
                let mut value = json!(record);
                value["event"] = json!("stage");
                line(&value);
            }
            Event::Warned(warning) => {
                line(&json!({"event": "warning", "message": warning.to_string()}));
            }
            _ => {}
        }
    }
}

struct PlainLines;
impl Sink for PlainLines {
    fn event(&self, event: &Event<'_>) {
        let mut err = std::io::stderr();
        let _ = match event {
            Event::StageFinished(r) => writeln!(err, "{:<12} {:8.2} s", r.stage, r.seconds),
            Event::Warned(warning) => writeln!(err, "warning: {warning}"),
            _ => Ok(()),
        };
    }
}

/// One bar a running stage.
#[derive(Default)]
struct Bars {
    running: Mutex<Vec<(&'static str, ProgressBar)>>,
}

impl Sink for Bars {
    fn event(&self, event: &Event<'_>) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::StageStarted { stage, total } => {
                let bar = ProgressBar::new(*total);
                if let Ok(style) =
                    ProgressStyle::with_template("{prefix:<12} {bar:30} {percent:>3} %  {elapsed}")
                {
                    bar.set_style(style);
                }
                bar.set_prefix(*stage);
                running.push((stage, bar));
            }
            Event::Advanced { stage, done, .. } => {
                if let Some((_, bar)) = running.iter().find(|(name, _)| name == stage) {
                    bar.set_position(*done);
                }
            }
            Event::StageFinished(record) => {
                if let Some(at) = running.iter().position(|(name, _)| *name == record.stage) {
                    let (_, bar) = running.remove(at);
                    bar.finish_and_clear();
                    let _ = writeln!(
                        std::io::stderr(),
                        "{:<12} {:8.2} s",
                        record.stage,
                        record.seconds
                    );
                }
            }
            Event::Warned(warning) => {
                let text = format!("warning: {warning}");
                match running.last() {
                    Some((_, bar)) => bar.suspend(|| {
                        let _ = writeln!(std::io::stderr(), "{text}");
                    }),
                    None => {
                        let _ = writeln!(std::io::stderr(), "{text}");
                    }
                }
            }
        }
    }
}
