//! Numbers as short decimal text, fast: fixed digits behind the point, no trailing zeros.

/// Appends `value` with at most `decimals` digits behind the point, rounded half away from zero; what is no number is 0.
pub fn push_decimal(out: &mut Vec<u8>, value: f32, decimals: usize) {
    push_decimal_f64(out, f64::from(value), decimals);
}

/// Appends `value` with at most `decimals` digits behind the point, rounded half away from zero; what is no number is 0.
pub fn push_decimal_f64(out: &mut Vec<u8>, value: f64, decimals: usize) {
    const POWERS: [f64; 7] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6];
    let decimals = decimals.min(POWERS.len() - 1);
    let units = (value * POWERS[decimals]).round() as i64; // `as` ends at the greatest whole numbers
    if units < 0 {
        out.push(b'-');
    }
    let mut rest = units.unsigned_abs();
    let mut behind = decimals;
    while behind > 0 && rest.is_multiple_of(10) {
        rest /= 10;
        behind -= 1;
    }
    // from the last digit to the first: 20 digits, a point
    let mut digits = [b'0'; 24];
    let mut at = digits.len();
    let mut count = 0;
    while rest > 0 || count <= behind {
        if count == behind && behind > 0 {
            at -= 1;
            digits[at] = b'.';
        }
        at -= 1;
        digits[at] = b'0' + (rest % 10) as u8; // a digit
        rest /= 10;
        count += 1;
    }
    out.extend_from_slice(&digits[at..]);
}

/// Appends a whole number.
pub fn push_whole(out: &mut Vec<u8>, value: u64) {
    let mut digits = [b'0'; 20];
    let mut at = digits.len();
    let mut rest = value;
    loop {
        at -= 1;
        digits[at] = b'0' + (rest % 10) as u8; // a digit
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    out.extend_from_slice(&digits[at..]);
}

/// Appends numbers between brackets: `(1, 0.5, 2)`.
pub fn push_tuple<const N: usize>(out: &mut Vec<u8>, values: [f32; N], decimals: usize) {
    out.push(b'(');
    for (place, value) in values.into_iter().enumerate() {
        if place > 0 {
            out.extend_from_slice(b", ");
        }
        push_decimal(out, value, decimals);
    }
    out.push(b')');
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn decimal(value: f64, decimals: usize) -> String {
        let mut out = Vec::new();
        push_decimal_f64(&mut out, value, decimals);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn digits_are_few() {
        for (value, decimals, text) in [
            (0.0, 3, "0"),
            (-0.0, 3, "0"),
            (-0.0004, 3, "0"),
            (1.5, 3, "1.5"),
            (-12.3456, 3, "-12.346"),
            (0.05, 3, "0.05"),
            (-0.001, 3, "-0.001"),
            (100.0, 0, "100"),
            (1200.0, 2, "1200"),
            (0.9996, 3, "1"),
            (4_109_509.25, 3, "4109509.25"),
            (f64::NAN, 3, "0"),
        ] {
            assert_eq!(decimal(value, decimals), text);
        }
    }

    #[test]
    fn tuples_and_whole_numbers() {
        let mut out = Vec::new();
        push_tuple(&mut out, [1.0, -0.25, 0.0], 2);
        push_whole(&mut out, 0);
        push_whole(&mut out, u64::MAX);
        assert_eq!(out, b"(1, -0.25, 0)018446744073709551615");
    }

    proptest! {
        #[test]
        fn text_reads_back_within_half_a_digit(value in -1e7_f64..1e7, decimals in 0_usize..=6) {
            let text = decimal(value, decimals);
            let back: f64 = text.parse().unwrap();
            let step = 10_f64.powi(-i32::try_from(decimals).unwrap());
            prop_assert!((back - value).abs() <= 0.5001 * step + 1e-9);
            prop_assert!(!text.contains('.') || !text.ends_with('0'));
        }
    }
}
