//! Vigor of a species by month: how well its ground, light and water suit it, for twelve months at a time.
//!
//! The least of several adaptations is the adaptation at the greatest distance, because adaptation only falls with
//! distance from the ideal. So the bell is worked out once a month, not once a month for each of the four resources.

use super::plot::GroundCell;
use super::traits::Traits;
use crate::raster::MONTHS;
use crate::species::niche::{self, Tolerance};

/// Half widths from the ideal beyond which nothing changes: the bell is below 10⁻¹⁵ there.
const FARTHEST: f32 = 2.0;
/// Half widths from the ideal beyond which adaptation is not above 0: (ln 6 / ln 5)^(1/4.5) = 1.0242, and a little more.
const NO_VIGOR: f32 = 1.0243;
/// log₂ of the share of the bell left at one half width, log₂ 0.2.
const LOG2_BELL_AT_HALF_WIDTH: f32 = -2.321_928;

// the square root below is this exponent's
const _: () = assert!(niche::BELL_EXPONENT == 4.5 && niche::BELL_AT_HALF_WIDTH == 0.2);

/// A tolerance with its width as a factor.
#[derive(Clone, Copy, Debug)]
pub struct Scaled {
    ideal: f32,
    per_half_width: f32,
}

impl Scaled {
    pub fn of(tolerance: Tolerance) -> Self {
        Self { ideal: tolerance.ideal, per_half_width: 1.0 / tolerance.half_width }
    }

    /// Distance of a value from the ideal in half widths.
    #[inline]
    fn distance(self, value: f32) -> f32 {
        (value - self.ideal).abs() * self.per_half_width
    }
}

/// What a place offers month by month: its ground, and light and water as others leave them.
#[derive(Clone, Copy)]
pub struct Offer<'a> {
    ground: &'a GroundCell,
    sun_h: [f32; MONTHS],
    water_mm: [f32; MONTHS],
}

impl<'a> Offer<'a> {
    #[inline]
    pub fn new(ground: &'a GroundCell, light_fraction: f32, water_mm: [f32; MONTHS]) -> Self {
        let mut sun_h = ground.sun_h;
        sun_h.iter_mut().for_each(|hours| *hours *= light_fraction);
        Self { ground, sun_h, water_mm }
    }

    /// Vigor by month, in −0.2..=1.
    ///
    /// # Reference
    /// Peytavie et al. 2024, Eqs. 3–4, as [`niche::Niche::vigor`], to within 10⁻⁵.
    #[inline]
    pub fn vigor(&self, traits: &Traits) -> [f32; MONTHS] {
        let slope = traits.slope_rad.distance(self.ground.slope_rad);
        let mut vigor = [0.0; MONTHS];
        for (month, vigor) in vigor.iter_mut().enumerate() {
            let light = traits.sun_h.distance(self.sun_h[month]);
            let water = traits.moisture_mm.distance(self.water_mm[month]);
            let warmth = traits.temperature_c.distance(self.ground.temperature_c[month]);
            *vigor = adaptation(larger(larger(light, water), larger(warmth, slope)));
        }
        vigor
    }

    /// What the months span.
    #[inline]
    pub fn year(&self) -> Year {
        let slope_rad = self.ground.slope_rad;
        let spans = [
            span(&self.sun_h),
            span(&self.water_mm),
            span(&self.ground.temperature_c),
            [slope_rad, slope_rad],
        ];
        Year { least: spans.map(|[least, _]| least), most: spans.map(|[_, most]| most) }
    }
}

/// Least and most that a year offers of sun, water, warmth and slope.
#[derive(Clone, Copy)]
pub struct Year {
    least: [f32; 4],
    most: [f32; 4],
}

/// What a species bears of sun, water, warmth and slope.
pub struct Limits {
    ideal: [f32; 4],
    /// Distance from the ideal beyond which vigor is not above 0.
    reach: [f32; 4],
}

impl Limits {
    pub fn of(traits: &Traits) -> Self {
        let all = [traits.sun_h, traits.moisture_mm, traits.temperature_c, traits.slope_rad];
        Self {
            ideal: all.map(|scaled| scaled.ideal),
            reach: all.map(|scaled| NO_VIGOR / scaled.per_half_width),
        }
    }

    /// Whether vigor may be above 0 in some month of a year; if not, it is so in none.
    #[inline]
    pub fn may_suit(&self, year: &Year) -> bool {
        let mut within = true;
        for resource in 0..4 {
            let ideal = self.ideal[resource];
            let outside = larger(year.least[resource] - ideal, ideal - year.most[resource]);
            within &= outside < self.reach[resource];
        }
        within
    }
}

/// Least and most of twelve months.
#[inline]
fn span(months: &[f32; MONTHS]) -> [f32; 2] {
    // four at a time, as registers hold them
    let fold = |of: fn(f32, f32) -> f32| {
        let four: [f32; 4] =
            std::array::from_fn(|m| of(of(months[m], months[m + 4]), months[m + 8]));
        of(of(four[0], four[1]), of(four[2], four[3]))
    };
    [fold(smaller), fold(larger)]
}

/// [`niche::adaptation`] at a distance in half widths, to within 10⁻⁵, without branches or calls.
#[inline]
fn adaptation(distance: f32) -> f32 {
    let distance = if distance < FARTHEST { distance } else { FARTHEST };
    let squared = distance * distance;
    let bell = exp2(LOG2_BELL_AT_HALF_WIDTH * (squared * squared * distance.sqrt()));
    (1.0 + niche::MOST_STRESS) * bell - niche::MOST_STRESS
}

/// 2 to a power in −120..=0, with a relative error below 10⁻⁶.
///
/// # Reference
/// The polynomial meets (2ˣ − 1)/x at the five Chebyshev nodes of −½..½.
#[inline]
fn exp2(power: f32) -> f32 {
    // 1.5·2²³: added to a number it leaves its whole part, rounded, in the low bits
    const WHOLE: f32 = 12_582_912.0;
    const ONE_EXPONENT: u32 = 127;
    let shifted = power + WHOLE;
    let x = power - (shifted - WHOLE);
    let high = 0.055_503_81 + x * (0.009_666_368 + x * 0.001_338_130_3);
    let fraction = 1.0 + x * (std::f32::consts::LN_2 + x * (0.240_223_5 + x * high));
    fraction * f32::from_bits(shifted.to_bits().wrapping_add(ONE_EXPONENT) << 23)
}

/// The larger of two numbers that are not NaN.
#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two numbers that are not NaN.
#[inline]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::super::Parameters;
    use super::*;
    use crate::species::Biome;

    #[test]
    fn adaptation_is_the_niche_s_function() {
        for step in 0..3000 {
            let distance = step as f32 * 0.001;
            let (got, want) = (adaptation(distance), niche::adaptation(distance, 0.0, 1.0));
            assert!((got - want).abs() < 2e-6, "{distance}: {got} for {want}");
        }
        assert_eq!(adaptation(0.0), niche::adaptation(0.0, 0.0, 1.0));
        assert_eq!(adaptation(1e9), -niche::MOST_STRESS);
        assert!(adaptation(NO_VIGOR) < 0.0 && adaptation(NO_VIGOR - 2e-4) > 0.0);
    }

    #[test]
    fn vigor_is_the_least_adaptation_of_each_month() {
        let biome = Biome::builtin("sonoma").unwrap();
        let month = |m: usize| m as f32;
        let ground = GroundCell {
            sun_h: std::array::from_fn(|m| 3.0 + 0.9 * month(m)),
            moisture_mm: [0.0; MONTHS],
            temperature_c: std::array::from_fn(|m| 5.0 + 2.0 * month(m)),
            slope_rad: 0.3,
        };
        let water_mm = std::array::from_fn(|m| 10.0 * month(m));
        for (traits, species) in
            Traits::of(&biome, &Parameters::kapp2020()).iter().zip(&biome.species)
        {
            let offer = Offer::new(&ground, 0.7, water_mm);
            let vigor = offer.vigor(traits);
            for m in 0..MONTHS {
                let (sun_h, temperature_c) = (0.7 * ground.sun_h[m], ground.temperature_c[m]);
                let want = species.niche.vigor(sun_h, water_mm[m], temperature_c, 0.3);
                assert!((vigor[m] - want).abs() < 1e-5, "{m}: {} for {want}", vigor[m]);
            }
        }
    }
    #[test]
    fn a_year_that_suits_in_no_month_is_told_by_what_it_spans() {
        let biome = Biome::builtin("sonoma").unwrap();
        let all = Traits::of(&biome, &Parameters::kapp2020());
        let (mut suited, mut told) = (0, 0);
        for step in 0..4000_u16 {
            let [light, wet, warm, steep] =
                [7, 11, 13, 17].map(|n| f32::from(step % n) / f32::from(n));
            let ground = GroundCell {
                sun_h: std::array::from_fn(|m| 4.0 + 0.5 * m as f32),
                moisture_mm: [0.0; MONTHS],
                temperature_c: std::array::from_fn(|m| 30.0 * warm + 0.8 * m as f32),
                slope_rad: steep,
            };
            let water_mm = std::array::from_fn(|m| 200.0 * wet - 4.0 * m as f32);
            let offer = Offer::new(&ground, light, water_mm);
            for traits in &all {
                let suits = offer.vigor(traits).iter().any(|vigor| *vigor > 0.0);
                let may_suit = Limits::of(traits).may_suit(&offer.year());
                assert!(may_suit || !suits);
                suited += usize::from(suits);
                told += usize::from(!may_suit);
            }
        }
        assert!(suited > 1000 && told > 1000, "{suited} {told}");
    }
}
