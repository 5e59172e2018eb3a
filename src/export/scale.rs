//! Round numbers for scale bars and legends.

/// The largest of 1, 2, 5 times a power of ten that is not above `limit`; `limit` must be positive.
pub fn round_down(limit: f64) -> f64 {
    assert!(limit > 0.0 && limit.is_finite(), "no round number below {limit}");
    let mut power = 1.0;
    while power > limit {
        power /= 10.0;
    }
    while power * 10.0 <= limit {
        power *= 10.0;
    }
    // dividing by ten piles up rounding errors: 5·power may miss a limit that is itself round
    [5.0, 2.0].into_iter().map(|n| n * power).find(|r| *r <= limit * (1.0 + 1e-9)).unwrap_or(power)
}

/// Round values within `low..=high`, evenly spaced: as many as `at_most` allows.
pub fn ticks(low: f64, high: f64, at_most: usize) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) || at_most == 0 {
        return Vec::new();
    }
    // steps from fine to coarse; the first with few enough ticks
    let mut step = round_down(span / (at_most as f64 + 1.0));
    loop {
        let first = (low / step - 1e-9).ceil();
        let count = ((high / step + 1e-9).floor() - first + 1.0).max(0.0) as usize;
        if count <= at_most {
            return (0..count).map(|i| (first + i as f64) * step).collect();
        }
        step = round_down(step * 2.6); // 1 → 2 → 5 → 10
    }
}

/// A length with its unit: metres below a kilometre, else kilometres.
pub fn length_label(length_m: f64) -> String {
    if length_m >= 1000.0 {
        format!("{} km", trimmed(length_m / 1000.0, 2))
    } else {
        format!("{} m", trimmed(length_m, 2))
    }
}

/// A number with just so many decimals; the minus sign is the typographic one.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

/// Like [`fixed`] without zeros at the end.
pub fn trimmed(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_bars_have_lengths_of_one_two_or_five() {
        for (limit, expected) in [
            (1.0, 1.0),
            (1.99, 1.0),
            (2.0, 2.0),
            (4.7, 2.0),
            (5.0, 5.0),
            (9.99, 5.0),
            (10.0, 10.0),
            (730.0, 500.0),
            (0.3, 0.2),
            (0.05, 0.05),
        ] {
            let got = round_down(limit);
            assert!((got / expected - 1.0).abs() < 1e-9, "{limit}: {got}");
        }
    }

    #[test]
    fn ticks_are_few_round_and_inside() {
        assert_eq!(ticks(203.0, 487.0, 6), [250.0, 300.0, 350.0, 400.0, 450.0]);
        assert_eq!(ticks(-12.0, 13.0, 5), [-10.0, -5.0, 0.0, 5.0, 10.0]);
        assert!(ticks(4.0, 4.0, 5).is_empty());
        for (low, high) in [(0.013, 0.9), (3.0, 3.1), (120.0, 8848.0)] {
            let t = ticks(low, high, 6);
            assert!((2..=6).contains(&t.len()), "{t:?}");
            assert!(t.iter().all(|v| (low..=high).contains(v)));
        }
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!(length_label(500.0), "500 m");
        assert_eq!(length_label(2000.0), "2 km");
        assert_eq!(trimmed(-1.50, 2), "−1.5");
        assert_eq!(trimmed(-0.001, 2), "0");
        assert_eq!(trimmed(100.0, 0), "100");
        assert_eq!(fixed(5.0, 1), "5.0");
        assert_eq!(fixed(-0.04, 1), "0.0");
    }
}
