//! Point clouds become terrain and the canopy measured over it.

use std::path::Path;
use std::sync::Arc;

use super::framing::{Placement, lattice_of};
use super::import::{self, ImportError, ImportParams};
use super::mosaic::NamedRaster;
use super::point_cloud::{self, Params as CloudParams};
use super::{Terrain, onto_frame};
use crate::io::las::PointCloud;
use crate::progress::{Reporter, Warning};
use crate::raster::{Crs, Grid, LengthUnit, MapWindow, Projection, SourceRaster};

/// Terrain, and what stands on it, on one frame.
#[derive(Clone, Debug)]
pub struct CloudTerrain {
    /// Bare earth.
    pub terrain: Terrain,
    /// Canopy height above ground, metres; masked where nothing was measured.
    pub chm_m: Grid<f32>,
    /// Elevation of the highest surface, metres.
    pub dsm_m: Grid<f32>,
}

/// Terrain and canopy of a classified cloud; `path` names it in messages.
///
/// Points are brought to the scene's CRS and its grid is laid over them, so no surface is resampled.
///
/// # Errors
/// [`ImportError`]: no ground points, points far off, or what [`import::run`] says of rasters.
pub fn run(
    cloud: PointCloud,
    path: &Path,
    params: &ImportParams,
    climate_latitude_deg: Option<f64>,
    reporter: &Reporter,
) -> Result<CloudTerrain, ImportError> {
    let crs = match params.crs.clone().or_else(|| cloud.crs.clone()) {
        Some(crs) => crs,
        None => {
            reporter.warn(Warning::NoCrs { path: path.to_path_buf() });
            Crs::Local
        }
    };
    if cloud.dropped_points() > 0 {
        reporter.warn(Warning::PointsDropped { points: cloud.dropped_points() });
    }
    let (cloud, crs) = in_scene(cloud, &crs, path, params, reporter)?;
    let surface_params = CloudParams {
        cell_m: params.cell_m,
        max_cells: params.max_cells,
        ..CloudParams::default()
    };
    let surfaces = point_cloud::surfaces(&cloud, crs.clone(), &surface_params, reporter)
        .map_err(|source| ImportError::Cloud { path: path.to_path_buf(), source })?;
    drop(cloud);

    let tile = NamedRaster { path: path.to_path_buf(), raster: source_raster(surfaces.dem_m) };
    let params = ImportParams {
        crs: Some(crs.clone()),
        horizontal_unit: None,
        vertical_unit: Some(LengthUnit::Metre),
        remove_spikes: false, // done among the points
        ..params.clone()
    };
    let terrain = import::run(vec![tile], &params, climate_latitude_deg, reporter)?;
    let frame = terrain.elevation_m.frame();
    let register = |surface: Grid<f32>| {
        let raster = source_raster(surface);
        onto_frame::registered(&raster, &crs, frame, params.resampling, reporter)
    };
    let (chm_m, dsm_m) = (register(surfaces.chm_m)?, register(surfaces.dsm_m)?);
    Ok(CloudTerrain { chm_m, dsm_m, terrain })
}

/// The window, in metres, whose points bear on the scene's cells in `bbox`: wider, so that surfaces at its edges
/// are those of the whole cloud.
pub fn window_of_points(bbox: &MapWindow, params: &ImportParams) -> MapWindow {
    let reach_m = CloudParams { cell_m: params.cell_m, ..CloudParams::default() }.reach_m();
    MapWindow {
        west: bbox.west - reach_m,
        south: bbox.south - reach_m,
        east: bbox.east + reach_m,
        north: bbox.north + reach_m,
    }
}

/// The cloud in metres of the scene's CRS, without points that bear on none of its cells; and that CRS.
fn in_scene(
    cloud: PointCloud,
    crs: &Crs,
    path: &Path,
    params: &ImportParams,
    reporter: &Reporter,
) -> Result<(PointCloud, Crs), ImportError> {
    let in_cloud = |source| ImportError::Crs { path: path.to_path_buf(), source };
    let (horizontal, vertical) = units(&cloud, crs, path, params, reporter)?;
    let cloud = cloud.to_metres(horizontal, vertical);
    let middle = cloud.middle().ok_or_else(|| {
        let source = point_cloud::Error::NoPoints;
        ImportError::Cloud { path: path.to_path_buf(), source }
    })?;
    let placement = Placement::new(crs, middle).map_err(in_cloud)?;
    let cloud = match &placement.to_scene {
        None => cloud,
        Some(projector) => {
            let stage = reporter.stage("project points", cloud.len() as u64);
            stage.advance(cloud.len() as u64);
            let (cloud, lost) = cloud.projected(projector, placement.crs.clone());
            if lost > 0 && params.bbox.is_none() {
                let (path, crs) = (path.to_path_buf(), crs.to_string());
                return Err(ImportError::OutsideCrs { path, crs });
            }
            let (from, to) = (crs.to_string(), placement.crs.to_string());
            reporter.warn(Warning::Projected { path: path.to_path_buf(), from, to });
            if Projection::new(crs).map_err(in_cloud)?.lacks_shift_grid() {
                reporter.warn(Warning::ShiftGridMissing { crs: crs.to_string() });
            }
            cloud
        }
    };
    let (Some(bbox), Some(bounds)) = (params.bbox, cloud.bounds()) else {
        return Ok((cloud, placement.crs));
    };
    let cloud = cloud.within(&window_of_points(&bbox, params));
    if cloud.is_empty() {
        let ([west, south, _], [east, north, _]) = (bounds.min, bounds.max);
        let data = MapWindow { west, south, east, north };
        return Err(ImportError::Outside { bbox, data, crs: placement.crs.to_string() });
    }
    Ok((cloud, placement.crs))
}

/// The units of coordinates (metres where a CRS knows better) and of heights, by the rule for rasters.
fn units(
    cloud: &PointCloud,
    crs: &Crs,
    path: &Path,
    params: &ImportParams,
    reporter: &Reporter,
) -> Result<(LengthUnit, LengthUnit), ImportError> {
    let projection = match crs {
        Crs::Local => None,
        _ => {
            let path = path.to_path_buf();
            Some(Projection::new(crs).map_err(|source| ImportError::Crs { path, source })?)
        }
    };
    let local_unit = params.horizontal_unit.filter(|_| projection.is_none());
    let foot = match &projection {
        Some(projection) => projection.foot(),
        None => local_unit.filter(|unit| *unit != LengthUnit::Metre),
    };
    let named = params
        .vertical_unit
        .or(cloud.vertical_unit)
        .or_else(|| projection.as_ref().and_then(Projection::vertical_unit));
    if let (None, Some(_)) = (named, foot) {
        reporter.warn(Warning::VerticalUnitAssumedFeet { path: path.to_path_buf() });
    }
    let metre = LengthUnit::Metre;
    Ok((local_unit.unwrap_or(metre), named.or(foot).unwrap_or(metre)))
}

/// A surface as a raster of its frame's CRS.
fn source_raster(surface: Grid<f32>) -> SourceRaster {
    let frame = Arc::clone(surface.frame());
    let valid = surface.mask().as_slice().to_vec();
    SourceRaster {
        rows: frame.rows,
        cols: frame.cols,
        affine: lattice_of(&frame).affine,
        crs: Some(frame.crs.clone()),
        vertical_unit: Some(LengthUnit::Metre),
        latitude_deg: None,
        crs_problem: None,
        values: surface.into_values(),
        valid,
        non_finite_cells: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::las::Quantization;
    use crate::raster::{Cell, Projector};
    use crate::terrain::point_cloud::synthetic;

    /// Ground on a slope with one tree, in the unit given, in `crs`.
    fn cloud(crs: Option<Crs>, origin: [f64; 2], unit: LengthUnit) -> PointCloud {
        let axis = |offset| Quantization { scale: 0.001, offset };
        let mut cloud = PointCloud::new([axis(origin[0]), axis(origin[1]), axis(0.0)], crs, None);
        for i in 0..120 {
            for j in 0..120 {
                let (x_m, y_m) = (f64::from(i) * 0.5, f64::from(j) * 0.5);
                let ground_m = 100.0 + 0.1 * x_m;
                let place = |z_m: f64| {
                    [
                        origin[0] + x_m / unit.metres(),
                        origin[1] + y_m / unit.metres(),
                        z_m / unit.metres(),
                    ]
                };
                cloud.push(place(ground_m), 2);
                if (x_m - 30.0).abs() < 3.0 && (y_m - 30.0).abs() < 3.0 {
                    cloud.push(place(ground_m + 15.0), 5);
                }
            }
        }
        cloud
    }

    fn import(cloud: PointCloud) -> CloudTerrain {
        let params = ImportParams { cell_m: Some(1.0), ..ImportParams::default() };
        run(cloud, Path::new("cloud.laz"), &params, Some(38.0), &Reporter::silent()).unwrap()
    }

    fn check(imported: &CloudTerrain) {
        let (low, high) = imported.terrain.elevation_m.range().unwrap();
        assert!((100.0..101.0).contains(&low) && (105.0..106.1).contains(&high), "{low} {high}");
        let (_, tallest) = imported.chm_m.range().unwrap();
        assert!((tallest - 15.0).abs() < 0.3, "{tallest}");
        assert_eq!(imported.chm_m.frame(), imported.terrain.elevation_m.frame());
        assert_eq!(imported.dsm_m.frame(), imported.terrain.elevation_m.frame());
    }

    #[test]
    fn a_metric_cloud_keeps_its_crs() {
        let imported =
            import(cloud(Some(Crs::Epsg(32610)), [500_000.0, 4_200_000.0], LengthUnit::Metre));
        check(&imported);
        assert_eq!(imported.terrain.elevation_m.frame().crs, Crs::Epsg(32610));
    }

    #[test]
    fn a_cloud_in_survey_feet_comes_to_its_utm_zone_in_metres() {
        let imported = import(cloud(
            Some(Crs::Epsg(2227)),
            [6_000_000.0, 2_100_000.0],
            LengthUnit::UsSurveyFoot,
        ));
        check(&imported);
        assert_eq!(imported.terrain.elevation_m.frame().crs, Crs::Epsg(32610));
    }

    #[test]
    fn a_cloud_without_crs_is_local() {
        let imported = import(cloud(None, [10.0, 20.0], LengthUnit::Metre));
        check(&imported);
        assert_eq!(imported.terrain.elevation_m.frame().crs, Crs::Local);
        assert!((imported.terrain.latitude_rad.to_degrees() - 38.0).abs() < 1e-9);
    }

    /// `cloud` of EPSG:32610 in another system.
    fn in_other_crs(cloud: &PointCloud, crs: Crs, steps: [f64; 3]) -> PointCloud {
        let projector = Projector::new(&Crs::Epsg(32610), &crs).unwrap();
        let place = |index: usize| {
            let [x, y, z] = cloud.position(index);
            let [x, y] = projector.project([x, y]).unwrap();
            [x, y, z]
        };
        let [x, y, _] = place(0);
        let axis = |scale, offset| Quantization { scale, offset };
        let axes = [axis(steps[0], x), axis(steps[1], y), axis(steps[2], 0.0)];
        let mut made = PointCloud::new(axes, Some(crs), Some(LengthUnit::Metre));
        (0..cloud.len()).for_each(|i| made.push(place(i), cloud.class(i)));
        made
    }

    const UTM_10: [f64; 2] = [500_000.0, 4_200_000.0];

    fn metric() -> PointCloud {
        cloud(Some(Crs::Epsg(32610)), UTM_10, LengthUnit::Metre)
    }

    #[test]
    fn a_cloud_in_degrees_comes_to_its_utm_zone() {
        let imported = import(in_other_crs(&metric(), Crs::Epsg(4326), [1e-8, 1e-8, 0.001]));
        check(&imported);
        assert_eq!(imported.terrain.elevation_m.frame().crs, Crs::Epsg(32610));
    }

    #[test]
    fn issue_2_projected_canopies_are_those_of_the_points() {
        let whole = import(metric());
        for (crs, step) in [
            (Crs::Epsg(2227), 0.001), // survey feet
            (Crs::Epsg(3857), 0.001),
            (Crs::Proj("+proj=utm +zone=10 +datum=WGS84 +units=yd".to_owned()), 0.001),
        ] {
            let name = crs.to_string();
            let imported = import(in_other_crs(&metric(), crs, [step, step, 0.001]));
            check(&imported);
            let (lowest, tallest) = imported.chm_m.range().unwrap();
            assert!(lowest >= 0.0 && tallest <= 15.1, "{name}: {lowest} {tallest}");
            // where cells have the same points, they have the same canopy: no edge is blurred
            let heights = imported.chm_m.valid_values().filter(|h| (1.0..14.0).contains(*h));
            assert_eq!(heights.count(), 0, "{name}");
            let area =
                |made: &CloudTerrain| made.chm_m.valid_values().filter(|h| **h > 8.0).count();
            assert!(area(&imported).abs_diff(area(&whole)) <= 13, "{name}: {}", area(&imported));
        }
    }

    #[test]
    fn issue_2_the_crs_s_own_unit_of_height_counts() {
        let feet = "+proj=utm +zone=10 +datum=WGS84 +vunits=us-ft".to_owned();
        let given = |vertical_unit, crs: &str| {
            let params = ImportParams {
                crs: Some(Crs::Proj(crs.to_owned())),
                vertical_unit,
                cell_m: Some(1.0),
                ..ImportParams::default()
            };
            let mut cloud = metric();
            cloud.vertical_unit = None;
            let made = run(cloud, Path::new("c.laz"), &params, None, &Reporter::silent()).unwrap();
            made.chm_m.range().unwrap().1
        };
        assert!((given(None, &feet) - 15.0 * 0.3048).abs() < 0.05);
        assert!((given(Some(LengthUnit::Metre), &feet) - 15.0).abs() < 0.1);
        // yards are no feet: heights are metres
        assert!(
            (given(None, "+proj=utm +zone=10 +datum=WGS84 +to_meter=1.0001") - 15.0).abs() < 0.1
        );
    }

    #[test]
    fn issue_2_a_window_gives_what_cutting_the_whole_gives() {
        let forest = synthetic::forest(5, 400.0, 3.0);
        let corner = synthetic::CORNER;
        let (west, south) = (corner.east_m + 131.0, corner.north_m + 157.0);
        let bbox = MapWindow { west, south, east: west + 120.0, north: south + 90.0 };
        let params = |bbox| ImportParams { cell_m: Some(1.0), bbox, ..ImportParams::default() };
        let import = |cloud, bbox| {
            run(cloud, Path::new("c.laz"), &params(bbox), None, &Reporter::silent()).unwrap()
        };
        let whole = import(forest.clone(), None);
        let near = forest.within(&window_of_points(&bbox, &params(None)));
        assert!(near.len() < 400_000);
        let part = import(near, Some(bbox));
        for (whole, part) in [
            (&whole.terrain.elevation_m, &part.terrain.elevation_m),
            (&whole.chm_m, &part.chm_m),
            (&whole.dsm_m, &part.dsm_m),
        ] {
            assert_eq!((part.frame().rows, part.frame().cols), (90, 120));
            let (w, p) = (whole.frame().transform, part.frame().transform);
            let (down, right) = ((w.north_m - p.north_m) as usize, (p.west_m - w.west_m) as usize);
            for index in 0..part.frame().len() {
                let cell = part.frame().cell(index);
                let there = Cell { row: cell.row + down, col: cell.col + right };
                let (a, b) = (whole.get(there), part.get(cell));
                let same = a.zip(b).is_some_and(|(a, b)| (a - b).abs() < 1e-4);
                assert!(same || (a, b) == (None, None), "{cell:?}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn issue_2_a_stray_point_is_named_and_a_window_leaves_it_out() {
        let stray = |mut cloud: PointCloud| {
            let [x, y, z] = cloud.position(0);
            cloud.push([x + 190_000.0 / 0.3048, y, z], 2);
            cloud
        };
        let cloud = || {
            stray(cloud(
                Some(Crs::Epsg(2227)),
                [6_000_000.0, 2_100_000.0],
                LengthUnit::UsSurveyFoot,
            ))
        };
        let run = |bbox| {
            let params = ImportParams { cell_m: Some(1.0), bbox, ..ImportParams::default() };
            run(cloud(), Path::new("c.laz"), &params, None, &Reporter::silent())
        };
        let message = run(None).unwrap_err().to_string();
        assert!(message.contains("190.0 km") && message.contains("--bbox"), "{message}");
        let whole = import(super::tests::cloud(
            Some(Crs::Epsg(2227)),
            [6_000_000.0, 2_100_000.0],
            LengthUnit::UsSurveyFoot,
        ));
        let t = whole.terrain.elevation_m.frame().transform;
        let (west, north) = (t.west_m, t.north_m);
        let bbox = MapWindow { west, north, east: west + 70.0, south: north - 70.0 };
        check(&run(Some(bbox)).unwrap());
    }

    #[test]
    fn issue_2_a_window_beside_the_cloud_says_where_the_cloud_is() {
        let bbox = MapWindow { west: 0.0, south: 0.0, east: 9.0, north: 9.0 };
        let params = ImportParams { bbox: Some(bbox), ..ImportParams::default() };
        let made = run(metric(), Path::new("c.laz"), &params, None, &Reporter::silent());
        assert!(matches!(made, Err(ImportError::Outside { .. })), "{made:?}");
    }
}
