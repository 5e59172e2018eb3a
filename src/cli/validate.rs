//! `wildwood validate`: what comes out, beside what should.

use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::pipeline::validation;
use crate::progress::Reporter;

pub fn run(shared: &Shared, reporter: &Reporter) -> Outcome {
    let findings = validation::run(reporter)?;
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
