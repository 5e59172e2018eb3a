//! Several tiles as one raster: copied where their grids fit, laid over each other where not.

use std::path::PathBuf;

use super::framing::Lattice;
use crate::raster::warp::Warped;
use crate::raster::{Affine, SourceRaster};

/// A raster and the file it came from.
#[derive(Clone, Debug)]
pub struct NamedRaster {
    /// The file, as messages name it.
    pub path: PathBuf,
    /// What the file holds.
    pub raster: SourceRaster,
}

/// Tiles disagree where they differ by more than this, metres; chosen: twice the vertical error that
/// LiDAR specifications allow on vegetated ground (USGS Lidar Base Specification: 0.3 m RMS), rounded up.
const DISAGREE_M: f32 = 1.0;

/// Rows from the north, columns from the west, by turning over what is not; moves no cell.
pub fn upright(mut raster: SourceRaster) -> SourceRaster {
    let SourceRaster { rows, cols, affine, .. } = raster;
    if cols == 0 || affine.col_dy != 0.0 || affine.row_dx != 0.0 {
        return raster;
    }
    if affine.row_dy > 0.0 {
        for row in 0..rows / 2 {
            for col in 0..cols {
                raster.values.swap(row * cols + col, (rows - 1 - row) * cols + col);
                raster.valid.swap(row * cols + col, (rows - 1 - row) * cols + col);
            }
        }
        raster.affine.origin_y += rows as f64 * affine.row_dy;
        raster.affine.row_dy = -affine.row_dy;
    }
    if affine.col_dx < 0.0 {
        raster.values.chunks_mut(cols).for_each(<[f32]>::reverse);
        raster.valid.chunks_mut(cols).for_each(<[bool]>::reverse);
        raster.affine.origin_x += cols as f64 * affine.col_dx;
        raster.affine.col_dx = -affine.col_dx;
    }
    raster
}

/// Tiles in their order, cut where one does not continue the grid of the one before.
pub fn groups_on_one_lattice(tiles: Vec<NamedRaster>) -> Vec<Vec<NamedRaster>> {
    let mut groups: Vec<Vec<NamedRaster>> = Vec::new();
    for tile in tiles {
        let lattice = Lattice::of(&tile.raster);
        let fits = groups
            .last()
            .is_some_and(|group| Lattice::of(&group[0].raster).offset_of(&lattice).is_some());
        match groups.last_mut() {
            Some(group) if fits => group.push(tile),
            _ => groups.push(vec![tile]),
        }
    }
    groups
}

/// Rows and columns of the raster around tiles on one lattice, and the first tile's place in it.
fn union(group: &[NamedRaster]) -> (i64, i64, i64, i64) {
    let first = Lattice::of(&group[0].raster);
    let (mut top, mut left, mut bottom, mut right) = (0, 0, 0, 0);
    for tile in group {
        let lattice = Lattice::of(&tile.raster);
        let (row, col) = first.offset_of(&lattice).unwrap_or((0, 0));
        // rasters in memory have fewer cells than i64 counts
        (top, left) = (row.min(top), col.min(left));
        (bottom, right) =
            (bottom.max(row + lattice.rows as i64), right.max(col + lattice.cols as i64));
    }
    (bottom - top, right - left, -top, -left)
}

/// Rows and columns of the raster around tiles on one lattice.
///
/// # Panics
/// If the group is empty.
pub fn union_size(group: &[NamedRaster]) -> [f64; 2] {
    let (rows, cols, ..) = union(group);
    [rows as f64, cols as f64]
}

/// Tiles on one lattice as one raster, and in how many cells they disagree; the first named wins.
///
/// # Panics
/// If the group is empty.
pub fn join(mut group: Vec<NamedRaster>) -> (SourceRaster, usize) {
    assert!(!group.is_empty(), "a mosaic needs a tile");
    if group.len() == 1 {
        return (group.swap_remove(0).raster, 0);
    }
    let (rows, cols, top, left) = union(&group);
    // not negative, and the caller bounds the cells
    let (rows, cols, top, left) = (rows as usize, cols as usize, top as usize, left as usize);
    let first = Lattice::of(&group[0].raster);
    let affine = Affine {
        origin_x: first.affine.origin_x - left as f64 * first.affine.col_dx,
        origin_y: first.affine.origin_y - top as f64 * first.affine.row_dy,
        ..first.affine
    };
    let mut whole = Warped { values: vec![0.0; rows * cols], valid: vec![false; rows * cols] };
    let mut disagreements = 0;
    for tile in &group {
        let lattice = Lattice::of(&tile.raster);
        let (row, col) = first.offset_of(&lattice).unwrap_or((0, 0));
        // the union's first row and column make both sums not negative
        let (row, col) = ((row + top as i64) as usize, (col + left as i64) as usize);
        for tile_row in 0..lattice.rows {
            let to = (row + tile_row) * cols + col..(row + tile_row) * cols + col + lattice.cols;
            let from = tile_row * lattice.cols..(tile_row + 1) * lattice.cols;
            disagreements += lay(
                &mut whole.values[to.clone()],
                &mut whole.valid[to],
                &tile.raster.values[from.clone()],
                &tile.raster.valid[from],
            );
        }
    }
    let first = group.swap_remove(0).raster;
    (
        SourceRaster { rows, cols, affine, values: whole.values, valid: whole.valid, ..first },
        disagreements,
    )
}

/// Lays `below` under `above` on one frame; returns in how many cells they disagree.
pub fn lay_under(above: &mut Warped, below: &Warped) -> usize {
    lay(&mut above.values, &mut above.valid, &below.values, &below.valid)
}

fn lay(values: &mut [f32], valid: &mut [bool], below: &[f32], below_valid: &[bool]) -> usize {
    let mut disagreements = 0;
    for (i, (&value, &is_valid)) in below.iter().zip(below_valid).enumerate() {
        if !is_valid {
            continue;
        }
        if !valid[i] {
            (values[i], valid[i]) = (value, true);
        } else if (values[i] - value).abs() > DISAGREE_M {
            disagreements += 1;
        }
    }
    disagreements
}

/// The cells of `raster` that lie in `frame`, bit for bit; `offset` is the place of the raster's first
/// cell in the frame ([`Lattice::offset_of`]).
pub fn cut(raster: SourceRaster, (row, col): (i64, i64), frame: &Lattice) -> Warped {
    let lattice = Lattice::of(&raster);
    if (row, col, lattice.rows, lattice.cols) == (0, 0, frame.rows, frame.cols) {
        return Warped { values: raster.values, valid: raster.valid };
    }
    let cells = frame.rows * frame.cols;
    let mut cut = Warped { values: vec![0.0; cells], valid: vec![false; cells] };
    // overlap in columns of the frame; sizes and offsets fit i64
    let first = col.clamp(0, frame.cols as i64);
    let end = (col + lattice.cols as i64).clamp(first, frame.cols as i64);
    for frame_row in 0..frame.rows {
        let Ok(tile_row) = usize::try_from(frame_row as i64 - row) else { continue };
        if tile_row >= lattice.rows || first == end {
            continue;
        }
        let to = frame_row * frame.cols + first as usize..frame_row * frame.cols + end as usize;
        let start = tile_row * lattice.cols + (first - col) as usize;
        let from = start..start + to.len();
        cut.values[to.clone()].copy_from_slice(&raster.values[from.clone()]);
        cut.valid[to].copy_from_slice(&raster.valid[from]);
    }
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(row: usize, col: usize, rows: usize, cols: usize) -> NamedRaster {
        let affine = Affine {
            origin_x: 5000.5 + 2.0 * col as f64,
            origin_y: 9000.0 - 2.0 * row as f64,
            col_dx: 2.0,
            col_dy: 0.0,
            row_dx: 0.0,
            row_dy: -2.0,
        };
        let value = |i: usize| ((row + i / cols) * 100 + col + i % cols) as f32 * 0.1;
        let raster = SourceRaster {
            rows,
            cols,
            affine,
            crs: None,
            vertical_unit: None,
            latitude_deg: None,
            crs_problem: None,
            values: (0..rows * cols).map(value).collect(),
            valid: (0..rows * cols).map(|i| !(row * 3 + col + i).is_multiple_of(17)).collect(),
            non_finite_cells: 0,
        };
        NamedRaster { path: format!("{row}_{col}.tif").into(), raster }
    }

    #[test]
    fn four_quarters_make_the_whole() {
        let mut whole = tile(0, 0, 9, 11);
        whole.raster.valid.fill(true);
        let mut quarters =
            vec![tile(5, 4, 4, 7), tile(0, 4, 5, 7), tile(5, 0, 4, 4), tile(0, 0, 5, 4)];
        quarters.iter_mut().for_each(|q| q.raster.valid.fill(true));
        let groups = groups_on_one_lattice(quarters);
        assert_eq!(groups.len(), 1);
        assert_eq!(union_size(&groups[0]), [9.0, 11.0]);
        let (joined, disagreements) = join(groups.into_iter().next().unwrap());
        assert_eq!(disagreements, 0);
        assert_eq!(joined.values, whole.raster.values);
        assert_eq!(joined.valid, whole.raster.valid);
        assert_eq!(joined.affine, whole.raster.affine);
    }

    #[test]
    fn the_first_named_wins_and_gaps_are_filled_from_the_next() {
        let (mut first, mut second) = (tile(0, 0, 3, 3), tile(0, 0, 3, 3));
        first.raster.valid.fill(true);
        second.raster.valid.fill(true);
        first.raster.values.fill(1.0);
        second.raster.values = vec![1.5, 1.5, 9.0, 9.0, 9.0, 1.5, 1.5, 1.5, 1.5];
        first.raster.valid[4] = false;
        let (joined, disagreements) = join(vec![first, second]);
        assert_eq!(disagreements, 2);
        assert_eq!(joined.values, [1.0, 1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn a_tile_off_the_grid_begins_a_group_and_keeps_its_turn() {
        let mut off = tile(0, 3, 3, 3);
        off.raster.affine.origin_x += 1.0;
        let groups = groups_on_one_lattice(vec![tile(0, 0, 3, 3), off, tile(3, 0, 3, 3)]);
        assert_eq!(groups.iter().map(Vec::len).collect::<Vec<_>>(), [1, 1, 1]);
    }

    #[test]
    fn cutting_copies_what_overlaps() {
        let source = tile(2, 2, 4, 4);
        let frame = Lattice::of(&tile(0, 3, 4, 9).raster);
        let cut_to = |frame: &Lattice| {
            let offset = frame.offset_of(&Lattice::of(&source.raster)).unwrap();
            cut(source.raster.clone(), offset, frame)
        };
        let cut_out = cut_to(&frame);
        assert!(!cut_out.valid[..18].contains(&true));
        assert_eq!(cut_out.values[18..21], source.raster.values[1..4]);
        assert_eq!(cut_out.valid[27..30], source.raster.valid[5..8]);
        assert!(!cut_out.valid[30..].contains(&true));
        // beside it: nothing
        for (row, col, rows, cols) in [(0, 30, 4, 9), (2, 0, 4, 1), (20, 2, 3, 3)] {
            assert!(
                !cut_to(&Lattice::of(&tile(row, col, rows, cols).raster)).valid.contains(&true)
            );
        }
    }

    #[test]
    fn rasters_are_turned_upright() {
        let right = tile(0, 0, 3, 4).raster;
        let mut wrong = right.clone();
        wrong.values.reverse();
        wrong.valid.reverse();
        let a = right.affine;
        wrong.affine = Affine {
            origin_x: a.origin_x + 8.0,
            origin_y: a.origin_y - 6.0,
            col_dx: -2.0,
            row_dy: 2.0,
            ..a
        };
        let turned = upright(wrong);
        assert_eq!((turned.values, turned.valid, turned.affine), (right.values, right.valid, a));
    }
}
