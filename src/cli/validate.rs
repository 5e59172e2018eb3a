//! `wildwood validate`: what comes out, beside what should.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::export::report;
use crate::pipeline::{gresolet, scene_report, validation};
use crate::progress::Reporter;

/// What `wildwood validate` takes.
#[derive(Args)]
pub struct ValidateArguments {
    /// Scene folder to report on: figures of its stand beside what is expected of them, with plots, in report.html. Without it the
    /// simulation itself is validated.
    #[arg(value_name = "FOLDER", conflicts_with_all = ["gresolet", "pictures"])]
    folder: Option<PathBuf>,
    /// Where the report goes [default: report.html in the scene folder].
    #[arg(long, short, value_name = "FILE", requires = "folder")]
    output: Option<PathBuf>,
    /// Folder with heightfield.elv and scriptedEvents_full.txt of the Deadwood program (github.com/oargudo/deadwood, MIT): adds what
    /// eight centuries bring about there, undisturbed and by its script (a minute or two).
    #[arg(long, value_name = "FOLDER")]
    gresolet: Option<PathBuf>,
    /// Folder for pictures of both timelines.
    #[arg(long, value_name = "FOLDER", requires = "gresolet")]
    pictures: Option<PathBuf>,
}

pub fn run(arguments: &ValidateArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    if let Some(folder) = &arguments.folder {
        return report_on(folder, arguments.output.as_deref(), shared, reporter);
    }
    let mut findings = Vec::new();
    if let Some(data) = &arguments.gresolet {
        findings = gresolet::run(data, arguments.pictures.as_ref(), reporter)?;
    }
    findings.splice(0..0, validation::run(reporter)?);
    for finding in &findings {
        if shared.json {
            let mut line = json!(finding);
            line["is_right"] = finding.is_right().into();
            terminal::line(&line);
        } else if !shared.quiet {
            let range = if finding.high.is_finite() {
                format!("{} … {}", finding.low, finding.high)
            } else {
                format!("{} or more", finding.low)
            };
            let mark = if finding.is_right() { "ok  " } else { "MISS" };
            terminal::say(&format!("{mark} {:.3} ({range})  {}", finding.value, finding.name));
        }
    }
    let missed = findings.iter().filter(|finding| !finding.is_right()).count();
    if !shared.json && !shared.quiet {
        terminal::say(&format!("{missed} of {} figures are out of range", findings.len()));
    }
    Ok(())
}

fn report_on(
    folder: &Path,
    output: Option<&Path>,
    shared: &Shared,
    reporter: &Reporter,
) -> Outcome {
    let (figures, path) = scene_report::run(folder, output, reporter)?;
    if shared.json {
        for figure in &figures {
            terminal::line(&json!({
                "section": figure.section,
                "name": figure.name,
                "value": figure.value,
                "unit": figure.unit,
                "expected": figure.expected,
                "is_expected": figure.is_expected(),
                "source": figure.source,
            }));
        }
        terminal::line(&json!({ "event": "done", "file": path }));
    } else if !shared.quiet {
        for figure in &figures {
            let mark = match figure.is_expected() {
                Some(true) => "ok  ",
                Some(false) => "OUT ",
                None => "    ",
            };
            let expected = figure.expected.map_or(String::new(), |range| {
                format!(" (expected {})", report::range_text(range))
            });
            let unit = if figure.unit.is_empty() { "" } else { " " };
            terminal::say(&format!(
                "{mark}{}: {}{unit}{}{expected}",
                figure.name,
                report::short(figure.value),
                figure.unit
            ));
        }
        terminal::say(&format!("open {}", path.display()));
    }
    Ok(())
}
