//! Windows and mosaics: a part has the cells of the whole, and tiles with nothing to give spoil nothing.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use wildwood::io::geotiff::{Band, CogBands, CogOptions, StoredBands, write_cog};
use wildwood::pipeline::import::{ImportRequest, read_terrain};
use wildwood::progress::Reporter;
use wildwood::raster::{Crs, Frame, GeoTransform, Grid, LengthUnit, MapWindow, Mask};

const SIZE: usize = 60;

/// A rough tile of 60 × 60 cells of a metre with a spike and a hole, or with no height at all.
fn write_tile(path: &Path, west_m: f64, crs: Crs, is_empty: bool) {
    let transform = GeoTransform { west_m, north_m: 5_100_000.0, cell_m: 1.0 };
    let frame = Frame { rows: SIZE, cols: SIZE, transform, crs };
    let height = |i: usize| 500.0 + (i * 7919 % 101) as f32 * 0.05 + (i / SIZE) as f32;
    let mut values: Vec<f32> = (0..SIZE * SIZE).map(height).collect();
    values[20 * SIZE + 20] += 90.0;
    let valid: Vec<bool> = (0..SIZE * SIZE)
        .map(|i| !(is_empty || (18..23).contains(&(i / SIZE)) && (27..31).contains(&(i % SIZE))))
        .collect();
    let bands = [Band { name: "elevation".to_owned(), unit: "m".to_owned() }];
    let source = StoredBands::new(&frame, vec![&values]);
    let mask = Mask::new(valid);
    let raster = CogBands { frame: &frame, mask: &mask, bands: &bands, source: &source };
    let file = BufWriter::new(File::create(path).unwrap());
    write_cog(file, &raster, &CogOptions::default()).unwrap();
}

fn import(
    inputs: &[PathBuf],
    change: impl Fn(&mut ImportRequest),
) -> Result<Grid<f32>, wildwood::pipeline::Error> {
    let mut request = ImportRequest::new(inputs.to_vec(), PathBuf::from("unused"));
    change(&mut request);
    read_terrain(&request, &Reporter::silent()).map(|read| read.terrain.elevation_m)
}

fn utm() -> Crs {
    Crs::Epsg(32633)
}

#[test]
fn issue_2_a_window_has_the_cells_of_the_whole() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("a.tif");
    write_tile(&path, 500_000.0, utm(), false);
    // beside the spike, through the hole, off the cells' lines
    let bbox =
        MapWindow { west: 500_020.7, south: 5_099_955.2, east: 500_045.3, north: 5_099_979.6 };
    for cell_m in [None, Some(1.0), Some(2.5), Some(0.7), Some(4.0)] {
        let part = import(std::slice::from_ref(&path), |request| {
            request.terrain.bbox = Some(bbox);
            request.terrain.cell_m = cell_m;
        })
        .unwrap();
        let whole =
            import(std::slice::from_ref(&path), |request| request.terrain.cell_m = cell_m).unwrap();
        let (p, w) = (part.frame(), whole.frame());
        let cell_m = p.transform.cell_m;
        let first_col = ((p.transform.west_m - w.transform.west_m) / cell_m).round() as usize;
        let first_row = ((w.transform.north_m - p.transform.north_m) / cell_m).round() as usize;
        assert!(p.rows > 4 && p.cols > 4 && p.rows < w.rows);
        let mut compared = 0;
        for row in 0..p.rows {
            for col in 0..p.cols {
                let i = row * p.cols + col;
                let j = (row + first_row) * w.cols + col + first_col;
                // holes are filled from the rim that the scene has: one at its edge stays
                if part.mask().is_valid(i)
                    && whole.mask().is_valid(j)
                    && !near_hole(row + first_row, col + first_col, cell_m)
                {
                    assert_eq!(part.values()[i].to_bits(), whole.values()[j].to_bits());
                    compared += 1;
                }
            }
        }
        assert!(compared > p.len() / 2, "{compared} of {}", p.len());
    }
}

fn near_hole(row: usize, col: usize, cell_m: f64) -> bool {
    let near = |cell: usize, from: f64, to: f64| {
        let at = (cell as f64 + 0.5) * cell_m;
        (from - 4.0..to + 4.0).contains(&at)
    };
    near(row, 18.0, 23.0) && near(col, 27.0, 31.0)
}

#[test]
fn issue_2_tiles_that_give_nothing_are_left_out() {
    let home = tempfile::tempdir().unwrap();
    let [near, far, empty] = ["near.tif", "far.tif", "empty.tif"].map(|n| home.path().join(n));
    write_tile(&near, 500_000.0, utm(), false);
    write_tile(&far, 500_500.0, utm(), false);
    write_tile(&empty, 500_060.0, utm(), true);
    let bbox =
        MapWindow { west: 500_005.0, south: 5_099_950.0, east: 500_015.0, north: 5_099_990.0 };
    let both = [far.clone(), near.clone(), empty.clone()];
    let terrain = import(&both, |request| request.terrain.bbox = Some(bbox)).unwrap();
    assert_eq!((terrain.frame().rows, terrain.frame().cols), (40, 10));
    let terrain = import(&[empty.clone(), near], |_| {}).unwrap();
    assert_eq!(terrain.frame().cols, SIZE);
    // where none gives anything, the first says so
    let missed = import(&[far, empty.clone()], |request| request.terrain.bbox = Some(bbox));
    assert!(missed.unwrap_err().to_string().contains("far.tif"));
    assert!(import(&[empty], |_| {}).unwrap_err().to_string().contains("no valid cell"));
}

#[test]
fn issue_2_windows_of_local_feet_are_metres() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("feet.tif");
    write_tile(&path, 0.0, Crs::Local, false);
    let north = 5_100_000.0 * 0.3048;
    let bbox = MapWindow { west: 3.048, south: north - 9.144, east: 15.24, north };
    let terrain = import(&[path], |request| {
        request.terrain.bbox = Some(bbox);
        request.terrain.horizontal_unit = Some(LengthUnit::Foot);
    })
    .unwrap();
    assert_eq!((terrain.frame().rows, terrain.frame().cols), (30, 40));
}
