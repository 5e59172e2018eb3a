//! Overviews: an image halved until it fits one tile.

use rayon::prelude::*;

/// Rows and columns of the overviews of an image, largest first: halves, rounded up, until both are at most `tile`.
pub(super) fn sizes(rows: usize, cols: usize, tile: usize) -> Vec<(usize, usize)> {
    let mut sizes = Vec::new();
    let (mut rows, mut cols) = (rows, cols);
    while rows.max(cols) > tile {
        (rows, cols) = (rows.div_ceil(2), cols.div_ceil(2));
        sizes.push((rows, cols));
    }
    sizes
}

/// A cell of an overview is valid where one of the four under it is.
pub(super) fn halve_mask(valid: &[bool], cols: usize) -> Vec<bool> {
    let rows = valid.len() / cols;
    let half_cols = cols.div_ceil(2);
    let mut half = vec![false; rows.div_ceil(2) * half_cols];
    for (row, line) in valid.chunks_exact(cols).enumerate() {
        for (col, valid) in line.iter().enumerate() {
            half[row / 2 * half_cols + col / 2] |= valid;
        }
    }
    half
}

/// Halves an image of `valid.len() / cols` rows: each cell is the mean of the valid ones among the four under it.
/// `read` fills a whole row.
pub(super) fn halve(
    valid: &[bool],
    cols: usize,
    read: impl Fn(usize, &mut [f32]) + Sync,
) -> Vec<f32> {
    let rows = valid.len() / cols;
    let half_cols = cols.div_ceil(2);
    let mut half = vec![0.0; rows.div_ceil(2) * half_cols];
    half.par_chunks_mut(half_cols).enumerate().with_min_len(16).for_each_init(
        || (vec![0.0_f32; cols], vec![0.0_f32; half_cols], vec![0.0_f32; half_cols]),
        |(line, sums, counts), (half_row, out)| {
            sums.fill(0.0);
            counts.fill(0.0);
            for row in 2 * half_row..(2 * half_row + 2).min(rows) {
                read(row, line);
                let valid = &valid[row * cols..(row + 1) * cols];
                for (col, (value, valid)) in line.iter().zip(valid).enumerate() {
                    if *valid {
                        sums[col / 2] += value;
                        counts[col / 2] += 1.0;
                    }
                }
            }
            for (out, (sum, count)) in out.iter_mut().zip(sums.iter().zip(counts.iter())) {
                *out = if *count > 0.0 { sum / count } else { 0.0 };
            }
        },
    );
    half
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_halve_and_round_up() {
        assert_eq!(sizes(1000, 1025, 512), [(500, 513), (250, 257)]);
        assert!(sizes(512, 512, 512).is_empty());
    }

    #[test]
    fn means_leave_out_masked_cells() {
        let image = [1.0_f32, 3.0, 10.0, 5.0, 700.0, 20.0, 8.0, 9.0, 30.0];
        let valid = [true, true, true, true, false, true, false, false, true];
        let read =
            |row: usize, line: &mut [f32]| line.copy_from_slice(&image[row * 3..row * 3 + 3]);
        assert_eq!(halve(&valid, 3, read), [3.0, 15.0, 0.0, 30.0]);
        assert_eq!(halve_mask(&valid, 3), [true, true, false, true]);
    }
}
