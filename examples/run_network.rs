//! Runs one of the built-in networks over maps from a file: what a program of your own would do, and how tests compare
//! runtimes.
//!
//! `run_network footprint|height rten|LIBRARY ROWS COLS IN OUT`: IN holds the conditions, channel by channel, then the
//! noise, OUT gets heights in metres; all f32, little-endian, row-major.

use wildwood::inference::{
    LibrarySearch, MapPlanes, Model, ModelSource, RuntimeChoice, Runtimes, TileLayout,
};
use wildwood::progress::Reporter;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, runtime, rows, cols, from, to] = &arguments[..] else {
        return Err("give footprint|height rten|LIBRARY ROWS COLS IN OUT".into());
    };
    let terrain = ["relief", "gradient_east", "gradient_north", "stand_height"];
    let (name, first): (&'static str, &[&str]) = match name.as_str() {
        "footprint" => ("footprint", &["sketch_empty", "sketch_sparse", "sketch_dense"]),
        _ => ("height", &["footprint"]),
    };
    let channels = [first, &terrain].concat();
    let model = Model::load(&ModelSource::BuiltIn, name, &channels)?;
    let runtimes = match runtime.as_str() {
        "rten" => Runtimes { choice: RuntimeChoice::Rten, ..Runtimes::default() },
        library => Runtimes {
            choice: RuntimeChoice::Ort,
            search: LibrarySearch { named: Some(library.into()), ..LibrarySearch::default() },
        },
    };
    let network = runtimes.open(&model, |text| eprintln!("{text}"))?;

    let (rows, cols): (usize, usize) = (rows.parse()?, cols.parse()?);
    let numbers: Vec<f32> = std::fs::read(from)?
        .chunks_exact(4)
        .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
        .collect();
    let mut planes: Vec<&[f32]> = numbers.chunks_exact(rows * cols).collect();
    let noise = planes.pop().ok_or("the file holds no maps")?;
    let maps = MapPlanes { rows, cols, first_south: 0, first_east: 0, planes };
    let inside = |at: i64, cells: usize| usize::try_from(at).unwrap_or(0).min(cells - 1);
    let noise = |south, east| noise[inside(south, rows) * cols + inside(east, cols)];
    let layout = TileLayout { rows: 64, cols: 96 };
    let heights_m = network.run(&maps, noise, layout, "network", &Reporter::silent())?;
    std::fs::write(to, heights_m.iter().flat_map(|m| m.to_le_bytes()).collect::<Vec<u8>>())?;
    Ok(())
}
