//! Rasters as files hold them become terrain: metric, north-up, square cells, voids handled.
//!
//! Order: units and plausible heights, tile by tile ([`heights`]); the scene's CRS and grid
//! ([`framing`](super::framing)); tiles joined ([`mosaic`](super::mosaic)), spikes replaced ([`spikes`](super::spikes)), put onto the
//! grid by copying or resampling; holes filled ([`voids`]); latitude and true north.

use std::path::PathBuf;
use std::sync::Arc;

use super::framing::{CellLattice, Lattice, Placement};
use super::mosaic::NamedRaster;
use super::{Terrain, heights, onto_frame, point_cloud, voids};
use crate::progress::{Cancelled, Reporter, Warning};
use crate::raster::warp::nearest_turn;
use crate::raster::{
    Crs, CrsError, CrsProblem, Frame, Grid, LengthUnit, MapWindow, Mask, Projection,
};

/// How heights are drawn where the scene's cells are not the file's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Resampling {
    /// Area average where cells grow by more than half, else bicubic.
    #[default]
    Auto,
    /// Bilinear, whatever the cells; coarser cells alias.
    Bilinear,
    /// Bicubic, whatever the cells; coarser cells alias.
    Bicubic,
}

/// How rasters are imported.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ImportParams {
    /// The CRS of the files' coordinates, in place of what they name; moves nothing.
    pub crs: Option<Crs>,
    /// The unit of coordinates without a CRS; metres if not given.
    pub horizontal_unit: Option<LengthUnit>,
    /// The unit of heights, in place of what the files name.
    pub vertical_unit: Option<LengthUnit>,
    /// The part to import, in the scene's CRS: the file's own where it is metric, else the local UTM zone.
    pub bbox: Option<MapWindow>,
    /// Width of the scene's cells, metres; the file's if not given.
    pub cell_m: Option<f64>,
    /// Latitude where no CRS tells it, degrees north.
    pub latitude_deg: Option<f64>,
    /// Inner holes up to this area are filled, m²; 0 fills none.
    pub fill_holes_up_to_m2: f64,
    /// How heights are drawn where cells differ.
    pub resampling: Resampling,
    /// Whether single cells far off all their neighbours are replaced.
    pub remove_spikes: bool,
    /// Most cells of the scene, and of tiles joined.
    pub max_cells: usize,
}

impl Default for ImportParams {
    fn default() -> Self {
        Self {
            crs: None,
            horizontal_unit: None,
            vertical_unit: None,
            bbox: None,
            cell_m: None,
            latitude_deg: None,
            fill_holes_up_to_m2: voids::HOLE_MAX_AREA_M2,
            resampling: Resampling::Auto,
            remove_spikes: true,
            max_cells: crate::io::Limits::default().max_cells,
        }
    }
}

/// Why rasters did not become terrain.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum ImportError {
    /// Nothing was given.
    #[error("no raster given; name at least one elevation file")]
    NoTiles,
    /// A parameter makes no sense.
    #[error("{name} {value}: {problem}")]
    Parameter { name: &'static str, value: String, problem: &'static str },
    /// Tiles lie in different systems.
    #[error(
        "{first} is in {first_crs}, {second} in {second_crs}; give tiles of one CRS, or reproject one (gdalwarp -t_srs EPSG:n in.tif out.tif)",
        first = first.display(), second = second.display()
    )]
    MixedCrs { first: PathBuf, first_crs: String, second: PathBuf, second_crs: String },
    /// The file names a CRS in a way that is not understood.
    #[error("{path}: {problem}", path = path.display())]
    CrsNotUnderstood { path: PathBuf, problem: String },
    /// The CRS cannot be used.
    #[error("{path}: {source}", path = path.display())]
    Crs { path: PathBuf, source: CrsError },
    /// The header's map position cannot be used.
    #[error("{path}: {problem}; mend its header, or write it anew with gdal_translate -a_ullr", path = path.display())]
    Georeference { path: PathBuf, problem: &'static str },
    /// Part of the raster lies outside its CRS.
    #[error("{path}: part of it does not lie where {crs} is defined; is the CRS right?", path = path.display())]
    OutsideCrs { path: PathBuf, crs: String },
    /// Degrees taken for metres, or no terrain at all.
    #[error(
        "{path}: cells of {cell_m} m are no terrain (0.05–1000 m); if its coordinates are degrees or feet, give --crs EPSG:n, else --cell METRES",
        path = path.display()
    )]
    CellSize { path: PathBuf, cell_m: f64 },
    /// No cell has a height.
    #[error("{path}: every cell is nodata; is it the right band and nodata value?", path = path.display())]
    NoData { path: PathBuf },
    /// Heights are not of this Earth.
    #[error(
        "{path}: {cells} heights lie outside −500…9,000 m (lowest {lowest_m} m, highest {highest_m} m); is the unit right (--vertical-unit), is a nodata value undeclared?",
        path = path.display()
    )]
    Heights { path: PathBuf, cells: usize, lowest_m: f32, highest_m: f32 },
    /// The window misses the data.
    #[error("window {bbox} misses the data, which covers {data} (west,south,east,north in {crs})")]
    Outside { bbox: MapWindow, data: MapWindow, crs: String },
    /// Tiles with nothing but emptiness between them.
    #[error(
        "{first} and {second} are {distance_km:.0} km apart: one grid over all tiles would be 99 % empty; import them one by one",
        first = first.display(), second = second.display()
    )]
    TilesFarApart { first: PathBuf, second: PathBuf, distance_km: f64 },
    /// The grid would be too large.
    #[error(
        "{rows} × {cols} cells are more than {max_cells}; give a window (--bbox) or wider cells (--cell)"
    )]
    TooManyCells { rows: f64, cols: f64, max_cells: usize },
    /// The grid would be too small.
    #[error(
        "{path}: {rows} × {cols} cells, {valid_cells} of them with heights: too few to be terrain (4 × 4); give a larger raster, a wider window (--bbox) or narrower cells (--cell)",
        path = path.display()
    )]
    TooFewCells { path: PathBuf, rows: usize, cols: usize, valid_cells: usize },
    /// Nothing tells the latitude.
    #[error(
        "nothing tells the latitude, which the sun's path needs; give --latitude DEGREES or --crs EPSG:n"
    )]
    NoLatitude,
    /// A point cloud gives no surfaces.
    #[error("{path}: {source}", path = path.display())]
    Cloud { path: PathBuf, source: point_cloud::Error },
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Cell widths that can be terrain, metres; chosen: dense LiDAR to the coarsest global models.
const PLAUSIBLE_CELL_M: std::ops::RangeInclusive<f64> = 0.05..=1000.0;
/// Rows and columns, and the root of valid cells, that terrain has at least: slope needs neighbours.
const LEAST_SIDE: usize = 4;
/// Tiles lie too far apart where one grid over them has so many times their area; chosen: a hundred
/// tiles along a diagonal, as of a river, still pass.
const EMPTINESS_FACTOR: f64 = 100.0;

/// Terrain of one or several rasters of elevation.
///
/// `climate_latitude_deg` serves where neither CRS, parameters nor files tell the latitude.
/// Rasters that are metric, north-up and square already keep their bits.
///
/// # Errors
/// [`ImportError`] tells what is wrong with which tile, and what to do.
pub fn run(
    tiles: Vec<NamedRaster>,
    params: &ImportParams,
    climate_latitude_deg: Option<f64>,
    reporter: &Reporter,
) -> Result<Terrain, ImportError> {
    check_params(params)?;
    let crs = common_crs(&tiles, params, reporter)?;
    let file_latitude_deg = tiles.iter().find_map(|tile| tile.raster.latitude_deg);
    let mut tiles = heights::in_metres(tiles, &crs, params, reporter)?;
    if Projection::new(&crs).is_ok_and(|projection| projection.is_geographic()) {
        count_longitudes_alike(&mut tiles);
    }

    // Where the scene lies
    let first = tiles.first().ok_or(ImportError::NoTiles)?;
    let crs_error = |path: &PathBuf| {
        let path = path.clone();
        move |source| ImportError::Crs { path, source }
    };
    let placement = Placement::new(&crs, middle_of(&tiles)).map_err(crs_error(&first.path))?;
    let (tiles, frame) = scene_frame(tiles, &crs, &placement, params)?;
    let first_path = tiles[0].path.clone();
    if placement.to_scene.is_some() {
        let (from, to) = (crs.to_string(), placement.crs.to_string());
        reporter.warn(Warning::Warped { path: first_path.clone(), from, to });
        if Projection::new(&crs).is_ok_and(|projection| projection.lacks_shift_grid()) {
            let text = format!(
                "{crs}: datum shift without its grid; the scene's place may be off by up to 30 m"
            );
            reporter.warn(Warning::Other { text });
        }
    }

    // Onto the grid
    let mut warped = onto_frame::on_frame(tiles, &placement, &frame, params, reporter)?;
    let counts = voids::fill_holes(
        frame.cols,
        frame.transform.cell_m,
        params.fill_holes_up_to_m2,
        &mut warped.values,
        &mut warped.valid,
        reporter,
    )?;
    if counts.filled_cells > 0 {
        reporter.warn(Warning::HolesFilled { cells: counts.filled_cells });
    }
    if counts.kept_cells > 0 {
        reporter.warn(Warning::VoidsKept { cells: counts.kept_cells });
    }
    let mask = Mask::new(warped.valid);
    let too_small = frame.rows.min(frame.cols) < LEAST_SIDE;
    if too_small || mask.valid_count() < LEAST_SIDE * LEAST_SIDE {
        let (rows, cols, valid_cells) = (frame.rows, frame.cols, mask.valid_count());
        return Err(ImportError::TooFewCells { path: first_path, rows, cols, valid_cells });
    }

    // Latitude and true north
    let middle = [frame.middle().east_m, frame.middle().north_m];
    let (latitude_deg, grid_convergence_rad) = if frame.crs == Crs::Local {
        let known = params.latitude_deg.or(file_latitude_deg);
        let latitude_deg = known.or(climate_latitude_deg).ok_or(ImportError::NoLatitude)?;
        if known.is_none() {
            reporter.warn(Warning::LatitudeFromClimate { latitude_deg });
        }
        (latitude_deg, 0.0)
    } else {
        let on_earth = || {
            let projection = Projection::new(&frame.crs)?;
            let [_, latitude_deg] = projection.lon_lat_deg(middle)?;
            Ok((latitude_deg, projection.grid_convergence_rad(middle)?))
        };
        on_earth().map_err(crs_error(&first_path))?
    };
    check_latitude(latitude_deg)?;
    Ok(Terrain {
        elevation_m: Grid::new(Arc::new(frame), Arc::new(mask), warped.values),
        latitude_rad: latitude_deg.to_radians(),
        grid_convergence_rad,
    })
}

fn check_params(params: &ImportParams) -> Result<(), ImportError> {
    let wrong = |name, value: String, problem| Err(ImportError::Parameter { name, value, problem });
    if let Some(cell_m) = params.cell_m.filter(|cell_m| !PLAUSIBLE_CELL_M.contains(cell_m)) {
        return wrong("cell width", cell_m.to_string(), "give metres from 0.05 to 1000");
    }
    if let Some(bbox) = params.bbox {
        let finite = [bbox.west, bbox.south, bbox.east, bbox.north].iter().all(|v| v.is_finite());
        if !(finite && bbox.west < bbox.east && bbox.south < bbox.north) {
            return wrong(
                "window",
                bbox.to_string(),
                "give west,south,east,north with west < east and south < north",
            );
        }
    }
    if params.fill_holes_up_to_m2.is_nan() || params.fill_holes_up_to_m2 < 0.0 {
        let value = params.fill_holes_up_to_m2.to_string();
        return wrong("holes to fill", value, "give an area in m², or 0 for none");
    }
    params.latitude_deg.map_or(Ok(()), check_latitude)
}

fn check_latitude(latitude_deg: f64) -> Result<(), ImportError> {
    if latitude_deg.abs() <= 90.0 {
        return Ok(());
    }
    let (name, value) = ("latitude", latitude_deg.to_string());
    Err(ImportError::Parameter { name, value, problem: "give degrees from −90 to 90" })
}

/// The CRS that all tiles share.
fn common_crs(
    tiles: &[NamedRaster],
    params: &ImportParams,
    reporter: &Reporter,
) -> Result<Crs, ImportError> {
    let first = tiles.first().ok_or(ImportError::NoTiles)?;
    if let Some(crs) = &params.crs {
        for tile in tiles {
            if let Some(file) = tile.raster.crs.as_ref().filter(|file| *file != crs) {
                let (path, file, given) = (tile.path.clone(), file.to_string(), crs.to_string());
                reporter.warn(Warning::CrsOverridden { path, file, given });
            }
        }
        return Ok(crs.clone());
    }
    for NamedRaster { path, raster } in tiles {
        let Some(CrsProblem { text, is_fatal }) = &raster.crs_problem else { continue };
        let (path, problem) = (path.clone(), text.clone());
        if *is_fatal {
            return Err(ImportError::CrsNotUnderstood { path, problem });
        }
        reporter.warn(Warning::CrsNotUnderstood { path, problem });
    }
    let name = |tile: &NamedRaster| match &tile.raster.crs {
        Some(crs) => crs.to_string(),
        None => "no CRS".to_owned(),
    };
    if let Some(other) = tiles.iter().find(|tile| tile.raster.crs != first.raster.crs) {
        return Err(ImportError::MixedCrs {
            first: first.path.clone(),
            first_crs: name(first),
            second: other.path.clone(),
            second_crs: name(other),
        });
    }
    if first.raster.crs.is_none() {
        reporter.warn(Warning::NoCrs { path: first.path.clone() });
    }
    Ok(first.raster.crs.clone().unwrap_or(Crs::Local))
}

/// Moves tiles by whole turns to lie nearest to the first: neighbours across 180° count from either side.
fn count_longitudes_alike(tiles: &mut [NamedRaster]) {
    let longitude_deg = |tile: &NamedRaster| Lattice::of(&tile.raster).middle()[0];
    let Some(first_deg) = tiles.first().map(longitude_deg) else { return };
    for tile in &mut tiles[1..] {
        let here_deg = longitude_deg(tile);
        tile.raster.affine.origin_x += nearest_turn(here_deg, first_deg) - here_deg;
    }
}

/// The middle of the tiles' middles, in their CRS; does not depend on their order.
fn middle_of(tiles: &[NamedRaster]) -> [f64; 2] {
    let span = |axis: usize| {
        let middles = tiles.iter().map(|tile| Lattice::of(&tile.raster).middle()[axis]);
        let (low, high) = middles
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), m| (low.min(m), high.max(m)));
        (low + high) / 2.0
    };
    [span(0), span(1)]
}

/// The scene's frame, and the tiles that reach into it.
fn scene_frame(
    tiles: Vec<NamedRaster>,
    crs: &Crs,
    placement: &Placement,
    params: &ImportParams,
) -> Result<(Vec<NamedRaster>, Frame), ImportError> {
    let outside = |tile: &NamedRaster| ImportError::OutsideCrs {
        path: tile.path.clone(),
        crs: crs.to_string(),
    };
    let extent = |tile: &NamedRaster| {
        placement.extent(&Lattice::of(&tile.raster)).ok_or_else(|| outside(tile))
    };
    let extents: Vec<MapWindow> = tiles.iter().map(extent).collect::<Result<_, _>>()?;
    let around = |extents: &[MapWindow]| extents.iter().copied().reduce(|a, b| a.union(&b));
    let data = around(&extents).ok_or(ImportError::NoTiles)?;
    let reaches_in =
        |extent: &MapWindow| params.bbox.is_none_or(|b| b.intersection(extent).is_some());
    let (tiles, extents): (Vec<_>, Vec<_>) =
        tiles.into_iter().zip(extents).filter(|(_, extent)| reaches_in(extent)).unzip();
    check_distances(&tiles, &extents)?;
    let window = around(&extents).and_then(|all| match &params.bbox {
        Some(bbox) => bbox.intersection(&all),
        None => Some(all),
    });
    let (Some(window), Some(first)) = (window, tiles.first()) else {
        let bbox = params.bbox.unwrap_or(data);
        return Err(ImportError::Outside { bbox, data, crs: placement.crs.to_string() });
    };
    let cells = CellLattice::new(placement, &Lattice::of(&first.raster), params.cell_m)
        .ok_or_else(|| outside(first))?;
    if !PLAUSIBLE_CELL_M.contains(&cells.cell_m()) {
        return Err(ImportError::CellSize { path: first.path.clone(), cell_m: cells.cell_m() });
    }
    match cells.frame(&window, &placement.crs, params.max_cells) {
        Ok(frame) => Ok((tiles, frame)),
        Err((rows, cols)) if rows < 1.0 || cols < 1.0 => {
            let path = first.path.clone();
            Err(ImportError::TooFewCells { path, rows: 0, cols: 0, valid_cells: 0 })
        }
        Err((rows, cols)) => {
            Err(ImportError::TooManyCells { rows, cols, max_cells: params.max_cells })
        }
    }
}

/// Refuses tiles with next to nothing but emptiness between them.
fn check_distances(tiles: &[NamedRaster], extents: &[MapWindow]) -> Result<(), ImportError> {
    let tiles_m2: f64 = extents.iter().map(MapWindow::area).sum();
    let whole = extents.iter().copied().reduce(|a, b| a.union(&b));
    if whole.is_none_or(|whole| whole.area() <= EMPTINESS_FACTOR * tiles_m2) {
        return Ok(());
    }
    let distance_m = |tile: usize| {
        let ([ax, ay], [bx, by]) = (extents[0].middle(), extents[tile].middle());
        ((ax - bx) * (ax - bx) + (ay - by) * (ay - by)).sqrt()
    };
    let farthest = (1..tiles.len()).max_by(|&a, &b| distance_m(a).total_cmp(&distance_m(b)));
    farthest.map_or(Ok(()), |other| {
        Err(ImportError::TilesFarApart {
            first: tiles[0].path.clone(),
            second: tiles[other].path.clone(),
            distance_km: distance_m(other) / 1000.0,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Affine, SourceRaster};

    const SIZE: usize = 24;

    /// A ramp of 24 × 24 cells.
    fn ramp(path: &str, crs: Option<Crs>, origin: [f64; 2], cell: f64) -> NamedRaster {
        let affine = Affine {
            origin_x: origin[0],
            origin_y: origin[1],
            col_dx: cell,
            col_dy: 0.0,
            row_dx: 0.0,
            row_dy: -cell,
        };
        let value = |i: usize| 900.0 + 1.7 * (i % SIZE) as f32 - 0.9 * (i / SIZE) as f32;
        let raster = SourceRaster {
            rows: SIZE,
            cols: SIZE,
            affine,
            crs,
            vertical_unit: None,
            latitude_deg: None,
            crs_problem: None,
            values: (0..SIZE * SIZE).map(value).collect(),
            valid: vec![true; SIZE * SIZE],
            non_finite_cells: 0,
        };
        NamedRaster { path: path.into(), raster }
    }

    fn utm(path: &str) -> NamedRaster {
        ramp(path, Some(Crs::Epsg(32633)), [500_000.0, 5_100_000.0], 1.0)
    }

    fn import(
        tiles: Vec<NamedRaster>,
        params: &ImportParams,
    ) -> (Result<Terrain, ImportError>, Vec<Warning>) {
        let reporter = Reporter::silent();
        let terrain = run(tiles, params, Some(47.0), &reporter);
        (terrain, reporter.warnings())
    }

    fn refused(tiles: Vec<NamedRaster>, params: &ImportParams) -> String {
        import(tiles, params).0.unwrap_err().to_string()
    }

    #[test]
    fn a_metric_square_raster_keeps_its_bits() {
        let tile = utm("a.tif");
        let (terrain, warnings) = import(vec![tile.clone()], &ImportParams::default());
        let terrain = terrain.unwrap();
        assert_eq!(warnings, []);
        assert_eq!(terrain.elevation_m.values(), tile.raster.values);
        assert!(terrain.elevation_m.mask().is_all_valid());
        let frame = terrain.elevation_m.frame();
        assert_eq!(frame.crs, Crs::Epsg(32633));
        assert_eq!((frame.transform.west_m, frame.transform.north_m), (500_000.0, 5_100_000.0));
        assert!((terrain.latitude_rad.to_degrees() - 46.053466).abs() < 1e-6);
        assert!(terrain.grid_convergence_rad.abs() < 1e-5);
    }

    #[test]
    fn quarters_give_the_whole_bit_for_bit() {
        let whole = utm("whole.tif");
        let quarter = |top: usize, left: usize| {
            let mut tile = utm(&format!("{top}_{left}.tif"));
            let half = SIZE / 2;
            let r = &mut tile.raster;
            (r.rows, r.cols) = (half, half);
            r.affine.origin_x += left as f64;
            r.affine.origin_y -= top as f64;
            let from = |i: usize| (top + i / half) * SIZE + left + i % half;
            r.values = (0..half * half).map(|i| whole.raster.values[from(i)]).collect();
            r.valid = vec![true; half * half];
            tile
        };
        let quarters = vec![quarter(12, 0), quarter(0, 12), quarter(0, 0), quarter(12, 12)];
        let (terrain, warnings) = import(quarters, &ImportParams::default());
        let terrain = terrain.unwrap();
        assert_eq!(warnings, []);
        assert_eq!(terrain.elevation_m.values(), whole.raster.values);
        assert_eq!(terrain.elevation_m.frame().transform.north_m, 5_100_000.0);
    }

    #[test]
    fn feet_become_metres() {
        // California zone 3 in US survey feet: heights assumed feet, and said so
        let feet = || ramp("ca.tif", Some(Crs::Epsg(2227)), [6_000_000.0, 2_100_000.0], 10.0);
        let (terrain, warnings) = import(vec![feet()], &ImportParams::default());
        let terrain = terrain.unwrap();
        assert!(warnings.contains(&Warning::VerticalUnitAssumedFeet { path: "ca.tif".into() }));
        assert!(warnings.iter().any(|w| matches!(w, Warning::Warped { .. })));
        assert_eq!(terrain.elevation_m.frame().crs, Crs::Epsg(32610));
        assert!((terrain.elevation_m.frame().transform.cell_m - 3.0).abs() < 1e-9);
        let (low, high) = terrain.elevation_m.range().unwrap();
        assert!(low > 880.0 * 0.3048 - 1.0 && high < 940.0 * 0.3049, "{low} {high}");

        // the file's own unit, and the user's, need no assumption
        let mut stated = feet();
        stated.raster.vertical_unit = Some(LengthUnit::Metre);
        let (terrain, warnings) = import(vec![stated], &ImportParams::default());
        assert!(terrain.unwrap().elevation_m.range().unwrap().0 > 870.0);
        assert!(!warnings.contains(&Warning::VerticalUnitAssumedFeet { path: "ca.tif".into() }));
        let params = ImportParams { vertical_unit: Some(LengthUnit::Foot), ..Default::default() };
        let tile = utm("a.tif");
        let (terrain, _) = import(vec![tile.clone()], &params);
        let expected = (f64::from(tile.raster.values[5]) * 0.3048) as f32;
        assert_eq!(terrain.unwrap().elevation_m.values()[5], expected);
    }

    #[test]
    fn local_rasters_take_the_latitude_that_is_known() {
        let mut tile = ramp("a.elv", Some(Crs::Local), [0.0, 48.0], 2.0);
        tile.raster.latitude_deg = Some(42.5);
        let latitude_deg = |tile: &NamedRaster, params: &ImportParams| {
            let (terrain, warnings) = import(vec![tile.clone()], params);
            (terrain.unwrap().latitude_rad.to_degrees(), warnings)
        };
        let params = ImportParams { latitude_deg: Some(10.0), ..Default::default() };
        assert!((latitude_deg(&tile, &params).0 - 10.0).abs() < 1e-12);
        let (found, warnings) = latitude_deg(&tile, &ImportParams::default());
        assert!((found - 42.5).abs() < 1e-12 && warnings.is_empty());
        (tile.raster.latitude_deg, tile.raster.crs) = (None, None);
        let (found, warnings) = latitude_deg(&tile, &ImportParams::default());
        assert!((found - 47.0).abs() < 1e-12);
        let no_crs = Warning::NoCrs { path: "a.elv".into() };
        assert_eq!(warnings, [no_crs, Warning::LatitudeFromClimate { latitude_deg: 47.0 }]);
        let nothing = run(vec![tile], &ImportParams::default(), None, &Reporter::silent());
        assert!(matches!(nothing, Err(ImportError::NoLatitude)));
    }

    #[test]
    fn local_feet_are_scaled() {
        let tile = ramp("a.asc", None, [0.0, 240.0], 10.0);
        let params = ImportParams { horizontal_unit: Some(LengthUnit::Foot), ..Default::default() };
        let (terrain, warnings) = import(vec![tile], &params);
        let terrain = terrain.unwrap();
        assert!((terrain.elevation_m.frame().transform.cell_m - 3.048).abs() < 1e-12);
        assert!((terrain.elevation_m.values()[0] - 900.0 * 0.3048).abs() < 1e-3);
        assert!(warnings.contains(&Warning::VerticalUnitAssumedFeet { path: "a.asc".into() }));
    }

    #[test]
    fn degrees_become_metres() {
        let second = 1.0 / 3600.0;
        let tile = ramp("dem.tif", Some(Crs::Epsg(4326)), [15.0, 46.0], second);
        let (terrain, _) = import(vec![tile], &ImportParams::default());
        let terrain = terrain.unwrap();
        let frame = terrain.elevation_m.frame();
        assert_eq!((frame.crs.clone(), frame.transform.cell_m), (Crs::Epsg(32633), 26.0));
        // on the central meridian the ramp runs on: 1.7 m in 21.5 m, 0.9 m in 30.9 m
        let at = |row, col| *terrain.elevation_m.get(crate::raster::Cell { row, col }).unwrap();
        let (east, south) = (at(12, 14) - at(12, 6), at(18, 10) - at(8, 10));
        assert!((east - 8.0 * 26.0 * 1.7 / 21.51).abs() < 0.05, "{east}");
        assert!((south + 10.0 * 26.0 * 0.9 / 30.88).abs() < 0.05, "{south}");
    }

    #[test]
    fn turned_rasters_become_north_up() {
        let mut tile = utm("turned.tif");
        let a = &mut tile.raster.affine;
        (a.col_dx, a.col_dy, a.row_dx, a.row_dy) = (0.8, 0.6, 0.6, -0.8);
        let (terrain, warnings) = import(vec![tile], &ImportParams::default());
        let terrain = terrain.unwrap();
        assert!((terrain.elevation_m.frame().transform.cell_m - 1.0).abs() < 1e-12);
        assert!(warnings.iter().any(|w| matches!(w, Warning::VoidsKept { .. })));
        let valid = terrain.elevation_m.mask().valid_count() as f64;
        assert!((valid - 576.0).abs() < 30.0, "{valid}");
    }

    #[test]
    fn windows_and_cells_are_obeyed() {
        let bbox =
            MapWindow { west: 500_004.0, south: 5_099_984.0, east: 500_012.0, north: 5_099_996.0 };
        let params = ImportParams { bbox: Some(bbox), ..Default::default() };
        let tile = utm("a.tif");
        let terrain = import(vec![tile.clone()], &params).0.unwrap();
        let frame = terrain.elevation_m.frame();
        assert_eq!((frame.rows, frame.cols), (12, 8));
        assert_eq!(terrain.elevation_m.values()[..8], tile.raster.values[4 * SIZE + 4..][..8]);

        let params = ImportParams { cell_m: Some(4.0), ..Default::default() };
        let terrain = import(vec![tile.clone()], &params).0.unwrap();
        assert_eq!(terrain.elevation_m.frame().len(), 36);
        let block = |i: usize| f64::from(tile.raster.values[(i / 4) * SIZE + i % 4]);
        let mean = (0..16).map(block).sum::<f64>() / 16.0;
        assert!((f64::from(terrain.elevation_m.values()[0]) - mean).abs() < 1e-4);

        let far = MapWindow { west: 0.0, south: 0.0, east: 10.0, north: 10.0 };
        let message = refused(vec![tile], &ImportParams { bbox: Some(far), ..Default::default() });
        assert!(message.contains("500000.0,5099976.0,500024.0,5100000.0"), "{message}");
    }

    #[test]
    fn holes_are_filled_and_lakes_stay() {
        let mut tile = utm("a.tif");
        let whole = tile.raster.values.clone();
        for i in 0..SIZE * SIZE {
            let (row, col) = (i / SIZE, i % SIZE);
            let hole = (3..6).contains(&row) && (3..7).contains(&col);
            let lake = (10..20).contains(&row) && (10..20).contains(&col);
            if hole || lake {
                (tile.raster.values[i], tile.raster.valid[i]) = (0.0, false);
            }
        }
        let params = ImportParams { fill_holes_up_to_m2: 50.0, ..Default::default() };
        let (terrain, warnings) = import(vec![tile], &params);
        let terrain = terrain.unwrap();
        assert_eq!(
            warnings,
            [Warning::HolesFilled { cells: 12 }, Warning::VoidsKept { cells: 100 }]
        );
        for (i, &valid) in terrain.elevation_m.mask().as_slice().iter().enumerate() {
            assert!(!valid || (terrain.elevation_m.values()[i] - whole[i]).abs() < 1e-3);
        }
    }

    #[test]
    fn bad_input_is_named() {
        let params = ImportParams::default();
        assert!(matches!(import(vec![], &params).0, Err(ImportError::NoTiles)));
        let other = ramp("b.tif", Some(Crs::Epsg(3794)), [5e5, 1e5], 1.0);
        let message = refused(vec![utm("a.tif"), other], &params);
        for part in ["a.tif", "EPSG:32633", "b.tif", "EPSG:3794", "reproject"] {
            assert!(message.contains(part), "{message}");
        }
        let mut empty = utm("a.tif");
        empty.raster.valid.fill(false);
        assert!(matches!(import(vec![empty], &params).0, Err(ImportError::NoData { .. })));
        let mut nonsense = utm("a.tif");
        nonsense.raster.values.iter_mut().for_each(|v| *v *= 100.0);
        assert!(refused(vec![nonsense], &params).contains("--vertical-unit"));
        let degrees = ramp("a.asc", None, [15.0, 46.0], 0.0003);
        assert!(refused(vec![degrees], &params).contains("--crs"));
        let mut tile = utm("far.tif");
        tile.raster.affine.origin_x += 3e6;
        let message = refused(vec![utm("a.tif"), tile], &params);
        assert!(message.contains("far.tif") && message.contains("3000 km"), "{message}");
        let few = ImportParams { max_cells: 100, ..Default::default() };
        assert!(refused(vec![utm("a.tif")], &few).contains("--bbox"));
        let mut scarce = utm("a.tif");
        scarce.raster.valid[15..].fill(false);
        assert!(matches!(
            import(vec![scarce], &params).0,
            Err(ImportError::TooFewCells { valid_cells: 15, .. })
        ));
        for cell_m in [0.0, -1.0, f64::NAN, 1e9] {
            let params = ImportParams { cell_m: Some(cell_m), ..Default::default() };
            assert!(matches!(
                import(vec![utm("a.tif")], &params).0,
                Err(ImportError::Parameter { .. })
            ));
        }
        let unknown = ImportParams { crs: Some(Crs::Epsg(999_999)), ..Default::default() };
        assert!(matches!(import(vec![utm("a.tif")], &unknown).0, Err(ImportError::Crs { .. })));
        let mut flat = utm("a.tif");
        flat.raster.affine.col_dx = 0.0;
        assert!(matches!(import(vec![flat], &params).0, Err(ImportError::Georeference { .. })));
    }

    #[test]
    fn issue_2_tiles_across_the_antimeridian_join() {
        let cell = 0.001;
        let side = SIZE as f64 * cell;
        let tile = |name, west| ramp(name, Some(Crs::Epsg(4326)), [west, 52.0], cell);
        let terrain = |tiles| import(tiles, &ImportParams::default()).0.unwrap().elevation_m;
        let apart = terrain(vec![tile("w.tif", 180.0 - side), tile("e.tif", -180.0)]);
        let alike = terrain(vec![tile("w.tif", 180.0 - side), tile("e.tif", 180.0)]);
        assert_eq!(apart.frame(), alike.frame());
        assert_eq!(apart.mask().valid_count(), alike.mask().valid_count());
        assert!(alike.mask().valid_count() as f64 > 0.8 * alike.frame().len() as f64);
    }

    #[test]
    fn issue_2_crs_rescues_what_is_not_understood() {
        let tile = |is_fatal| {
            let mut tile = utm("a.tif");
            let text = "an unknown method; give the CRS yourself: --crs EPSG:n".to_owned();
            (tile.raster.crs, tile.raster.crs_problem) =
                (None, Some(CrsProblem { text, is_fatal }));
            tile
        };
        let message = refused(vec![utm("b.tif"), tile(true)], &ImportParams::default());
        assert!(message.contains("a.tif: an unknown method"), "{message}");
        let params = ImportParams { crs: Some(Crs::Epsg(32633)), ..Default::default() };
        let (terrain, warnings) = import(vec![tile(true)], &params);
        assert_eq!(terrain.unwrap().elevation_m.frame().crs, Crs::Epsg(32633));
        assert_eq!(warnings, []);
        let (terrain, warnings) = import(vec![tile(false)], &ImportParams::default());
        assert_eq!(terrain.unwrap().elevation_m.frame().crs, Crs::Local);
        assert!(matches!(warnings[0], Warning::CrsNotUnderstood { .. }), "{warnings:?}");
    }

    #[test]
    fn stray_heights_are_masked_and_spikes_replaced() {
        let mut tile = utm("a.tif");
        tile.raster.values[10 * SIZE + 10] = 65_535.0;
        tile.raster.values[5 * SIZE + 5] += 60.0;
        let (terrain, warnings) = import(vec![tile], &ImportParams::default());
        assert!(terrain.unwrap().elevation_m.range().unwrap().1 < 950.0);
        assert!(warnings.contains(&Warning::SpikesRemoved { cells: 1 }));
        assert!(warnings.contains(&Warning::HolesFilled { cells: 1 }));
        assert!(warnings.iter().any(|w| w.to_string().contains("65535")));
    }

    #[test]
    fn misaligned_tiles_overlap_with_the_first_on_top() {
        let mut second = utm("b.tif");
        second.raster.affine.origin_x += 10.5;
        second.raster.values.iter_mut().for_each(|v| *v += 100.0);
        let first = utm("a.tif");
        let (terrain, warnings) = import(vec![first.clone(), second], &ImportParams::default());
        let terrain = terrain.unwrap();
        assert_eq!(terrain.elevation_m.frame().cols, 35);
        assert_eq!(terrain.elevation_m.row(3)[..SIZE], first.raster.values[3 * SIZE..4 * SIZE]);
        assert!(
            warnings.iter().any(|w| matches!(w, Warning::TilesDisagree { cells } if *cells > 200))
        );
    }

    #[test]
    fn threads_change_no_bit() {
        let second = 1.0 / 3600.0;
        let mut tile = ramp("dem.tif", Some(Crs::Epsg(4326)), [15.0, 46.0], second);
        tile.raster.valid[200..203].fill(false);
        let bits = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let params = ImportParams { fill_holes_up_to_m2: 1e4, ..Default::default() };
            let terrain = pool.install(|| import(vec![tile.clone()], &params).0.unwrap());
            terrain.elevation_m.values().iter().map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(1), bits(2));
    }
}
