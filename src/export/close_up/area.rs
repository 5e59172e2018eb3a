//! Area: the square of the map that a close-up shows, as a user names it.

use std::str::FromStr;

use crate::raster::{Frame, MapPoint, MapWindow};

/// Sides a close-up may have. chosen: below, a tree's crown fills it; above, a fern is no pixel wide.
const LEAST_SIZE_M: f64 = 10.0;
/// See [`LEAST_SIZE_M`].
const MOST_SIZE_M: f64 = 200.0;

/// A square of the map, its sides along the map's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    middle: MapPoint,
    size_m: f64,
}

/// Why a square cannot be shown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum AreaError {
    #[error(
        "`{text}` names no area; give the middle's map coordinates and the side in metres, as EAST,NORTH,SIZE"
    )]
    Form { text: String },
    #[error("a side of {size_m} m; give {LEAST_SIZE_M} to {MOST_SIZE_M} m")]
    Size { size_m: f64 },
    #[error(
        "the close-up's middle E {east_m}, N {north_m} lies outside the scene; give E {west_m} to {most_east_m} and N {south_m} to {most_north_m}, map coordinates as GIS programs show them"
    )]
    Outside {
        east_m: f64,
        north_m: f64,
        west_m: f64,
        most_east_m: f64,
        south_m: f64,
        most_north_m: f64,
    },
}

impl Area {
    /// A square of `size_m` a side around a place in map coordinates.
    ///
    /// # Errors
    /// [`AreaError::Size`] for a side that is too short or too long.
    pub fn new(middle: MapPoint, size_m: f64) -> Result<Self, AreaError> {
        if !(LEAST_SIZE_M..=MOST_SIZE_M).contains(&size_m) {
            return Err(AreaError::Size { size_m });
        }
        Ok(Self { middle, size_m })
    }

    /// The middle in map coordinates.
    pub fn middle(&self) -> MapPoint {
        self.middle
    }

    /// Length of a side in metres.
    pub fn size_m(&self) -> f64 {
        self.size_m
    }

    /// The square on the map.
    pub fn window(&self) -> MapWindow {
        let MapPoint { east_m, north_m } = self.middle;
        let half_m = self.size_m / 2.0;
        MapWindow {
            west: east_m - half_m,
            south: north_m - half_m,
            east: east_m + half_m,
            north: north_m + half_m,
        }
    }

    /// Whether the middle lies in a scene with this south-west corner and extent east and north.
    ///
    /// # Errors
    /// [`AreaError::Outside`] if not; the square may reach beyond the scene.
    pub fn check_inside(&self, south_west: MapPoint, extent_m: [f64; 2]) -> Result<(), AreaError> {
        let MapPoint { east_m, north_m } = self.middle;
        let (west_m, south_m) = (south_west.east_m, south_west.north_m);
        let (most_east_m, most_north_m) = (west_m + extent_m[0], south_m + extent_m[1]);
        if (west_m..=most_east_m).contains(&east_m) && (south_m..=most_north_m).contains(&north_m) {
            return Ok(());
        }
        Err(AreaError::Outside { east_m, north_m, west_m, most_east_m, south_m, most_north_m })
    }

    /// Like [`Area::check_inside`], for a scene on `frame`.
    ///
    /// # Errors
    /// [`AreaError::Outside`].
    pub fn check_on(&self, frame: &Frame) -> Result<(), AreaError> {
        let side_m = |cells: usize| cells as f64 * frame.transform.cell_m;
        self.check_inside(frame.south_west(), [side_m(frame.cols), side_m(frame.rows)])
    }
}

/// Middle and side in metres of a square that is given as `EAST,NORTH,SIZE`.
///
/// # Errors
/// [`AreaError::Form`] if these are not three numbers.
pub fn square(text: &str) -> Result<(MapPoint, f64), AreaError> {
    let number = |part: &str| part.trim().parse().ok().filter(|number: &f64| number.is_finite());
    match text.split(',').map(number).collect::<Option<Vec<f64>>>().as_deref() {
        Some(&[east_m, north_m, size_m]) => Ok((MapPoint { east_m, north_m }, size_m)),
        _ => Err(AreaError::Form { text: text.to_owned() }),
    }
}

impl FromStr for Area {
    type Err = AreaError;

    /// `EAST,NORTH,SIZE`: map coordinates of the middle, and the side in metres.
    fn from_str(text: &str) -> Result<Self, AreaError> {
        let (middle, size_m) = square(text)?;
        Self::new(middle, size_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_area_is_three_numbers() {
        let area: Area = "564250.5, -146100,60".parse().unwrap();
        assert_eq!(area.middle(), MapPoint { east_m: 564_250.5, north_m: -146_100.0 });
        assert_eq!(area.size_m(), 60.0);
        assert_eq!(area.window().west, 564_220.5);
        for text in ["", "1,2", "1,2,x", "1,2,30,4", "nan,2,30", "1,inf,30", "1,2,30,", "a,1,2,30"]
        {
            let error = text.parse::<Area>().unwrap_err();
            assert!(matches!(error, AreaError::Form { .. }), "{text}: {error}");
        }
        for text in ["1,2,9.9", "1,2,201", "1,2,-60"] {
            assert!(matches!(text.parse::<Area>(), Err(AreaError::Size { .. })), "{text}");
        }
    }

    #[test]
    fn a_middle_outside_the_scene_is_an_error_that_says_where_the_scene_lies() {
        let frame = Frame::local(50, 100, 2.0);
        for (text, is_inside) in [
            ("0,0,60", true),
            ("200,100,60", true),
            ("200.5,50,60", false),
            ("100,-1,60", false),
            ("1e12,50,60", false),
        ] {
            let checked = text.parse::<Area>().unwrap().check_on(&frame);
            assert_eq!(checked.is_ok(), is_inside, "{text}");
            if let Err(error) = checked {
                assert!(error.to_string().contains("give E 0 to 200 and N 0 to 100"), "{error}");
            }
        }
    }
}
