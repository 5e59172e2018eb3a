//! Colour ramps suited to their quantity, and the range of values a ramp is spread over.
//!
//! All but [`Ramp::TEMPERATURE`] rise or fall in luminance from end to end, so that they read in grey and with any
//! colour vision; temperature runs from blue to red over a light middle, a pair all colour-blind readers tell apart.

/// A colour in sRGB, 0..=255 a channel.
pub type Rgb = [u8; 3];

/// Colours at even steps from the lowest value to the highest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    stops: &'static [Rgb],
}

impl Ramp {
    /// Elevation: valley sage over meadow and straw to pale rock; darker is lower.
    pub const ELEVATION: Self = Self {
        stops: &[
            [112, 143, 118],
            [139, 164, 124],
            [176, 184, 136],
            [207, 199, 155],
            [221, 206, 173],
            [231, 222, 203],
            [244, 241, 234],
        ],
    };
    /// Sunlight: dark violet over rose to yellow; darker is shadier.
    pub const SUNLIGHT: Self = Self {
        stops: &[
            [45, 27, 78],
            [91, 43, 110],
            [142, 62, 114],
            [192, 88, 100],
            [228, 127, 79],
            [245, 176, 73],
            [252, 229, 120],
        ],
    };
    /// Moisture: tan over teal to deep blue; darker is wetter.
    pub const MOISTURE: Self = Self {
        stops: &[
            [240, 226, 194],
            [213, 212, 176],
            [161, 193, 168],
            [98, 164, 163],
            [48, 127, 153],
            [28, 85, 131],
            [20, 45, 94],
        ],
    };
    /// Temperature: blue over pale sand to red.
    pub const TEMPERATURE: Self = Self {
        stops: &[
            [58, 92, 148],
            [112, 149, 184],
            [175, 197, 205],
            [236, 229, 213],
            [228, 184, 152],
            [207, 127, 103],
            [165, 66, 66],
        ],
    };
    /// Canopy height: pale straw over leaf green to dark teal; darker is taller.
    pub const CANOPY_HEIGHT: Self = Self {
        stops: &[
            [244, 239, 222],
            [221, 222, 168],
            [168, 197, 116],
            [103, 164, 88],
            [48, 124, 82],
            [22, 83, 76],
            [12, 44, 58],
        ],
    };
    /// Slope: white over sand to brown; darker is steeper.
    pub const SLOPE: Self = Self {
        stops: &[
            [251, 248, 240],
            [237, 222, 192],
            [217, 184, 140],
            [184, 139, 98],
            [139, 95, 68],
            [84, 54, 44],
        ],
    };

    /// The colour at a place along the ramp, 0 the first stop, 1 the last; clamped.
    pub fn color(&self, place: f32) -> [f32; 3] {
        let last = self.stops.len() - 1;
        let along = place.clamp(0.0, 1.0) * last as f32;
        let stop = (along as usize).min(last - 1);
        let t = along - stop as f32;
        std::array::from_fn(|channel| {
            let (a, b) = (self.stops[stop][channel], self.stops[stop + 1][channel]);
            f32::from(a) + t * (f32::from(b) - f32::from(a))
        })
    }
}

/// The values between which a ramp is spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Value at the ramp's first colour.
    pub low: f32,
    /// Value at the ramp's last colour.
    pub high: f32,
}

impl Spread {
    /// From the 2nd to the 98th percentile, so that a few odd cells do not spend the ramp; `None` without values.
    pub fn robust(values: impl Iterator<Item = f32>) -> Option<Self> {
        let mut sorted: Vec<f32> = values.collect();
        let last = sorted.len().checked_sub(1)?;
        let mut percentile = |share: f64| {
            let at = (share * last as f64).round() as usize; // 0..=last
            *sorted.select_nth_unstable_by(at, f32::total_cmp).1
        };
        Some(Self { low: percentile(0.02), high: percentile(0.98) })
    }

    /// Place of a value along the ramp; ½ where all values are alike. May lie outside 0..=1.
    pub fn place(&self, value: f32) -> f32 {
        let span = self.high - self.low;
        if span > 0.0 { (value - self.low) / span } else { 0.5 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance by Rec. 709 with gamma 2.2.
    fn luminance(color: [f32; 3]) -> f32 {
        let linear = color.map(|c| crate::math::powf(c / 255.0, 2.2));
        0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    }

    #[test]
    fn ends_are_the_end_colours_and_values_beyond_are_clamped() {
        assert_eq!(Ramp::SUNLIGHT.color(0.0), [45.0, 27.0, 78.0]);
        assert_eq!(Ramp::SUNLIGHT.color(1.0), [252.0, 229.0, 120.0]);
        assert_eq!(Ramp::SLOPE.color(-3.0), Ramp::SLOPE.color(0.0));
        assert_eq!(Ramp::SLOPE.color(9.0), [84.0, 54.0, 44.0]);
    }

    #[test]
    fn luminance_is_monotone_where_claimed() {
        for (ramp, sign) in [
            (Ramp::ELEVATION, 1.0),
            (Ramp::SUNLIGHT, 1.0),
            (Ramp::MOISTURE, -1.0),
            (Ramp::CANOPY_HEIGHT, -1.0),
            (Ramp::SLOPE, -1.0),
        ] {
            for i in 0..64 {
                let (a, b) = (i as f32 / 64.0, (i + 1) as f32 / 64.0);
                let step = luminance(ramp.color(b)) - luminance(ramp.color(a));
                assert!(sign * step > 0.0, "{ramp:?} at {a}");
            }
        }
    }

    #[test]
    fn percentiles_leave_odd_cells_out() {
        let values = (0..=100).map(|i| if i == 100 { 1e6 } else { i as f32 });
        assert_eq!(Spread::robust(values), Some(Spread { low: 2.0, high: 98.0 }));
        assert_eq!(Spread::robust(std::iter::empty()), None);
        let flat = Spread::robust([4.0; 9].into_iter()).unwrap();
        assert_eq!(flat.place(4.0), 0.5);
    }
}
