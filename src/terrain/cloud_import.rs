//! Point clouds become terrain and the canopy measured over it.

use std::path::Path;

use super::import::{self, ImportError, ImportParams};
use super::mosaic::NamedRaster;
use super::point_cloud::{self, Params as CloudParams};
use super::{Terrain, onto_frame};
use crate::io::las::PointCloud;
use crate::progress::{Reporter, Warning};
use crate::raster::{Affine, Crs, Grid, LengthUnit, Projection, SourceRaster};

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
/// Surfaces are made in metres on the cloud's own projection; where that is no metric CRS of the EPSG
/// registry they are then drawn onto the scene's grid like any raster.
///
/// # Errors
/// [`ImportError`]: no ground points, degrees, or what [`import::run`] says of rasters.
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
    let (horizontal, vertical) = units(&cloud, &crs, path, params, reporter)?;
    let surface_params = CloudParams {
        cell_m: params.cell_m,
        max_cells: params.max_cells,
        ..CloudParams::default()
    };
    let surfaces = point_cloud::surfaces(
        &cloud.to_metres(horizontal, vertical),
        Crs::Local,
        &surface_params,
        reporter,
    )
    .map_err(|source| ImportError::Cloud { path: path.to_path_buf(), source })?;

    // The surfaces as rasters of the cloud's own CRS, heights in metres
    let raster = |surface: Grid<f32>| source_raster(surface, &crs, horizontal);
    let (dem, chm, dsm) = (raster(surfaces.dem), raster(surfaces.chm), raster(surfaces.dsm));
    let tile = NamedRaster { path: path.to_path_buf(), raster: dem };
    let params = ImportParams {
        crs: Some(crs.clone()),
        vertical_unit: Some(LengthUnit::Metre),
        remove_spikes: false, // done among the points
        ..params.clone()
    };
    let terrain = import::run(vec![tile], &params, climate_latitude_deg, reporter)?;
    let frame = terrain.elevation_m.frame();
    let register = |raster: &SourceRaster| {
        onto_frame::registered(raster, &crs, frame, params.resampling, reporter)
    };
    let (chm_m, dsm_m) = (register(&chm)?, register(&dsm)?);
    Ok(CloudTerrain { chm_m, dsm_m, terrain })
}

/// The units of the cloud's coordinates and heights.
fn units(
    cloud: &PointCloud,
    crs: &Crs,
    path: &Path,
    params: &ImportParams,
    reporter: &Reporter,
) -> Result<(LengthUnit, LengthUnit), ImportError> {
    let horizontal = if *crs == Crs::Local {
        params.horizontal_unit.unwrap_or(LengthUnit::Metre)
    } else {
        let projection = Projection::new(crs)
            .map_err(|source| ImportError::Crs { path: path.to_path_buf(), source })?;
        if projection.is_geographic() {
            return Err(ImportError::CloudInDegrees { path: path.to_path_buf() });
        }
        projection.foot().unwrap_or(LengthUnit::Metre)
    };
    let known = params.vertical_unit.or(cloud.vertical_unit);
    if known.is_none() && horizontal != LengthUnit::Metre {
        reporter.warn(Warning::VerticalUnitAssumedFeet { path: path.to_path_buf() });
    }
    Ok((horizontal, known.unwrap_or(horizontal)))
}

fn source_raster(surface: Grid<f32>, crs: &Crs, horizontal: LengthUnit) -> SourceRaster {
    let frame = std::sync::Arc::clone(surface.frame());
    let (t, unit_m) = (frame.transform, horizontal.metres());
    let affine = Affine {
        origin_x: t.west_m / unit_m,
        origin_y: t.north_m / unit_m,
        col_dx: t.cell_m / unit_m,
        col_dy: 0.0,
        row_dx: 0.0,
        row_dy: -t.cell_m / unit_m,
    };
    let valid = surface.mask().as_slice().to_vec();
    SourceRaster {
        rows: frame.rows,
        cols: frame.cols,
        affine,
        crs: Some(crs.clone()),
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

    #[test]
    fn a_cloud_in_degrees_is_refused() {
        let cloud = cloud(Some(Crs::Epsg(4326)), [10.0, 45.0], LengthUnit::Metre);
        let error =
            run(cloud, Path::new("deg.laz"), &ImportParams::default(), None, &Reporter::silent());
        assert!(matches!(error, Err(ImportError::CloudInDegrees { .. })));
    }
}
