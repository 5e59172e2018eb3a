//! Samples packed and unpacked: compression, predictors, number formats.
//!
//! Unpacking stops when the cells are full, as libtiff does: writers disagree on how a stream ends
//! (LZW tiles without an end code are common), and nothing after the last cell matters.
//!
//! # Reference
//! Adobe, TIFF Revision 6.0, 1992, sections 9, 13, 14; Adobe Photoshop TIFF Technical Note 3, 2005 (predictor 3).

use flate2::{Decompress, FlushDecompress};
use weezl::BitOrder;

/// How samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SampleType {
    U8,
    U16,
    U32,
    U64,
    I8,
    I16,
    I32,
    I64,
    F32,
    F64,
}

impl SampleType {
    /// The type of tag 339's format (1 unsigned, 2 signed, 3 float) and tag 258's bits, if supported.
    pub(super) fn new(format: u64, bits: u64) -> Option<Self> {
        Some(match (format, bits) {
            (1, 8) => Self::U8,
            (1, 16) => Self::U16,
            (1, 32) => Self::U32,
            (1, 64) => Self::U64,
            (2, 8) => Self::I8,
            (2, 16) => Self::I16,
            (2, 32) => Self::I32,
            (2, 64) => Self::I64,
            (3, 32) => Self::F32,
            (3, 64) => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of a sample.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Turns samples into heights, every `stride`-th from the value at `first · stride`; gives the number of
    /// cells that are not finite. `samples` holds as many as are asked for: its size was checked.
    pub(super) fn heights(
        self,
        samples: &[u8],
        first: usize,
        stride: usize,
        scaling: &Scaling,
        heights: &mut [f32],
        valid: &mut [bool],
    ) -> usize {
        macro_rules! convert {
            ($t:ty, $to_f64:expr) => {
                convert!($t, $to_f64, scaling.nodata)
            };
            ($t:ty, $to_f64:expr, $nodata:expr) => {{
                let nodata: Option<f64> = $nodata;
                let all = samples.as_chunks::<{ size_of::<$t>() }>().0;
                let wanted = all[first * stride..].iter().step_by(stride);
                let mut non_finite_cells = 0;
                for ((height, valid), bytes) in heights.iter_mut().zip(valid).zip(wanted) {
                    let stored: f64 = $to_f64(<$t>::from_ne_bytes(*bytes));
                    // a declared NaN equals no value, not even itself
                    let is_nodata =
                        nodata.is_some_and(|n| stored == n || (n.is_nan() && stored.is_nan()));
                    // what f32 cannot hold becomes infinite and is caught
                    let scaled = (stored * scaling.scale + scaling.offset) as f32;
                    if !is_nodata && scaled.is_finite() {
                        (*height, *valid) = (scaled, true);
                    }
                    non_finite_cells += usize::from(!is_nodata && !scaled.is_finite());
                }
                non_finite_cells
            }};
        }
        match self {
            Self::U8 => convert!(u8, f64::from),
            Self::U16 => convert!(u16, f64::from),
            Self::U32 => convert!(u32, f64::from),
            Self::U64 => convert!(u64, |v| v as f64), // heights have few digits
            Self::I8 => convert!(i8, f64::from),
            Self::I16 => convert!(i16, f64::from),
            Self::I32 => convert!(i32, f64::from),
            Self::I64 => convert!(i64, |v| v as f64), // heights have few digits
            // nodata is declared in decimals: compare it in the precision of the cells
            Self::F32 => convert!(f32, f64::from, scaling.nodata.map(|n| f64::from(n as f32))),
            Self::F64 => convert!(f64, |v| v),
        }
    }
}

/// How stored samples become heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scaling {
    pub(super) nodata: Option<f64>,
    pub(super) scale: f64,
    pub(super) offset: f64,
}

/// How chunks are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
}

impl Compression {
    /// The method of tag 259, if supported.
    pub(super) fn new(code: u64) -> Option<Self> {
        match code {
            1 => Some(Self::None),
            5 => Some(Self::Lzw),
            8 | 32946 => Some(Self::Deflate),
            32773 => Some(Self::PackBits),
            50000 => Some(Self::Zstd),
            _ => None,
        }
    }

    /// Most bytes that one stored byte can stand for.
    pub(super) fn max_expansion(self) -> u64 {
        match self {
            Self::None => 1,
            Self::PackBits => 64,  // two bytes repeat one up to 128 times
            Self::Lzw => 2731,     // the longest string, 4096 bytes, in a code of 12 bits
            Self::Deflate => 1032, // 258 bytes in two bits (zlib's technical notes)
            Self::Zstd => 1 << 15, // a run block: 128 KiB in four bytes (RFC 8878)
        }
    }
}

/// How samples were made small before packing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Predictor {
    /// As they are.
    None,
    /// Differences to the sample on the left.
    Horizontal,
    /// Bytes of one rank together, the highest first, then differences of bytes.
    Float,
}

impl Predictor {
    /// The method of tag 317, if it goes with the samples.
    pub(super) fn new(code: u64, sample: SampleType) -> Option<Self> {
        match code {
            1 => Some(Self::None),
            2 => Some(Self::Horizontal),
            3 if matches!(sample, SampleType::F32 | SampleType::F64) => Some(Self::Float),
            _ => None,
        }
    }
}

/// The first `len` bytes that `packed` stands for.
pub(super) fn unpack(
    compression: Compression,
    mut packed: Vec<u8>,
    len: usize,
) -> Result<Vec<u8>, String> {
    if compression == Compression::None {
        packed.truncate(len);
        return if packed.len() == len { Ok(packed) } else { Err("it is too short".into()) };
    }
    let mut bytes = vec![0; len];
    let written = match compression {
        Compression::None => unreachable!("returned above"),
        Compression::Lzw => unpack_lzw(&packed, &mut bytes)?,
        Compression::Deflate => {
            let mut inflate = Decompress::new(true);
            inflate
                .decompress(&packed, &mut bytes, FlushDecompress::Finish)
                .map_err(|e| e.to_string())?;
            inflate.total_out() as usize // at most `len`
        }
        Compression::PackBits => unpack_bits(&packed, &mut bytes),
        Compression::Zstd => {
            zstd::bulk::decompress_to_buffer(&packed, &mut bytes).map_err(|e| e.to_string())?
        }
    };
    if written == len { Ok(bytes) } else { Err(format!("it ends after {written} of {len} bytes")) }
}

fn unpack_lzw(packed: &[u8], bytes: &mut [u8]) -> Result<usize, String> {
    let mut decoder = weezl::decode::Configuration::with_tiff_size_switch(BitOrder::Msb, 8)
        .with_yield_on_full_buffer(true)
        .build();
    let (mut read, mut written) = (0, 0);
    while written < bytes.len() {
        let step = decoder.decode_bytes(&packed[read..], &mut bytes[written..]);
        read += step.consumed_in;
        written += step.consumed_out;
        match step.status {
            Ok(weezl::LzwStatus::Ok) => {}
            Ok(weezl::LzwStatus::Done | weezl::LzwStatus::NoProgress) => break,
            Err(_) if written == bytes.len() => break,
            Err(error) => return Err(error.to_string()),
        }
        if step.consumed_in == 0 && step.consumed_out == 0 {
            break;
        }
    }
    Ok(written)
}

fn unpack_bits(packed: &[u8], bytes: &mut [u8]) -> usize {
    let (mut read, mut written) = (0, 0);
    while let Some(&header) = packed.get(read) {
        read += 1;
        let room = bytes.len() - written;
        if header < 128 {
            let count = (usize::from(header) + 1).min(room).min(packed.len() - read);
            bytes[written..written + count].copy_from_slice(&packed[read..read + count]);
            (read, written) = (read + count, written + count);
        } else if header > 128 {
            let Some(&value) = packed.get(read) else { break };
            let count = (257 - usize::from(header)).min(room);
            bytes[written..written + count].fill(value);
            (read, written) = (read + 1, written + count);
        }
        if written == bytes.len() {
            break;
        }
    }
    written
}

/// Turns stored samples into samples in this machine's byte order; `stride` bands alternate in a row.
pub(super) fn undo_predictor(
    predictor: Predictor,
    sample: SampleType,
    little_endian: bool,
    row_values: usize,
    stride: usize,
    samples: &mut [u8],
) {
    let size = sample.bytes();
    if predictor != Predictor::Float && size > 1 && little_endian != cfg!(target_endian = "little")
    {
        samples.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
    match predictor {
        Predictor::None => {}
        Predictor::Horizontal => {
            for row in samples.chunks_exact_mut(row_values * size) {
                match size {
                    1 => add_left::<1>(row, stride, |a, b| [a[0].wrapping_add(b[0])]),
                    2 => add_left(row, stride, |a, b| {
                        u16::from_ne_bytes(a).wrapping_add(u16::from_ne_bytes(b)).to_ne_bytes()
                    }),
                    4 => add_left(row, stride, |a, b| {
                        u32::from_ne_bytes(a).wrapping_add(u32::from_ne_bytes(b)).to_ne_bytes()
                    }),
                    _ => add_left(row, stride, |a, b| {
                        u64::from_ne_bytes(a).wrapping_add(u64::from_ne_bytes(b)).to_ne_bytes()
                    }),
                }
            }
        }
        Predictor::Float => {
            let mut planes = vec![0; row_values * size];
            for row in samples.chunks_exact_mut(row_values * size) {
                add_left::<1>(row, stride, |a, b| [a[0].wrapping_add(b[0])]);
                planes.copy_from_slice(row);
                match size {
                    4 => join_planes::<4>(&planes, row),
                    _ => join_planes::<8>(&planes, row),
                }
            }
        }
    }
}

/// Adds to each sample the one `stride` samples to its left.
fn add_left<const N: usize>(
    row: &mut [u8],
    stride: usize,
    sum: impl Fn([u8; N], [u8; N]) -> [u8; N],
) {
    let samples = row.as_chunks_mut::<N>().0;
    if stride == 1 {
        // the running sum stays in a register
        let mut left = [0; N];
        for sample in samples {
            left = sum(*sample, left);
            *sample = left;
        }
    } else {
        for index in stride..samples.len() {
            samples[index] = sum(samples[index], samples[index - stride]);
        }
    }
}

/// Puts together samples whose bytes lie in planes, the highest bytes first.
fn join_planes<const N: usize>(planes: &[u8], row: &mut [u8]) {
    let values = planes.len() / N;
    for (index, sample) in row.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        let big_endian: [u8; N] = std::array::from_fn(|byte| planes[byte * values + index]);
        *sample = big_endian;
        if cfg!(target_endian = "little") {
            sample.reverse();
        }
    }
}

/// The bytes of a row of `f32` as predictor 3 stores them: high bytes together, then differences.
pub(super) fn apply_float_predictor(row: &[f32], stored: &mut [u8]) {
    let values = row.len();
    let (high, low) = stored.split_at_mut(2 * values);
    let (byte_3, byte_2) = high.split_at_mut(values);
    let (byte_1, byte_0) = low.split_at_mut(values);
    for (index, value) in row.iter().enumerate() {
        [byte_3[index], byte_2[index], byte_1[index], byte_0[index]] = value.to_be_bytes();
    }
    for index in (1..stored.len()).rev() {
        stored[index] = stored[index].wrapping_sub(stored[index - 1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_float_predictor_and_its_inverse_cancel() {
        let row = [1.5_f32, -9999.0, 1217.25, f32::MIN_POSITIVE, 0.0, 3e38, -0.0];
        let mut stored = vec![0; row.len() * 4];
        apply_float_predictor(&row, &mut stored);
        // the first byte is the first value's sign and exponent, the second a difference to it
        assert_eq!((stored[0], stored[1]), (0x3f, 0xc6_u8.wrapping_sub(0x3f)));
        undo_predictor(Predictor::Float, SampleType::F32, true, row.len(), 1, &mut stored);
        let back: Vec<u32> =
            stored.as_chunks().0.iter().map(|b| f32::from_ne_bytes(*b).to_bits()).collect();
        assert_eq!(back, row.map(f32::to_bits));
    }

    #[test]
    fn differences_run_within_a_band() {
        let mut two_bands = [10_u8, 100, 1, 255, 2, 255];
        undo_predictor(Predictor::Horizontal, SampleType::U8, true, 6 / 2 * 2, 2, &mut two_bands);
        assert_eq!(two_bands, [10, 100, 11, 99, 13, 98]);
        let mut big_endian = [1, 0, 0, 5];
        undo_predictor(Predictor::Horizontal, SampleType::U16, false, 2, 1, &mut big_endian);
        let values = big_endian.as_chunks().0.iter().map(|b| u16::from_ne_bytes(*b));
        assert_eq!(values.collect::<Vec<_>>(), [256, 261]);
    }

    #[test]
    fn packbits_of_the_technical_note() {
        // Apple Technical Note TN1023
        let packed = [
            0xfe, 0xaa, 0x02, 0x80, 0x00, 0x2a, 0xfd, 0xaa, 0x03, 0x80, 0x00, 0x2a, 0x22, 0xf7,
            0xaa,
        ];
        let mut bytes = [0; 24];
        assert_eq!(unpack_bits(&packed, &mut bytes), 24);
        assert_eq!(bytes[..7], [0xaa, 0xaa, 0xaa, 0x80, 0x00, 0x2a, 0xaa]);
        assert_eq!(bytes[23], 0xaa);
    }

    #[test]
    fn lzw_needs_no_end_code() {
        let cells = vec![7_u8; 300];
        let packed =
            weezl::encode::Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(&cells).unwrap();
        for cut in 0..3 {
            let short = packed[..packed.len() - cut].to_vec();
            let result = unpack(Compression::Lzw, short, 270);
            assert_eq!(result.as_deref(), Ok(&cells[..270]), "{cut} bytes missing");
        }
        assert!(unpack(Compression::Lzw, packed[..packed.len() / 2].to_vec(), 300).is_err());
    }

    #[test]
    fn streams_that_end_early_are_errors() {
        for method in
            [Compression::None, Compression::Deflate, Compression::PackBits, Compression::Zstd]
        {
            assert!(unpack(method, vec![0; 3], 100).is_err(), "{method:?}");
        }
    }

    #[test]
    fn nodata_and_non_finite_cells_are_told_apart() {
        let cells = [1.0_f32, -3.402_823_4e38, f32::NAN, f32::INFINITY];
        let bytes: Vec<u8> = cells.iter().flat_map(|c| c.to_ne_bytes()).collect();
        let read = |nodata| {
            let scaling = Scaling { nodata, scale: 2.0, offset: 0.5 };
            let (mut heights, mut valid) = ([0.0; 4], [false; 4]);
            let bad = SampleType::F32.heights(&bytes, 0, 1, &scaling, &mut heights, &mut valid);
            (heights[0], valid, bad)
        };
        let lowest = Some(-3.402_823_466_385_288_6e38);
        assert_eq!(read(lowest), (2.5, [true, false, false, false], 2));
        assert_eq!(read(Some(f64::NAN)), (2.5, [true, false, false, false], 2));
    }
}
