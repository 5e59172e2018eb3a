//! Strokes: how much of a pixel a straight line covers that may taper, by its distance from the pixel.

/// How a stroke ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// Rounded: a half disc beyond each end.
    Round,
    /// Cut off square.
    Square,
}

/// A straight line with a width, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Where it begins: column, row.
    pub from: [f32; 2],
    /// Where it ends.
    pub to: [f32; 2],
    /// Half its width at both ends; at least half a pixel, thinner lines are paler ones.
    pub half_width: [f32; 2],
    /// How it ends.
    pub ends: Ends,
}

/// A pixel as a stroke sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Share of the pixel that is covered.
    pub coverage: f32,
    /// Place along the stroke, 0..=1.
    pub along: f32,
    /// Place across it in half widths: −1 its left edge, looking along, 1 its right one.
    pub across: f32,
}

/// Coverage of a pixel by its distance inside an edge, in pixels.
pub fn edge(inside_px: f32) -> f32 {
    (inside_px + 0.5).clamp(0.0, 1.0)
}

impl Stroke {
    /// Upper left and lower right corner of what it may touch.
    pub fn bounds(&self) -> [[f32; 2]; 2] {
        let reach = self.half_width[0].max(self.half_width[1]) + 1.0;
        let ([x0, y0], [x1, y1]) = (self.from, self.to);
        [[x0.min(x1) - reach, y0.min(y1) - reach], [x0.max(x1) + reach, y0.max(y1) + reach]]
    }

    /// What the stroke covers of the pixel whose middle is `[x, y]`.
    pub fn touch(&self, [x, y]: [f32; 2]) -> Touch {
        let [dx, dy] = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let [px, py] = [x - self.from[0], y - self.from[1]];
        let length = (dx * dx + dy * dy).sqrt();
        // a stroke without length is a dot
        let [ux, uy] = if length > 0.0 { [dx / length, dy / length] } else { [1.0, 0.0] };
        let (ahead, aside) = (px * ux + py * uy, py * ux - px * uy);
        let along = if length > 0.0 { (ahead / length).clamp(0.0, 1.0) } else { 0.0 };
        let half = self.half_width[0] + along * (self.half_width[1] - self.half_width[0]);
        let beyond = (-ahead).max(ahead - length);
        let coverage = match self.ends {
            Ends::Round => {
                let beyond = beyond.max(0.0);
                edge(half - (aside * aside + beyond * beyond).sqrt())
            }
            Ends::Square => edge(half - aside.abs()) * edge(-beyond),
        };
        Touch { coverage, along, across: aside / half }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum of what a stroke covers of 60 × 60 pixels.
    fn area(stroke: &Stroke) -> f32 {
        let pixels = (0..60 * 60).map(|i| [(i % 60) as f32 + 0.5, (i / 60) as f32 + 0.5]);
        pixels.map(|pixel| stroke.touch(pixel).coverage).sum()
    }

    #[test]
    fn strokes_cover_their_area_in_any_direction() {
        for (to, half_width) in
            [([50.0, 10.0], [0.5, 0.5]), ([41.3, 44.8], [3.0, 3.0]), ([12.0, 52.0], [4.0, 1.0])]
        {
            let from = [10.0, 10.0];
            let stroke = Stroke { from, to, half_width, ends: Ends::Square };
            let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
            let expected = (dx * dx + dy * dy).sqrt() * (half_width[0] + half_width[1]);
            let got = area(&stroke);
            assert!((got / expected - 1.0).abs() < 0.03, "{to:?}: {got} of {expected}");
        }
        let disc = Stroke {
            from: [30.0, 30.0],
            to: [30.0, 30.0],
            half_width: [6.0; 2],
            ends: Ends::Round,
        };
        assert!((area(&disc) / (std::f32::consts::PI * 36.0) - 1.0).abs() < 0.02);
    }

    #[test]
    fn places_along_and_across_are_told() {
        let stroke =
            Stroke { from: [0.0, 0.0], to: [10.0, 0.0], half_width: [2.0; 2], ends: Ends::Round };
        let touch = stroke.touch([5.0, 1.0]);
        assert_eq!((touch.coverage, touch.along, touch.across), (1.0, 0.5, 0.5));
        assert_eq!(stroke.touch([5.0, 3.0]).coverage, 0.0);
        assert_eq!(stroke.bounds(), [[-3.0, -3.0], [13.0, 3.0]]);
    }
}
