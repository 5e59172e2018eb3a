//! `wildwood validate`: what comes out, beside what should.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::pipeline::{gresolet, validation};
use crate::progress::Reporter;

/// What `wildwood validate` takes.
#[derive(Args)]
pub struct ValidateArguments {
    /// Folder with heightfield.elv and scriptedEvents_full.txt of the Deadwood program (github.com/oargudo/deadwood, MIT): adds what
    /// eight centuries bring about there, undisturbed and by its script (a minute or two).
    #[arg(long, value_name = "FOLDER")]
    gresolet: Option<PathBuf>,
    /// Folder for pictures of both timelines.
    #[arg(long, value_name = "FOLDER", requires = "gresolet")]
    pictures: Option<PathBuf>,
}

pub fn run(arguments: &ValidateArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
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
