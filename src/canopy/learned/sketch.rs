//! Sketch: painted density, and its colours.

use crate::raster::Grid;

/// How dense somebody wants the forest.
///
/// # Reference
/// Kapp et al. 2020, section 4: three types of region, P.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Density {
    /// No trees.
    Empty = 0,
    /// Single trees and groups: canopy on about 10–35 % of the ground.
    Sparse = 1,
    /// Woods; where stands are low, open ones.
    Dense = 2,
}

impl Density {
    /// All densities, by their code.
    pub const ALL: [Self; 3] = [Self::Empty, Self::Sparse, Self::Dense];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::Sparse => "sparse",
            Self::Dense => "dense",
        }
    }

    /// The density of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|density| density.name() == name)
    }

    /// The density of a raster's code: 0, 1, 2.
    pub fn from_code(code: f32) -> Option<Self> {
        Self::ALL.into_iter().find(|density| f32::from(*density as u8) == code)
    }
}

/// Painted density on coarse cells.
pub type Sketch = Grid<Density>;

/// Colours of paint: black, grey, white as a mask of density; sand, light green, dark green as a map.
pub const PALETTE: [(Density, [u8; 3]); 6] = [
    (Density::Empty, [0, 0, 0]),
    (Density::Sparse, [128, 128, 128]),
    (Density::Dense, [255, 255, 255]),
    (Density::Empty, [244, 231, 197]),
    (Density::Sparse, [144, 238, 144]),
    (Density::Dense, [0, 100, 0]),
];

/// Colours differ from the palette's by at most this in each channel. chosen: programs that manage colours shift them by
/// a few. Black is black alone: a picture of the codes 0, 1, 2 is nearly black all over.
const TOLERANCE: u8 = 12;

/// The density painted by a colour; what is transparent is empty. `None` for other colours and for thin paint.
pub fn density_of_colour([red, green, blue, alpha]: [u8; 4]) -> Option<Density> {
    if alpha <= TOLERANCE {
        return Some(Density::Empty);
    }
    if alpha < u8::MAX - TOLERANCE {
        return None;
    }
    let near = |a: u8, b: u8| a.abs_diff(b) <= TOLERANCE;
    if [red, green, blue].iter().all(|channel| near(*channel, 0)) {
        return ([red, green, blue] == [0; 3]).then_some(Density::Empty);
    }
    let found =
        PALETTE.iter().find(|(_, [r, g, b])| near(red, *r) && near(green, *g) && near(blue, *b));
    found.map(|(density, _)| *density)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_near_the_palette_are_paint_and_others_are_not() {
        for (density, [r, g, b]) in PALETTE {
            assert_eq!(density_of_colour([r, g, b, 255]), Some(density));
            if g > 0 {
                let shifted = [r.saturating_sub(9), g.saturating_add(9), b, 250];
                assert_eq!(density_of_colour(shifted), Some(density));
            }
        }
        // codes, and paint that is half transparent
        assert_eq!([1, 2].map(|v| density_of_colour([v, v, v, 255])), [None; 2]);
        assert_eq!(density_of_colour([255, 255, 255, 100]), None);
        assert_eq!(density_of_colour([200, 30, 30, 255]), None);
        assert_eq!(density_of_colour([200, 30, 30, 0]), Some(Density::Empty));
    }

    #[test]
    fn no_two_paints_can_be_taken_for_each_other() {
        for (i, (_, a)) in PALETTE.iter().enumerate() {
            for (_, b) in &PALETTE[i + 1..] {
                assert!((0..3).any(|k| a[k].abs_diff(b[k]) > 2 * TOLERANCE));
            }
        }
    }

    #[test]
    fn names_and_codes_lead_back() {
        for density in Density::ALL {
            assert_eq!(Density::from_name(density.name()), Some(density));
            assert_eq!(Density::from_code(f32::from(density as u8)), Some(density));
        }
        assert_eq!(Density::from_code(1.5), None);
    }
}
