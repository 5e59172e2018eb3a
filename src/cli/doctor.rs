//! `wildwood doctor`: what was found on this machine.

use serde_json::json;

use super::{Outcome, grow, terminal};
use crate::gpu::{self, GpuChoice};
use crate::inference::RuntimeChoice;

pub fn run(json: bool) -> Outcome {
    let threads = rayon::current_num_threads();
    let gdal = cfg!(feature = "gdal");
    let adapters = adapters();
    let runtimes = grow::runtimes(RuntimeChoice::Auto, None).found();
    let ort = runtimes.ort.as_ref().map(|path| path.display().to_string());
    if json {
        let adapters: Vec<_> = adapters
            .iter()
            .map(|(adapter, used)| {
                json!({
                    "name": adapter.name, "api": adapter.api, "driver": adapter.driver,
                    "software": adapter.is_software, "used": used,
                })
            })
            .collect();
        terminal::line(&json!({
            "version": env!("CARGO_PKG_VERSION"), "threads": threads, "gdal": gdal,
            "biomes": crate::species::Biome::BUILTIN_NAMES,
            "onnx": {"rten": runtimes.rten, "ort": ort.as_ref().ok(), "ort_problem": ort.err().map(ToString::to_string)},
            "gpu": {"built": cfg!(feature = "gpu"), "adapters": adapters},
        }));
    } else {
        terminal::say(&format!("wildwood   {}", env!("CARGO_PKG_VERSION")));
        terminal::say(&format!("threads    {threads}"));
        terminal::say(&format!("biomes     {}", crate::species::Biome::BUILTIN_NAMES.join(", ")));
        let gdal =
            if gdal { "built in" } else { "not built in (cargo build --release --features gdal)" };
        terminal::say(&format!("GDAL       {gdal}"));
        let onnx = match ort {
            Ok(library) => format!("ONNX Runtime, {library}"),
            Err(problem) => format!("{} (built in); {problem}", runtimes.rten),
        };
        terminal::say(&format!("networks   {onnx}"));
        for line in gpu_lines(&adapters) {
            terminal::say(&format!("GPU        {line}"));
        }
    }
    Ok(())
}

/// The machine's adapters, and whether each is the one that runs under `--gpu auto`.
fn adapters() -> Vec<(gpu::Adapter, bool)> {
    let device = gpu::Device::open(GpuChoice::Auto).ok().flatten();
    let mut used = device.as_ref().map(|device| device.adapter().clone());
    let all = gpu::adapters().into_iter();
    // of twin cards the first is used
    all.map(|adapter| {
        let is_used = used.take_if(|used| *used == adapter).is_some();
        (adapter, is_used)
    })
    .collect()
}

fn gpu_lines(adapters: &[(gpu::Adapter, bool)]) -> Vec<String> {
    if !cfg!(feature = "gpu") {
        return vec!["not built in (cargo build --release has it by default)".to_owned()];
    }
    if adapters.is_empty() {
        return vec!["none found; the CPU does its work".to_owned()];
    }
    let is_any_used = adapters.iter().any(|(_, used)| *used);
    let line = |(adapter, used): &(gpu::Adapter, bool)| {
        let fate = match (used, adapter.is_software) {
            (true, _) => "used",
            (false, true) => "not used: software, which the CPU's own code outruns",
            (false, false) if is_any_used => "not used: another is",
            (false, false) => "not used: it cannot be opened (--gpu require says why)",
        };
        format!("{adapter}: {fate}")
    };
    adapters.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "gpu")]
    #[test]
    fn each_adapter_is_told_its_fate() {
        let adapter = |name: &str, is_software| gpu::Adapter {
            name: name.to_owned(),
            api: "vulkan".to_owned(),
            driver: String::new(),
            is_software,
        };
        let found = [
            (adapter("A", false), true),
            (adapter("B", false), false),
            (adapter("C", true), false),
        ];
        let lines = gpu_lines(&found);
        assert_eq!(lines[0], "A (vulkan): used");
        assert_eq!(lines[1], "B (vulkan): not used: another is");
        assert!(lines[2].starts_with("C (vulkan): not used: software"));
        assert!(gpu_lines(&found[..0])[0].starts_with("none found"));
        assert!(gpu_lines(&[(adapter("D", false), false)])[0].contains("cannot be opened"));
    }

    #[test]
    fn at_most_one_adapter_is_used_and_never_software() {
        let used: Vec<_> = adapters().into_iter().filter(|(_, used)| *used).collect();
        assert!(used.len() <= 1 && used.iter().all(|(adapter, _)| !adapter.is_software));
    }
}
