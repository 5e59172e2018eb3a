//! Visibility: which crown the sky sees at each working cell, and how much of each crown it sees.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2: a top-down orthographic rendering of the crowns' spheres.

use rayon::prelude::*;

use super::crowns::{Crowns, disk_rows, disk_span, middle_units, whole_root};

/// Cells under no crown.
pub const NO_CROWN: u32 = u32::MAX;

/// What the sky sees. A cell belongs to the crown whose sphere is highest at the cell's centre; between equals, to the
/// crown with the lower index. A centre counts as under a crown if its distance from the trunk is at most the radius.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Visibility {
    /// The crown seen at each working cell, row-major from the north-west, [`NO_CROWN`] where none.
    pub owner: Vec<u32>,
    /// Cells seen of each crown.
    pub visible_cells: Vec<u32>,
    /// Cells seen of each crown that are canopy.
    pub canopy_cells: Vec<u32>,
    /// Sum over those canopy cells of columns east of the trunk's cell.
    pub sum_cols: Vec<i32>,
    /// Sum over those canopy cells of rows south of the trunk's cell.
    pub sum_rows: Vec<i32>,
}

/// The grid of working cells: its size, and which cells are canopy.
#[derive(Clone, Copy, Debug)]
pub struct CanopyCells<'a> {
    /// Rows of the grid.
    pub rows: usize,
    /// Columns of the grid.
    pub cols: usize,
    /// Whether a cell is canopy, row-major.
    pub is_canopy: &'a [bool],
}

/// Renders crowns; the twins on CPU and GPU give equal results, bit for bit, because all of it is whole numbers.
pub trait RenderVisibility: Sync {
    /// Fills `visibility` with what the sky sees of `crowns`.
    ///
    /// # Errors
    /// A text that says what failed, where the device can fail.
    fn render(
        &mut self,
        crowns: &Crowns,
        cells: CanopyCells<'_>,
        visibility: &mut Visibility,
    ) -> Result<(), String>;
}

/// Rows that one thread draws at a time. chosen: depths and owners of 64 rows of 1,000–4,000 cells fit the second-level
/// cache, and few crowns reach over two bands.
const BAND_ROWS: usize = 64;

/// The renderer that defines what is seen: a depth buffer, band by band.
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuVisibility;

/// What one crown shows in one band.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    visible_cells: u32,
    canopy_cells: u32,
    sum_cols: i32,
    sum_rows: i32,
}

impl RenderVisibility for CpuVisibility {
    fn render(
        &mut self,
        crowns: &Crowns,
        cells: CanopyCells<'_>,
        visibility: &mut Visibility,
    ) -> Result<(), String> {
        let CanopyCells { rows, cols, is_canopy } = cells;
        visibility.owner.clear();
        visibility.owner.resize(rows * cols, NO_CROWN);
        let bands = crowns_by_band(crowns, rows);
        let seen: Vec<Vec<Seen>> = visibility
            .owner
            .par_chunks_mut((BAND_ROWS * cols).max(1))
            .zip(&bands)
            .enumerate()
            .map(|(band, (owner, listed))| {
                let first_row = band * BAND_ROWS;
                draw_band(crowns, listed, first_row, cols, owner);
                let canopy = &is_canopy[first_row * cols..][..owner.len()];
                count_band(crowns, listed, first_row, cols, owner, canopy)
            })
            .collect();
        gather(crowns.len(), &bands, &seen, visibility);
        Ok(())
    }
}

/// Crowns that reach into each band, in rising order.
fn crowns_by_band(crowns: &Crowns, rows: usize) -> Vec<Vec<u32>> {
    let mut bands = vec![Vec::new(); rows.div_ceil(BAND_ROWS)];
    for index in 0..crowns.len() {
        let reached = disk_rows(crowns.y[index], crowns.radius[index], rows);
        if reached.is_empty() {
            continue;
        }
        for band in &mut bands[reached.start / BAND_ROWS..=(reached.end - 1) / BAND_ROWS] {
            band.push(index as u32); // crowns are fewer than cells, and those are fewer than 2³²
        }
    }
    bands
}

/// Draws a band's crowns; `owner` then holds places in `listed`, [`NO_CROWN`] where none reaches.
fn draw_band(crowns: &Crowns, listed: &[u32], first_row: usize, cols: usize, owner: &mut [u32]) {
    let band_rows = owner.len() / cols.max(1);
    let mut depth = vec![i32::MIN; owner.len()];
    for (place, &index) in (0_u32..).zip(listed) {
        let index = index as usize;
        let (x, y, radius) = (crowns.x[index], crowns.y[index], crowns.radius[index]);
        let center_z = crowns.center_z[index];
        let reached = disk_rows(y, radius, first_row + band_rows);
        for row in reached.start.max(first_row)..reached.end {
            let span = disk_span(x, y, radius, row, cols);
            let dy = middle_units(row) - y;
            let rest = radius * radius - dy * dy;
            let start = (row - first_row) * cols;
            let cells = start + span.first_col..start + span.end_col;
            let first_dx = middle_units(span.first_col) - x;
            let pairs = depth[cells.clone()].iter_mut().zip(&mut owner[cells]);
            for ((deepest, owner), step) in pairs.zip(0_i32..) {
                let dx = first_dx + step * super::crowns::UNITS_PER_CELL;
                let z = center_z + whole_root(rest - dx * dx);
                // listed in rising order: the lower index keeps a cell among equals
                let is_higher = z > *deepest;
                *deepest = if is_higher { z } else { *deepest };
                *owner = if is_higher { place } else { *owner };
            }
        }
    }
}

/// Counts what each listed crown shows in a band, and turns `owner` from places in the list to crowns.
fn count_band(
    crowns: &Crowns,
    listed: &[u32],
    first_row: usize,
    cols: usize,
    owner: &mut [u32],
    is_canopy: &[bool],
) -> Vec<Seen> {
    let mut seen = vec![Seen::default(); listed.len()];
    let trunk_cell =
        |units: &[i32], index: u32| units[index as usize].div_euclid(super::crowns::UNITS_PER_CELL);
    let trunks: Vec<[i32; 2]> =
        listed.iter().map(|&i| [trunk_cell(&crowns.x, i), trunk_cell(&crowns.y, i)]).collect();
    let rows = owner.chunks_mut(cols.max(1)).zip(is_canopy.chunks(cols.max(1)));
    for (row, (owner, is_canopy)) in (first_row..).zip(rows) {
        for (col, (owner, is_canopy)) in owner.iter_mut().zip(is_canopy).enumerate() {
            if *owner == NO_CROWN {
                continue;
            }
            let place = *owner as usize;
            let crown = &mut seen[place];
            crown.visible_cells += 1;
            if *is_canopy {
                crown.canopy_cells += 1;
                crown.sum_cols += col as i32 - trunks[place][0]; // within a crown's width
                crown.sum_rows += row as i32 - trunks[place][1];
            }
            *owner = listed[place];
        }
    }
    seen
}

/// Adds up what each crown shows in all bands.
fn gather(len: usize, bands: &[Vec<u32>], seen: &[Vec<Seen>], visibility: &mut Visibility) {
    for counts in [&mut visibility.visible_cells, &mut visibility.canopy_cells] {
        counts.clear();
        counts.resize(len, 0);
    }
    for sums in [&mut visibility.sum_cols, &mut visibility.sum_rows] {
        sums.clear();
        sums.resize(len, 0);
    }
    for (listed, seen) in bands.iter().zip(seen) {
        for (&index, crown) in listed.iter().zip(seen) {
            let index = index as usize;
            visibility.visible_cells[index] += crown.visible_cells;
            visibility.canopy_cells[index] += crown.canopy_cells;
            visibility.sum_cols[index] += crown.sum_cols;
            visibility.sum_rows[index] += crown.sum_rows;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::crowns::UNITS_PER_CELL;
    use super::*;
    use crate::rng::{Key, Process, words};

    /// The definition, cell by cell.
    fn plainly(crowns: &Crowns, cells: CanopyCells<'_>) -> Visibility {
        let mut seen = Visibility {
            owner: vec![NO_CROWN; cells.rows * cells.cols],
            visible_cells: vec![0; crowns.len()],
            canopy_cells: vec![0; crowns.len()],
            sum_cols: vec![0; crowns.len()],
            sum_rows: vec![0; crowns.len()],
        };
        for cell in 0..seen.owner.len() {
            let (row, col) = (cell / cells.cols, cell % cells.cols);
            let mut highest = i32::MIN;
            for i in 0..crowns.len() {
                let (dx, dy) = (middle_units(col) - crowns.x[i], middle_units(row) - crowns.y[i]);
                let rest = crowns.radius[i].pow(2) - dx * dx - dy * dy;
                if rest >= 0 && crowns.center_z[i] + whole_root(rest) > highest {
                    highest = crowns.center_z[i] + whole_root(rest);
                    seen.owner[cell] = i as u32;
                }
            }
            if seen.owner[cell] != NO_CROWN {
                let i = seen.owner[cell] as usize;
                seen.visible_cells[i] += 1;
                if cells.is_canopy[cell] {
                    seen.canopy_cells[i] += 1;
                    seen.sum_cols[i] += col as i32 - crowns.x[i].div_euclid(UNITS_PER_CELL);
                    seen.sum_rows[i] += row as i32 - crowns.y[i].div_euclid(UNITS_PER_CELL);
                }
            }
        }
        seen
    }

    fn strewn(count: u64, rows: usize, cols: usize) -> Crowns {
        let mut crowns = Crowns::default();
        for entity in 0..count {
            let process = Process::StrewnPoints;
            let [a, b, c, d] = words(Key { seed: 3, process, year: 0, month: 0, entity });
            crowns.x.push((a % (cols as u32 * 32)) as i32);
            crowns.y.push((b % (rows as u32 * 32)) as i32);
            crowns.radius.push(1 + (c % 300) as i32);
            crowns.center_z.push((d % 900) as i32);
        }
        crowns
    }

    #[test]
    fn bands_show_what_the_definition_says() {
        for (rows, cols, count) in
            [(150, 90, 400), (1, 40, 12), (64, 64, 90), (65, 7, 3), (9, 9, 0)]
        {
            let crowns = strewn(count, rows, cols);
            let is_canopy: Vec<bool> = (0..rows * cols).map(|i| i % 3 != 0).collect();
            let cells = CanopyCells { rows, cols, is_canopy: &is_canopy };
            let mut seen = Visibility::default();
            CpuVisibility.render(&crowns, cells, &mut seen).unwrap();
            assert_eq!(seen, plainly(&crowns, cells), "{rows} × {cols}");
        }
    }

    #[test]
    fn one_crown_shows_its_disk() {
        let is_canopy = vec![true; 100 * 100];
        let cells = CanopyCells { rows: 100, cols: 100, is_canopy: &is_canopy };
        let crowns = Crowns { x: vec![1600], y: vec![1616], radius: vec![640], center_z: vec![7] };
        let mut seen = Visibility::default();
        CpuVisibility.render(&crowns, cells, &mut seen).unwrap();
        // πr² with r = 20 cells is 1256.6 cells; a lattice circle is off by a few of its rim
        assert!((1250..1264).contains(&seen.visible_cells[0]), "{}", seen.visible_cells[0]);
        assert_eq!(seen.visible_cells, seen.canopy_cells);
        // x on a cell's west edge: as many centres east as west, counted from the cell's index
        assert_eq!(seen.sum_rows[0], 0);
        assert_eq!(2 * seen.sum_cols[0], -(seen.canopy_cells[0] as i32));
    }

    #[test]
    fn the_taller_of_two_covers_the_middle_between_them() {
        let is_canopy = vec![true; 20 * 40];
        let cells = CanopyCells { rows: 20, cols: 40, is_canopy: &is_canopy };
        let crowns = Crowns {
            x: vec![480, 800],
            y: vec![320, 320],
            radius: vec![250, 250],
            center_z: vec![0, 100],
        };
        let mut seen = Visibility::default();
        CpuVisibility.render(&crowns, cells, &mut seen).unwrap();
        assert!(seen.visible_cells[1] > seen.visible_cells[0]);
        assert!(seen.sum_cols[0] < 0, "the lower one is pushed away");
    }
}
