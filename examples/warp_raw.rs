//! Imports a headerless f32 raster with given place and CRS and writes it as an ESRI ASCII grid, for
//! comparison with other warpers: `warp_raw IN.f32 ROWS COLS WEST NORTH DX DY CRS CELL_M KERNEL OUT.asc`.
//! With `points CRS_FROM CRS_TO` it projects `x y` lines of its input instead.

use std::io::{BufRead, Write};
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use wildwood::progress::Reporter;
use wildwood::raster::{Affine, Crs, Projector, SourceRaster};
use wildwood::terrain::import::{self, ImportParams, Resampling};
use wildwood::terrain::mosaic::NamedRaster;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["points", from, to] => points(from, to),
        [input, rows, cols, west, north, dx, dy, crs, cell_m, kernel, output] => {
            let affine = Affine {
                origin_x: west.parse()?,
                origin_y: north.parse()?,
                col_dx: dx.parse()?,
                col_dy: 0.0,
                row_dx: 0.0,
                row_dy: dy.parse()?,
            };
            let bytes = std::fs::read(input)?;
            let words = bytes.as_chunks::<4>().0;
            let values: Vec<f32> = words.iter().map(|b| f32::from_le_bytes(*b)).collect();
            let raster = SourceRaster {
                rows: rows.parse()?,
                cols: cols.parse()?,
                affine,
                crs: Some(crs.parse()?),
                vertical_unit: None,
                latitude_deg: None,
                valid: values.iter().map(|v| *v != -9999.0).collect(),
                values,
                non_finite_cells: 0,
            };
            let resampling = match kernel {
                "auto" => Resampling::Auto,
                "bilinear" => Resampling::Bilinear,
                "bicubic" => Resampling::Bicubic,
                other => bail!("kernel {other}: give auto, bilinear or bicubic"),
            };
            let params =
                ImportParams { cell_m: cell_m.parse().ok(), resampling, ..Default::default() };
            warp(NamedRaster { path: PathBuf::from(input), raster }, &params, output)
        }
        _ => bail!("usage: see the top of examples/warp_raw.rs"),
    }
}

fn points(from: &str, to: &str) -> Result<()> {
    let projector = Projector::new(&from.parse::<Crs>()?, &to.parse::<Crs>()?)?;
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let (x, y) = line.split_once(' ').context("give `x y` lines")?;
        match projector.project([x.parse()?, y.parse()?]) {
            Some([x, y]) => println!("{x} {y}"),
            None => println!("nan nan"),
        }
    }
    Ok(())
}

fn warp(tile: NamedRaster, params: &ImportParams, output: &str) -> Result<()> {
    let reporter = Reporter::silent();
    let terrain = import::run(vec![tile], params, None, &reporter)?;
    for warning in reporter.warnings() {
        eprintln!("{warning}");
    }
    for record in reporter.records() {
        eprintln!("{}: {:.2} s", record.stage, record.seconds);
    }
    let degrees = [terrain.latitude_rad, terrain.grid_convergence_rad].map(f64::to_degrees);
    eprintln!("latitude {:.6}°, convergence {:.6}°", degrees[0], degrees[1]);
    let grid = &terrain.elevation_m;
    let (frame, t) = (grid.frame(), grid.frame().transform);
    eprintln!("{} {} × {} cells of {} m", frame.crs, frame.rows, frame.cols, t.cell_m);
    let mut out = std::io::BufWriter::new(std::fs::File::create(output)?);
    let south_m = t.north_m - frame.rows as f64 * t.cell_m;
    writeln!(out, "ncols {}\nnrows {}\nxllcorner {}", frame.cols, frame.rows, t.west_m)?;
    writeln!(out, "yllcorner {south_m}\ncellsize {}\nNODATA_value -9999", t.cell_m)?;
    for row in 0..frame.rows {
        let valid = &grid.mask().as_slice()[row * frame.cols..][..frame.cols];
        let line: Vec<String> = grid
            .row(row)
            .iter()
            .zip(valid)
            .map(|(v, valid)| if *valid { v.to_string() } else { "-9999".to_owned() })
            .collect();
        writeln!(out, "{}", line.join(" "))?;
    }
    Ok(out.flush()?)
}
