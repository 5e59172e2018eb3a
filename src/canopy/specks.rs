//! Specks: patches of a species too small to be a stand go to the species around them that can stand there.

use std::ops::Range;

use rayon::prelude::*;

/// Stands for no species.
pub(super) const NOBODY: u8 = u8::MAX;

/// Most rounds. chosen: filling a patch can cut another in two; the third round finds next to nothing.
const MOST_ROUNDS: usize = 4;

/// Rows that are worked on together.
const BAND_ROWS: usize = 64;

/// Cells of one row and one species, side by side.
#[derive(Clone, Copy, Debug)]
struct Run {
    row: usize,
    first_col: usize,
    end_col: usize,
    species: u8,
}

/// Gives patches of fewer than `least_cells` cells to the species that borders them most among those for which
/// `can_take(cell, own, species)` holds all over the patch; where there is none, cell by cell. Cells are joined by their
/// sides. What nobody around can take stays. Returns the number of cells that changed hands.
pub(super) fn remove(
    map: &mut [u8],
    cols: usize,
    least_cells: usize,
    can_take: impl Fn(usize, u8, u8) -> bool,
) -> usize {
    let mut changed = 0;
    for _ in 0..MOST_ROUNDS {
        let patches = small_patches(map, cols, least_cells);
        let changed_now: usize =
            patches.iter().map(|patch| give_away(map, cols, patch, &can_take)).sum();
        changed += changed_now;
        if changed_now == 0 {
            break;
        }
    }
    changed
}

/// Patches of fewer than `least_cells` cells, in the order of their first cells.
fn small_patches(map: &[u8], cols: usize, least_cells: usize) -> Vec<Vec<Run>> {
    let bands = map.par_chunks((BAND_ROWS * cols).max(1)).enumerate();
    let runs_of_bands: Vec<Vec<Run>> =
        bands.map(|(band, cells)| runs(cells, cols, band * BAND_ROWS)).collect();
    let runs = runs_of_bands.concat();
    let mut parents: Vec<usize> = (0..runs.len()).collect();
    let (mut above, mut start) = (0..0, 0);
    while start < runs.len() {
        let row = runs[start].row;
        let end = start + runs[start..].iter().take_while(|run| run.row == row).count();
        let follows = above.start < above.end && runs[above.start].row + 1 == row;
        join(&runs, if follows { above } else { 0..0 }, start..end, &mut parents);
        above = start..end;
        start = end;
    }
    let mut cells_of_root = vec![0; runs.len()];
    for (at, run) in runs.iter().enumerate() {
        let root = root(&mut parents, at);
        cells_of_root[root] += run.end_col - run.first_col;
    }
    let mut patch_of_root = vec![usize::MAX; runs.len()];
    let mut patches: Vec<Vec<Run>> = Vec::new();
    for (at, run) in runs.iter().enumerate() {
        let root = root(&mut parents, at);
        if cells_of_root[root] >= least_cells {
            continue;
        }
        if patch_of_root[root] == usize::MAX {
            patch_of_root[root] = patches.len();
            patches.push(Vec::new());
        }
        patches[patch_of_root[root]].push(*run);
    }
    patches
}

/// The runs of some rows, the first of which has the number `first_row`.
fn runs(cells: &[u8], cols: usize, first_row: usize) -> Vec<Run> {
    let mut runs = Vec::new();
    for (row, cells) in (first_row..).zip(cells.chunks(cols.max(1))) {
        let mut first_col = 0;
        while first_col < cols {
            let species = cells[first_col];
            let rest = &cells[first_col..];
            let len = rest.iter().position(|&other| other != species).unwrap_or(rest.len());
            let end_col = first_col + len;
            if species != NOBODY {
                runs.push(Run { row, first_col, end_col, species });
            }
            first_col = end_col;
        }
    }
    runs
}

/// Joins runs of one species that touch across two rows.
fn join(runs: &[Run], above: Range<usize>, here: Range<usize>, parents: &mut [usize]) {
    let mut first = above.start;
    for at in here {
        let run = runs[at];
        while first < above.end && runs[first].end_col <= run.first_col {
            first += 1;
        }
        let mut other = first;
        while other < above.end && runs[other].first_col < run.end_col {
            if runs[other].species == run.species {
                let (a, b) = (root(parents, at), root(parents, other));
                parents[a.max(b)] = a.min(b);
            }
            other += 1;
        }
    }
}

fn root(parents: &mut [usize], mut at: usize) -> usize {
    while parents[at] != at {
        parents[at] = parents[parents[at]];
        at = parents[at];
    }
    at
}

/// Gives one patch away; returns the number of its cells that changed hands.
fn give_away(
    map: &mut [u8],
    cols: usize,
    patch: &[Run],
    can_take: impl Fn(usize, u8, u8) -> bool,
) -> usize {
    let cells: Vec<usize> = patch
        .iter()
        .flat_map(|run| run.row * cols + run.first_col..run.row * cols + run.end_col)
        .collect();
    let Some(own) = patch.first().map(|run| run.species) else { return 0 };
    let mut borders = [0_u32; 256];
    for &cell in &cells {
        neighbours(cell, cols, map.len()).for_each(|near| borders[usize::from(map[near])] += 1);
    }
    let taker = takers(&borders, own).find(|&s| cells.iter().all(|&cell| can_take(cell, own, s)));
    if let Some(taker) = taker {
        cells.iter().for_each(|&cell| map[cell] = taker);
        return cells.len();
    }
    let mut changed = 0;
    for &cell in &cells {
        let mut borders = [0_u32; 256];
        neighbours(cell, cols, map.len()).for_each(|near| borders[usize::from(map[near])] += 1);
        if let Some(taker) = takers(&borders, own).find(|&s| can_take(cell, own, s)) {
            map[cell] = taker;
            changed += 1;
        }
    }
    changed
}

/// Species other than `own` in the order of their borders, longest first.
fn takers(borders: &[u32; 256], own: u8) -> impl Iterator<Item = u8> {
    let mut takers: Vec<u8> =
        (0..NOBODY).filter(|&s| s != own && borders[usize::from(s)] > 0).collect();
    takers.sort_by_key(|&s| (std::cmp::Reverse(borders[usize::from(s)]), s));
    takers.into_iter()
}

/// Cells that share a side with a cell.
pub(super) fn neighbours(cell: usize, cols: usize, cells: usize) -> impl Iterator<Item = usize> {
    let col = cell % cols;
    [
        (cell >= cols).then(|| cell - cols),
        (col > 0).then(|| cell - 1),
        (col + 1 < cols).then_some(cell + 1),
        (cell + cols < cells).then_some(cell + cols),
    ]
    .into_iter()
    .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(text: &str) -> (Vec<u8>, usize) {
        let rows: Vec<&str> = text.split_whitespace().collect();
        let species = |c: u8| if c == b'.' { NOBODY } else { c - b'0' };
        (rows.iter().flat_map(|row| row.bytes().map(species)).collect(), rows[0].len())
    }

    fn cleaned(text: &str, least: usize, can_take: impl Fn(usize, u8) -> bool) -> Vec<u8> {
        let (mut map, cols) = cells(text);
        remove(&mut map, cols, least, |cell, _, to| can_take(cell, to));
        map
    }

    #[test]
    fn specks_go_to_the_species_that_borders_them_most() {
        let map = cleaned("0000 0100 0022 0022", 2, |_, _| true);
        assert_eq!(map, cells("0000 0000 0022 0022").0);
        // a patch of three: longer border with 0
        let map = cleaned("00000 01110 22222 22222", 4, |_, _| true);
        assert_eq!(map, cells("00000 00000 22222 22222").0);
    }

    #[test]
    fn corners_do_not_join() {
        assert_eq!(cleaned("1000 0100 0010 0001", 3, |_, _| true), [0; 16]);
    }

    #[test]
    fn what_cannot_stand_takes_nothing() {
        // 0 cannot stand at cell 5, 2 can
        let map = cleaned("0000 0120 0022 0022", 2, |cell, s| !(cell == 5 && s == 0));
        assert_eq!(map, cells("0000 0220 0022 0022").0);
        // no one can: it stays
        let text = "0000 0100 0000";
        assert_eq!(cleaned(text, 2, |_, _| false), cells(text).0);
        // the patch as a whole cannot, one of its cells can
        let map = cleaned("0000 0110 0000", 3, |cell, _| cell == 5);
        assert_eq!(map, cells("0000 0010 0000").0);
    }

    #[test]
    fn empty_ground_is_no_species() {
        let text = "..0. .... 11..";
        assert_eq!(cleaned(text, 9, |_, _| true), cells(text).0);
    }
}
