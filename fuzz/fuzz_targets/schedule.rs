//! Any text through the reader of scripts, TOML and the authors' numbers: a schedule or an error, never a panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use wildwood::simulation::disturbance::schedule;

fuzz_target!(|text: &str| {
    let keys = ["silver-fir", "mountain-pine", "european-beech"].map(str::to_owned);
    match schedule::parse(text, &keys) {
        Ok(script) => {
            let events = schedule::drawn(&script, 50, 1);
            assert!(events.is_sorted_by_key(|event| (event.year, event.month)));
        }
        Err(error) => assert!(error.line().is_none_or(|line| line >= 1), "{error}"),
    }
});
