//! Points between coordinate reference systems, by the formulas of `proj4rs`.
//!
//! # Accuracy
//! Projections agree with PROJ 9 to 2 µm, both ways. Between datums only the three- and
//! seven-parameter shifts of the definitions are applied, as in PROJ 4: off by a metre or so for most
//! national datums of Europe, 5 m for OSGB 36, 16 m for S-JTSK. Shift grids are not carried: see
//! [`SHIFT_GRIDS`]. Datums of the WGS 84 family (NAD83, ETRS89, GDA2020 …) are taken as one: up to
//! 2 m. All of it moves a warped scene as a whole and bends no terrain. Heights stay over the file's
//! own vertical datum.
//!
//! `proj4rs` takes sines from the system's library, so the last bits of a projected point (1e-9 m) may
//! differ between platforms; [`warp`](super::warp) rounds them away for all but freak positions.

use proj4rs::Proj;
use proj4rs::transform::transform;

use super::{Crs, CrsError, LengthUnit};
use crate::math;

/// Longitude and latitude every projection is reached through.
const WGS84: &str = "+proj=longlat +datum=WGS84 +no_defs";

/// WGS 84 semi-major axis, metres.
const EARTH_AXIS_M: f64 = 6_378_137.0;
/// WGS 84 first eccentricity, squared.
const EARTH_ECCENTRICITY_SQUARED: f64 = 0.006_694_379_990_141_316;

/// Parts of definitions that call for a shift grid, and what stands in for it: NAD27 gets EPSG:1173
/// (conterminous USA, 10 m; up to 30 m elsewhere); NZGD49's definitions carry EPSG:1564 (4 m) already.
pub const SHIFT_GRIDS: [(&str, &str); 2] =
    [("+datum=NAD27", "+ellps=clrk66 +towgs84=-8,160,176"), ("+nadgrids=nzgd2kgrid0005.gsb", "")];

/// A coordinate reference system with its formulas at hand.
///
/// Its coordinates are `[x, y]`: degrees east and north where it [is geographic](Self::is_geographic),
/// else its own unit of length along its own axes.
#[derive(Clone)]
pub struct Projection {
    crs: Crs,
    definition: String,
    lacks_shift_grid: bool,
    proj: Proj,
}

impl Projection {
    /// The formulas of `crs`.
    ///
    /// # Errors
    /// [`CrsError`] for local metres, unknown codes, and systems without formulas here.
    pub fn new(crs: &Crs) -> Result<Self, CrsError> {
        let unsupported = |problem: String| CrsError::Unsupported { crs: crs.to_string(), problem };
        let mut definition = match crs {
            Crs::Local => return Err(CrsError::NoPlace),
            Crs::Proj(text) => text.clone(),
            &Crs::Epsg(code) => {
                let known = u16::try_from(code).ok().and_then(crs_definitions::from_code);
                let known = known.ok_or(CrsError::UnknownEpsg { code })?;
                // the PROJ string does not say so, and proj4rs takes all angles as degrees
                if known.proj4.contains("+proj=longlat") && known.wkt.contains("UNIT[\"grad\"") {
                    return Err(unsupported("angles in grads are not supported".to_owned()));
                }
                known.proj4.to_owned()
            }
        };
        let lacks_shift_grid = SHIFT_GRIDS.iter().any(|(grid, _)| definition.contains(grid));
        for (grid, parameters) in SHIFT_GRIDS {
            definition = definition.replace(grid, parameters);
        }
        let proj = Proj::from_proj_string(&definition)
            .map_err(|e| unsupported(format!("no formulas for `{definition}` ({e})")))?;
        if proj.is_geocent() {
            return Err(unsupported("geocentric coordinates are no map".to_owned()));
        }
        if !(proj.has_inverse() && proj.has_forward()) {
            return Err(unsupported("the projection works in one direction only".to_owned()));
        }
        Ok(Self { crs: crs.clone(), definition, lacks_shift_grid, proj })
    }

    /// The system's name.
    pub fn crs(&self) -> &Crs {
        &self.crs
    }

    /// Whether coordinates are longitude and latitude, in degrees.
    pub fn is_geographic(&self) -> bool {
        self.proj.is_latlong()
    }

    /// Metres in one unit of the coordinates, `None` where they are degrees.
    pub fn metres_per_unit(&self) -> Option<f64> {
        (!self.is_geographic()).then(|| self.proj.to_meter())
    }

    /// The foot that coordinates are in, if they are in feet.
    pub fn foot(&self) -> Option<LengthUnit> {
        foot_of(self.metres_per_unit()?)
    }

    /// The unit of height that the system itself names (compound systems do).
    pub fn vertical_unit(&self) -> Option<LengthUnit> {
        let named = ["+vunits=", "+vto_meter="].iter().any(|key| self.definition.contains(key));
        let metres = self.proj.vto_meter();
        let unit = if metres == 1.0 { Some(LengthUnit::Metre) } else { foot_of(metres) };
        unit.filter(|_| named)
    }

    /// Whether coordinates are metres, eastward and northward.
    pub fn is_metric(&self) -> bool {
        self.metres_per_unit() == Some(1.0) && self.proj.is_normalized_axis()
    }

    /// Whether a shift grid would be needed to place this system exactly.
    pub fn lacks_shift_grid(&self) -> bool {
        self.lacks_shift_grid
    }

    /// Longitude and latitude (WGS 84) of a point, degrees.
    ///
    /// # Errors
    /// [`CrsError::OutsideDomain`] where the system is not defined.
    pub fn lon_lat_deg(&self, point: [f64; 2]) -> Result<[f64; 2], CrsError> {
        let projector = Projector { from: self.clone(), to: wgs84()? };
        projector.project(point).ok_or_else(|| self.outside(point))
    }

    /// Angle from true north to grid north at a point, clockwise positive.
    ///
    /// # Errors
    /// [`CrsError::OutsideDomain`] where the system is not defined.
    pub fn grid_convergence_rad(&self, point: [f64; 2]) -> Result<f64, CrsError> {
        let [_, north] = self.ground_steps(point)?;
        Ok(-math::atan2_f64(north[0], north[1]))
    }

    /// Smallest and largest scale at a point over all directions: map metres a metre of ground.
    ///
    /// # Reference
    /// The semi-axes of Tissot's indicatrix (Snyder 1987, USGS PP 1395, §4), as the singular values
    /// of the Jacobian.
    ///
    /// # Errors
    /// [`CrsError::OutsideDomain`] where the system is not defined, or at a pole.
    pub fn scale_range(&self, point: [f64; 2]) -> Result<(f64, f64), CrsError> {
        let [east, north] = self.ground_steps(point)?;
        let unit_m = self.metres_per_unit().unwrap_or(1.0);
        let squares =
            east[0] * east[0] + east[1] * east[1] + north[0] * north[0] + north[1] * north[1];
        let determinant = (east[0] * north[1] - east[1] * north[0]).abs();
        let sum = (squares + 2.0 * determinant).max(0.0).sqrt();
        let difference = (squares - 2.0 * determinant).max(0.0).sqrt();
        Ok(((sum - difference) / 2.0 * unit_m, (sum + difference) / 2.0 * unit_m))
    }

    /// Where a metre of ground eastward and a metre northward lead, in coordinates.
    fn ground_steps(&self, point: [f64; 2]) -> Result<[[f64; 2]; 2], CrsError> {
        // 1e-4° is 11 m: long enough for f64 at 1e7 m, short enough for a derivative
        const STEP_DEG: f64 = 1e-4;
        let [longitude, latitude] = self.lon_lat_deg(point)?;
        let projector = Projector { from: wgs84()?, to: self.clone() };
        let step = |longitude_step: f64, latitude_step: f64| {
            let ahead =
                projector.project([longitude + longitude_step, latitude + latitude_step])?;
            let behind =
                projector.project([longitude - longitude_step, latitude - latitude_step])?;
            Some([ahead[0] - behind[0], ahead[1] - behind[1]])
        };
        let latitude_rad = latitude.to_radians();
        let sine = math::sin_f64(latitude_rad);
        let flattening = 1.0 - EARTH_ECCENTRICITY_SQUARED * sine * sine;
        let normal_radius_m = EARTH_AXIS_M / flattening.sqrt();
        let meridian_radius_m = normal_radius_m * (1.0 - EARTH_ECCENTRICITY_SQUARED) / flattening;
        let span_rad = 2.0 * STEP_DEG.to_radians();
        let east_m = span_rad * normal_radius_m * math::cos_f64(latitude_rad);
        let north_m = span_rad * meridian_radius_m;
        let (Some(east), Some(north)) = (step(STEP_DEG, 0.0), step(0.0, STEP_DEG)) else {
            return Err(self.outside(point));
        };
        Ok([east.map(|d| d / east_m), north.map(|d| d / north_m)])
    }

    fn outside(&self, point: [f64; 2]) -> CrsError {
        CrsError::OutsideDomain { crs: self.crs.to_string(), x: point[0], y: point[1] }
    }
}

/// The foot of so many metres, to the digits that definitions print.
fn foot_of(metres: f64) -> Option<LengthUnit> {
    let nearest = [LengthUnit::Foot, LengthUnit::UsSurveyFoot]
        .into_iter()
        .min_by(|a, b| (a.metres() - metres).abs().total_cmp(&(b.metres() - metres).abs()))?;
    // Clarke's and the Indian foot differ from the international one by 1e-5: near enough for heights
    ((nearest.metres() - metres).abs() < 1e-5).then_some(nearest)
}

fn wgs84() -> Result<Projection, CrsError> {
    Projection::new(&Crs::Proj(WGS84.to_owned()))
}

/// Takes points of one system into another.
#[derive(Clone)]
pub struct Projector {
    from: Projection,
    to: Projection,
}

impl Projector {
    /// From `from` into `to`.
    ///
    /// # Errors
    /// [`CrsError`] if either has no formulas.
    pub fn new(from: &Crs, to: &Crs) -> Result<Self, CrsError> {
        Ok(Self { from: Projection::new(from)?, to: Projection::new(to)? })
    }

    /// A point `[x, y]` in the other system; `None` where it is not defined there.
    pub fn project(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        let [mut x, mut y] = point;
        if self.from.is_geographic() {
            // beyond a pole there is nothing, and proj4rs would wrap it round
            if y.abs() > 90.0 {
                return None;
            }
            (x, y) = (x.to_radians(), y.to_radians());
        }
        let mut moved = (x, y);
        transform(&self.from.proj, &self.to.proj, &mut moved).ok()?;
        let (mut x, mut y) = moved;
        if self.to.is_geographic() {
            (x, y) = (x.to_degrees(), y.to_degrees());
        }
        (x.is_finite() && y.is_finite()).then_some([x, y])
    }

    /// Whether projected points are longitude and latitude, in degrees.
    pub fn gives_degrees(&self) -> bool {
        self.to.is_geographic()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projection(code: u32) -> Projection {
        Projection::new(&Crs::Epsg(code)).unwrap()
    }

    #[test]
    fn units_are_known() {
        assert!(projection(4326).is_geographic() && projection(4326).metres_per_unit().is_none());
        assert!(projection(32611).is_metric() && projection(32611).foot().is_none());
        assert_eq!(projection(2227).foot(), Some(LengthUnit::UsSurveyFoot));
        assert_eq!(projection(2222).foot(), Some(LengthUnit::Foot));
        assert!(!projection(2227).is_metric());
        // Hartebeesthoek's axes run west and south
        assert!(!projection(2053).is_metric());
        // NAD83 / Oregon South (ft) + NAVD88 height (ftUS): compound systems name a unit of height
        assert_eq!(projection(6340).vertical_unit(), None);
        let compound = Crs::Proj("+proj=utm +zone=10 +datum=NAD83 +vunits=us-ft".to_owned());
        assert_eq!(
            Projection::new(&compound).unwrap().vertical_unit(),
            Some(LengthUnit::UsSurveyFoot)
        );
    }

    #[test]
    fn projections_agree_with_proj() {
        // longitude, latitude (the system's own datum), x, y by PROJ 9.4
        for (code, base, place, expected) in [
            (32611, 4326, [-119.7, 37.1], [260055.19131, 4109377.51243]),
            (3005, 4269, [-127.6, 50.7], [887056.96563, 632955.94905]),
            (3794, 4765, [15.84, 46.455], [564527.18757, 146489.99677]),
            (2949, 4617, [-72.0, 47.6], [192011.85301, 5274515.99798]),
            (5070, 4269, [-72.5, 44.4], [1848017.06021, 2608570.64221]),
            (2227, 4269, [-119.7, 37.1], [6794981.91848, 1859881.38139]),
            (27700, 4277, [-1.5, 54.0], [432771.48088, 456133.38351]),
            (2154, 4171, [2.5, 46.1], [661374.10231, 6555701.20123]),
            (3857, 4326, [15.84, 46.455], [1763300.73417, 5853565.51821]),
        ] {
            let projector = Projector::new(&Crs::Epsg(base), &Crs::Epsg(code)).unwrap();
            let found = projector.project(place).unwrap();
            for axis in 0..2 {
                assert!((found[axis] - expected[axis]).abs() < 1e-4, "EPSG:{code}: {found:?}");
            }
        }
    }

    #[test]
    fn datums_without_their_grid_are_told_apart() {
        assert!(projection(26711).lacks_shift_grid() && projection(4272).lacks_shift_grid());
        assert!(!projection(32611).lacks_shift_grid() && !projection(3857).lacks_shift_grid());
        // NAD27 lies 80 m from NAD83 here: the parameters are applied
        let shift = Projector::new(&Crs::Epsg(4267), &Crs::Epsg(4326)).unwrap();
        let [longitude, _] = shift.project([-119.0, 37.0]).unwrap();
        let moved_m = (longitude + 119.0) * 111_320.0 * 0.7986;
        assert!((moved_m + 85.0).abs() < 10.0, "{moved_m}");
    }

    #[test]
    fn grads_are_refused() {
        // NTF (Paris) counts 400 grads to the circle
        assert!(matches!(Projection::new(&Crs::Epsg(4807)), Err(CrsError::Unsupported { .. })));
    }

    #[test]
    fn there_and_back_is_where_we_were() {
        for (code, point) in [
            (32611, [256_000.0, 4_111_000.0]),
            (3794, [564_500.0, 146_500.0]),
            (2227, [6_000_000.0, 2_100_000.0]),
            (5070, [1_833_825.0, 2_617_605.0]),
            (27700, [430_000.0, 80_000.0]),
        ] {
            let wgs84 = Crs::Epsg(4326);
            let there = Projector::new(&Crs::Epsg(code), &wgs84).unwrap();
            let back = Projector::new(&wgs84, &Crs::Epsg(code)).unwrap();
            let again = back.project(there.project(point).unwrap()).unwrap();
            for axis in 0..2 {
                assert!((again[axis] - point[axis]).abs() < 1e-3, "EPSG:{code}: {again:?}");
            }
        }
    }

    #[test]
    fn convergence_is_positive_east_of_the_central_meridian_in_the_north() {
        // γ = atan(tan Δλ · sin φ) on the sphere; 1e-5 rad for the ellipsoid
        let utm33 = projection(32633);
        for (longitude, latitude) in [(17.0_f64, 46.0_f64), (13.5, 46.0), (15.0, 60.0)] {
            let to_utm = Projector::new(&Crs::Epsg(4326), &Crs::Epsg(32633)).unwrap();
            let point = to_utm.project([longitude, latitude]).unwrap();
            let off_rad = (longitude - 15.0).to_radians();
            let expected =
                math::atan_f64(math::tan_f64(off_rad) * math::sin_f64(latitude.to_radians()));
            let found = utm33.grid_convergence_rad(point).unwrap();
            assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
        }
    }

    #[test]
    fn scale_of_web_mercator_is_that_of_the_latitude() {
        let y_at_60_north = 8_399_737.89;
        let (least, most) = projection(3857).scale_range([0.0, y_at_60_north]).unwrap();
        assert!((least - 2.0).abs() < 0.02 && (most - 2.0).abs() < 0.02, "{least} {most}");
        let (least, most) = projection(32633).scale_range([500_000.0, 5_000_000.0]).unwrap();
        assert!((least - 0.9996).abs() < 1e-6 && (most - 0.9996).abs() < 1e-6, "{least} {most}");
    }

    #[test]
    fn points_beyond_a_system_are_refused() {
        let to_utm = Projector::new(&Crs::Epsg(4326), &Crs::Epsg(32633)).unwrap();
        assert_eq!(to_utm.project([15.0, 91.0]), None);
        assert_eq!(to_utm.project([15.0, f64::NAN]), None);
        assert!(to_utm.project([15.0, 46.0]).is_some());
        assert!(projection(32633).lon_lat_deg([9e12, 0.0]).is_err());
    }
}
