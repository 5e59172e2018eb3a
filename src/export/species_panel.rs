//! Species map in pixels: the colours of the species that stand in each.

use rayon::prelude::*;

use crate::canopy::species_map::{NO_SPECIES, SpeciesMap};
use crate::species::Biome;

/// Land where no species stands.
const BARE: [f32; 3] = [238.0, 234.0, 222.0];
/// Samples a pixel on each side; borders between species lie smoothly.
const SAMPLES: usize = 3;

/// Colours of `rows` × `cols` pixels over the same ground, 0..=255 a channel; `None` where masked.
pub fn colors(
    species: &SpeciesMap,
    biome: &Biome,
    rows: usize,
    cols: usize,
) -> Vec<Option<[f32; 3]>> {
    let frame = species.frame();
    let cell = |pixel: usize, sample: usize, pixels: usize, cells: usize| {
        (pixel * SAMPLES + sample) * cells / (pixels * SAMPLES) + cells / (2 * pixels * SAMPLES)
    };
    let color = |pixel: usize| {
        let (row, col) = (pixel / cols, pixel % cols);
        let (mut light, mut seen) = ([0.0_f32; 3], 0.0_f32);
        for sample in 0..SAMPLES * SAMPLES {
            let r = cell(row, sample / SAMPLES, rows, frame.rows).min(frame.rows - 1);
            let c = cell(col, sample % SAMPLES, cols, frame.cols).min(frame.cols - 1);
            let index = r * frame.cols + c;
            if !species.mask().is_valid(index) {
                continue;
            }
            let code = match species.values()[index] {
                NO_SPECIES => BARE,
                found => biome.species[usize::from(found)].color_srgb.map(f32::from),
            };
            seen += 1.0;
            for (light, code) in light.iter_mut().zip(code) {
                *light += code * code;
            }
        }
        let half = (SAMPLES * SAMPLES) as f32 / 2.0;
        (seen > half).then(|| light.map(|l| (l / seen).sqrt()))
    };
    (0..rows * cols).into_par_iter().map(color).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::raster::{Frame, Grid, Mask};

    #[test]
    fn species_keep_their_colours_and_places() {
        let biome = Biome::builtin("sonoma").unwrap();
        // west species 8, east none, the last row masked
        let frame = Frame::local(4, 4, 1.0);
        let mask = Mask::new((0..16).map(|i| i < 12).collect());
        let values = (0..16).map(|i| if i % 4 < 2 { 8 } else { NO_SPECIES }).collect();
        let map = Grid::new(Arc::new(frame), Arc::new(mask), values);
        for size in [4, 40] {
            let colors = colors(&map, &biome, size, size);
            assert_eq!(colors[0], Some(biome.species[8].color_srgb.map(f32::from)));
            assert_eq!(colors[size - 1], Some(BARE));
            assert_eq!(colors[size * size - 1], None);
        }
        assert_eq!(colors(&map, &biome, 1, 1).len(), 1);
    }
}
