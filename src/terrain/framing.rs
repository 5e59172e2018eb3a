//! Which coordinate system and which grid a scene gets from its tiles.

use super::import::ImportError;
use crate::raster::resample::CellPosition;
use crate::raster::warp::{Target, map_coordinates, signed_cell_area};
use crate::raster::{
    Affine, Crs, CrsError, Frame, GeoTransform, MapWindow, Projection, Projector, SourceRaster,
    utm_zone_for,
};

/// Size and place of a raster as its file has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Map position.
    pub affine: Affine,
}

/// Two lattices are one, and a cell is square, where cells stray by no more than this share of a
/// cell over the whole raster; chosen: headers print coordinates to millimetres, cells are metres.
const ALIGNED_TO_CELLS: f64 = 0.01;

impl Lattice {
    /// The lattice of a raster.
    pub fn of(raster: &SourceRaster) -> Self {
        Self { rows: raster.rows, cols: raster.cols, affine: raster.affine }
    }

    /// Map coordinates of the middle.
    pub fn middle(&self) -> [f64; 2] {
        let (row, col) = (self.rows as f64 / 2.0, self.cols as f64 / 2.0);
        map_coordinates(&self.affine, CellPosition { row, col })
    }

    /// Whether columns run east and rows run south, exactly enough.
    pub fn is_north_up(&self) -> bool {
        let a = &self.affine;
        let strayed = (a.col_dy.abs() * self.cols as f64 / a.row_dy.abs())
            .max(a.row_dx.abs() * self.rows as f64 / a.col_dx.abs());
        a.col_dx > 0.0 && a.row_dy < 0.0 && strayed <= ALIGNED_TO_CELLS
    }

    /// Whether cells are `cell` wide and high, exactly enough for this many.
    pub fn has_square_cells_of(&self, cell: f64) -> bool {
        let off = |step: f64, count: usize| (step - cell).abs() * count as f64 / cell;
        off(self.affine.col_dx, self.cols) <= ALIGNED_TO_CELLS
            && off(-self.affine.row_dy, self.rows) <= ALIGNED_TO_CELLS
    }

    /// Where `other`'s first cell lies in this lattice, if it is the same lattice going on.
    pub fn offset_of(&self, other: &Self) -> Option<(i64, i64)> {
        let (a, b) = (&self.affine, &other.affine);
        let as_wide = (a.col_dx - b.col_dx).abs() * other.cols as f64 / a.col_dx.abs();
        let as_high = (a.row_dy - b.row_dy).abs() * other.rows as f64 / a.row_dy.abs();
        let row = (b.origin_y - a.origin_y) / a.row_dy;
        let col = (b.origin_x - a.origin_x) / a.col_dx;
        let off = [as_wide, as_high, (row - row.round()).abs(), (col - col.round()).abs()];
        let aligned = self.is_north_up()
            && other.is_north_up()
            && off.into_iter().all(|off| off <= ALIGNED_TO_CELLS);
        // i64 holds whole numbers of cells below 2^53
        (aligned && row.abs().max(col.abs()) < 9e15)
            .then(|| (row.round() as i64, col.round() as i64))
    }
}

/// The scene's CRS and the ways between it and the tiles'.
pub struct Placement {
    /// The scene's CRS: metric EPSG, or local.
    pub crs: Crs,
    /// From the tiles' CRS to the scene's, `None` if they are one.
    pub to_scene: Option<Projector>,
    /// From the scene's CRS to the tiles'.
    pub to_source: Option<Projector>,
}

/// A metric CRS whose scale is off by more than this is left for UTM. chosen: every national grid is
/// within 1.5 %, Web Mercator is not beyond 14° of latitude, and slopes bear 3 %.
const SCALE_TOLERANCE: f64 = 0.03;

impl Placement {
    /// The scene's CRS for tiles in `source`, around `middle` (coordinates in `source`).
    ///
    /// Kept are local metres and EPSG systems in metres whose scale is right at `middle`; all else
    /// (degrees, feet, PROJ strings, Web Mercator) becomes the local UTM zone on WGS 84.
    ///
    /// # Errors
    /// [`CrsError`] if the CRS has no formulas or `middle` does not lie in it.
    pub fn new(source: &Crs, middle: [f64; 2]) -> Result<Self, CrsError> {
        let kept = |crs: &Crs| Self { crs: crs.clone(), to_scene: None, to_source: None };
        if *source == Crs::Local {
            return Ok(kept(source));
        }
        let projection = Projection::new(source)?;
        if projection.is_metric() && matches!(source, Crs::Epsg(_)) {
            let (least, most) = projection.scale_range(middle)?;
            if least >= 1.0 - SCALE_TOLERANCE && most <= 1.0 + SCALE_TOLERANCE {
                return Ok(kept(source));
            }
        }
        let [longitude_deg, latitude_deg] = projection.lon_lat_deg(middle)?;
        let crs = utm_zone_for(longitude_deg, latitude_deg)?;
        Ok(Self {
            to_scene: Some(Projector::new(source, &crs)?),
            to_source: Some(Projector::new(&crs, source)?),
            crs,
        })
    }

    /// The window around a lattice in the scene's CRS, metres; `None` where part of it has no place.
    pub fn extent(&self, lattice: &Lattice) -> Option<MapWindow> {
        /// Edges bend when projected; chosen: 32 parts leave a bend of 1e-3 of that of the whole.
        const EDGE_PARTS: usize = 32;
        let (rows, cols) = (lattice.rows as f64, lattice.cols as f64);
        let parts = if self.to_scene.is_some() { EDGE_PARTS } else { 1 };
        let around = (0..=parts).flat_map(|part| {
            let t = part as f64 / parts as f64;
            [(0.0, t * cols), (rows, t * cols), (t * rows, 0.0), (t * rows, cols)]
        });
        let mut window: Option<MapWindow> = None;
        for (row, col) in around {
            let [x, y] =
                self.to_scene(map_coordinates(&lattice.affine, CellPosition { row, col }))?;
            let point = MapWindow { west: x, south: y, east: x, north: y };
            window = Some(window.map_or(point, |w| w.union(&point)));
        }
        window
    }

    /// Side of a square as large as the lattice's middle cell, metres; `None` where it has no place.
    pub fn cell_side_m(&self, lattice: &Lattice) -> Option<f64> {
        let [x, y] = lattice.middle();
        let a = &lattice.affine;
        let at = self.to_scene([x, y])?;
        let right = self.to_scene([x + a.col_dx, y + a.col_dy])?;
        let down = self.to_scene([x + a.row_dx, y + a.row_dy])?;
        let area = (right[0] - at[0]) * (down[1] - at[1]) - (right[1] - at[1]) * (down[0] - at[0]);
        Some(area.abs().sqrt())
    }

    fn to_scene(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        match &self.to_scene {
            Some(projector) => projector.project(point),
            None => Some(point),
        }
    }
}

/// Cells of a scene: width, and a corner that lies on the lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellLattice {
    cell_m: f64,
    corner: [f64; 2],
}

impl CellLattice {
    /// The lattice of a scene whose first tile is `first`; `cell_m` overrides the cell's width.
    ///
    /// A square north-up tile in the scene's CRS keeps its lattice. Cells wider or narrower by a whole
    /// factor keep the tile's lines, so that they are whole blocks; all others lie on whole multiples
    /// of their width, so that neighbouring scenes fit. Cells of warped or oblong tiles are as large as
    /// the tile's middle cell, to two digits (within 5 %).
    ///
    /// `None` where the tile's middle has no place.
    pub fn new(placement: &Placement, first: &Lattice, cell_m: Option<f64>) -> Option<Self> {
        let a = &first.affine;
        let corner = [a.origin_x, a.origin_y];
        let side_m = signed_cell_area(a).abs().sqrt();
        if placement.to_scene.is_none()
            && first.is_north_up()
            && first.has_square_cells_of(a.col_dx)
        {
            let wanted_m = cell_m.unwrap_or(a.col_dx);
            if first.has_square_cells_of(wanted_m) {
                return Some(Self { cell_m: a.col_dx, corner });
            }
            let factor = (wanted_m / a.col_dx).max(a.col_dx / wanted_m);
            // how far the tile's lines lie past multiples of its cells, rounding errors aside
            let phase = |x: f64| x - (x / a.col_dx + 1e-6).floor() * a.col_dx;
            let whole = (factor - factor.round()).abs() < 1e-6;
            let corner = if whole { corner.map(phase) } else { [0.0; 2] };
            return Some(Self { cell_m: wanted_m, corner });
        }
        let is_square = {
            let length = |x: f64, y: f64| (x * x + y * y).sqrt();
            let (width, height) = (length(a.col_dx, a.col_dy), length(a.row_dx, a.row_dy));
            (width - height).abs() < 1e-6 * width
        };
        let own_m = if placement.to_scene.is_none() && is_square {
            side_m
        } else {
            two_digits(placement.cell_side_m(first)?)
        };
        Some(Self { cell_m: cell_m.unwrap_or(own_m), corner: [0.0; 2] })
    }

    /// Width of a cell, metres.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// The frame of the cells whose middles lie in `window`.
    ///
    /// # Errors
    /// The number of rows and columns, if there are more than `max_cells` or none.
    pub fn frame(
        &self,
        window: &MapWindow,
        crs: &Crs,
        max_cells: usize,
    ) -> Result<Frame, (f64, f64)> {
        let lines = |low: f64, high: f64, corner: f64| {
            let first = ((low - corner) / self.cell_m).round();
            (first, ((high - corner) / self.cell_m).round() - first)
        };
        let (first_col, cols) = lines(window.west, window.east, self.corner[0]);
        let (first_row, rows) = lines(-window.north, -window.south, -self.corner[1]);
        if !(rows >= 1.0 && cols >= 1.0 && rows * cols <= max_cells as f64) {
            return Err((rows, cols));
        }
        let transform = GeoTransform {
            west_m: self.corner[0] + first_col * self.cell_m,
            north_m: self.corner[1] - first_row * self.cell_m,
            cell_m: self.cell_m,
        };
        // whole and below max_cells
        Ok(Frame { rows: rows as usize, cols: cols as usize, transform, crs: crs.clone() })
    }
}

/// `x` to two significant digits.
fn two_digits(x: f64) -> f64 {
    // formatting rounds in decimal, exactly
    format!("{x:.1e}").parse().unwrap_or(x)
}

/// A frame as a target of resampling.
pub fn target_of(frame: &Frame) -> Target {
    Target { rows: frame.rows, cols: frame.cols, transform: frame.transform }
}

/// A frame as a lattice.
pub fn lattice_of(frame: &Frame) -> Lattice {
    let t = &frame.transform;
    let affine = Affine {
        origin_x: t.west_m,
        origin_y: t.north_m,
        col_dx: t.cell_m,
        col_dy: 0.0,
        row_dx: 0.0,
        row_dy: -t.cell_m,
    };
    Lattice { rows: frame.rows, cols: frame.cols, affine }
}

/// Refuses map positions no raster can have.
///
/// # Errors
/// [`ImportError::Georeference`] for coordinates that are not finite and cells without area.
pub fn check_affine(path: &std::path::Path, affine: &Affine) -> Result<(), ImportError> {
    let a = affine;
    let numbers = [a.origin_x, a.origin_y, a.col_dx, a.col_dy, a.row_dx, a.row_dy];
    let problem = if numbers.iter().any(|n| !n.is_finite()) {
        "its map position is not finite"
    } else if signed_cell_area(a) == 0.0 {
        "its cells have no area"
    } else {
        return Ok(());
    };
    Err(ImportError::Georeference { path: path.to_path_buf(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice(rows: usize, cols: usize, origin: [f64; 2], cell: f64) -> Lattice {
        let affine = Affine {
            origin_x: origin[0],
            origin_y: origin[1],
            col_dx: cell,
            col_dy: 0.0,
            row_dx: 0.0,
            row_dy: -cell,
        };
        Lattice { rows, cols, affine }
    }

    #[test]
    fn metric_grids_stay_and_others_become_utm() {
        let crs = |code, middle| Placement::new(&Crs::Epsg(code), middle).unwrap().crs;
        assert_eq!(crs(3794, [564_500.0, 146_500.0]), Crs::Epsg(3794));
        assert_eq!(crs(5070, [1_833_825.0, 2_617_605.0]), Crs::Epsg(5070));
        assert_eq!(crs(4326, [15.0, 46.0]), Crs::Epsg(32633));
        assert_eq!(crs(2227, [6_000_000.0, 2_100_000.0]), Crs::Epsg(32610));
        // Web Mercator's metres are 0.7 m at 46° N
        assert_eq!(crs(3857, [1_670_000.0, 5_780_000.0]), Crs::Epsg(32633));
        let unnamed = Crs::Proj("+proj=utm +zone=33 +datum=WGS84".to_owned());
        assert_eq!(Placement::new(&unnamed, [5e5, 5e6]).unwrap().crs, Crs::Epsg(32633));
    }

    #[test]
    fn a_square_tile_keeps_its_lattice_to_the_bit() {
        let tile = lattice(10, 20, [563_999.5, 146_999.5], 1.0);
        let placement = Placement::new(&Crs::Epsg(3794), tile.middle()).unwrap();
        let cells = CellLattice::new(&placement, &tile, None).unwrap();
        let frame = cells.frame(&placement.extent(&tile).unwrap(), &placement.crs, 200).unwrap();
        assert_eq!(lattice_of(&frame), tile);
        assert_eq!(
            cells.frame(&placement.extent(&tile).unwrap(), &placement.crs, 199),
            Err((10.0, 20.0))
        );
    }

    #[test]
    fn wider_cells_are_whole_blocks_on_lines_that_neighbours_share() {
        let placement = Placement::new(&Crs::Local, [0.0; 2]).unwrap();
        let frame = |west: f64| {
            let tile = lattice(8, 8, [west, 100.5], 1.0);
            let cells = CellLattice::new(&placement, &tile, Some(4.0)).unwrap();
            cells.frame(&placement.extent(&tile).unwrap(), &Crs::Local, 1000).unwrap()
        };
        let (first, second) = (frame(1000.5), frame(1008.5));
        assert_eq!((first.transform.west_m, first.cols), (1000.5, 2));
        assert_eq!(second.transform.west_m, 1008.5);
        // 2.5 is no whole factor of 1: multiples of 2.5
        let tile = lattice(10, 10, [1.0, 10.0], 1.0);
        let cells = CellLattice::new(&placement, &tile, Some(2.5)).unwrap();
        let frame = cells.frame(&placement.extent(&tile).unwrap(), &Crs::Local, 1000).unwrap();
        assert_eq!((frame.transform.west_m, frame.transform.north_m), (0.0, 10.0));
    }

    #[test]
    fn cells_of_an_arc_second_have_two_digits() {
        let second = 1.0 / 3600.0;
        let tile = lattice(360, 360, [15.0, 46.1], second);
        let placement = Placement::new(&Crs::Epsg(4326), tile.middle()).unwrap();
        // 30.88 m × 21.50 m
        assert_eq!(CellLattice::new(&placement, &tile, None).unwrap().cell_m(), 26.0);
    }

    #[test]
    fn tiles_fit_or_do_not() {
        let first = lattice(10, 10, [1000.0, 1000.0], 2.0);
        assert_eq!(first.offset_of(&lattice(10, 10, [1020.0, 980.0], 2.0)), Some((10, 10)));
        assert_eq!(first.offset_of(&lattice(10, 10, [1020.005, 980.0], 2.0)), Some((10, 10)));
        assert_eq!(first.offset_of(&lattice(10, 10, [1021.0, 980.0], 2.0)), None);
        assert_eq!(first.offset_of(&lattice(10, 10, [1020.0, 980.0], 1.0)), None);
        let mut turned = first;
        turned.affine.col_dy = 0.1;
        assert_eq!(first.offset_of(&turned), None);
    }

    #[test]
    fn windows_meet_or_do_not() {
        let window = |west, east| MapWindow { west, south: 0.0, east, north: 1.0 };
        assert_eq!(window(0.0, 2.0).intersection(&window(1.0, 3.0)), Some(window(1.0, 2.0)));
        assert_eq!(window(0.0, 1.0).intersection(&window(1.0, 3.0)), None);
        assert_eq!(window(0.0, 1.0).union(&window(2.0, 3.0)), window(0.0, 3.0));
    }
}
