//! Monthly maps to the digits that mean something.

use rayon::prelude::*;

use crate::math;
use crate::raster::MonthlyGrid;

/// Bits of mantissa that monthly maps keep. chosen: an error of at most 3e-5 of the value (a second of sun, 5 µm of
/// water) is far below what any of the models knows, and files shrink to a third.
/// Maps are rounded before any later stage sees them, so that a run which reads them from a scene folder and one
/// which has them in memory get the same bits.
pub const MONTHLY_MANTISSA_BITS: u32 = 14;

/// A monthly value as maps hold it.
#[inline]
pub fn rounded_value(value: f32) -> f32 {
    math::rounded_to_mantissa(value, MONTHLY_MANTISSA_BITS)
}

/// Monthly values as maps hold them.
pub fn rounded(monthly: MonthlyGrid) -> MonthlyGrid {
    let (frame, mask) = (monthly.frame().clone(), monthly.mask().clone());
    let mut months = monthly.into_months();
    for month in &mut months {
        month.par_iter_mut().for_each(|value| *value = rounded_value(*value));
    }
    MonthlyGrid::new(frame, mask, months)
}
