//! Points with measures of their own to LAS or LAZ: what a list of trees is written as.
//!
//! # Reference
//! ASPRS LAS 1.4 R15: point format 6, the Extra Bytes record.

use las::point::Format;
use las::{Builder, PointDataBuilder, Transform, Vector, Vlr, Writer};

use super::write::{BATCH_POINTS, geo_keys};
use crate::raster::Crs;

/// Width of a step of coordinates. chosen: a millimetre, as of other tables.
const STEP_M: f64 = 0.001;

/// Bytes of a name or a description, the last of them 0.
const TEXT_BYTES: usize = 32;

/// Bytes of a point of format 6.
const POINT_BYTES: usize = 30;

/// A measure of every point.
pub struct Attribute<'a> {
    /// Its name, at most 31 bytes.
    pub name: &'static str,
    /// What it is, at most 31 bytes.
    pub description: &'static str,
    /// The measure, point by point.
    pub values: AttributeValues<'a>,
}

/// Values of a measure.
#[derive(Clone, Copy)]
pub enum AttributeValues<'a> {
    /// Reals.
    Reals(&'a [f32]),
    /// Small whole numbers.
    Codes(&'a [u16]),
    /// Large whole numbers.
    Ids(&'a [u64]),
}

impl AttributeValues<'_> {
    /// The format's number for the kind of values, and the bytes of one.
    fn kind(self) -> (u8, usize) {
        match self {
            Self::Codes(_) => (3, 2),
            Self::Ids(_) => (7, 8),
            Self::Reals(_) => (9, 4),
        }
    }

    fn copy(self, point: usize, into: &mut [u8]) {
        match self {
            Self::Codes(values) => into.copy_from_slice(&values[point].to_le_bytes()),
            Self::Ids(values) => into.copy_from_slice(&values[point].to_le_bytes()),
            Self::Reals(values) => into.copy_from_slice(&values[point].to_le_bytes()),
        }
    }
}

/// Points with their measures, one array each.
pub struct AttributedPoints<'a> {
    /// Easting, northing and elevation.
    pub places: &'a [[f64; 3]],
    /// Class, as the format numbers them.
    pub classes: &'a [u8],
    /// Any small number the writer likes.
    pub user_data: &'a [u8],
    /// Measures.
    pub attributes: &'a [Attribute<'a>],
    /// What else is to be said, as text.
    pub note: &'a str,
}

/// Writes points as LAS 1.4, point format 6, packed where asked for. The CRS goes in as GeoTIFF keys where it has an EPSG code.
///
/// # Errors
/// If a place is further than 2 million metres from the first, or the stream cannot be written.
///
/// # Panics
/// If the arrays differ in length.
pub fn write_attributed<W>(
    points: &AttributedPoints<'_>,
    crs: &Crs,
    is_compressed: bool,
    out: W,
) -> las::Result<W>
where
    W: std::io::Write + std::io::Seek + Send + Sync + 'static,
{
    let AttributedPoints { places, classes, user_data, attributes, note } = points;
    let mut format = Format::new(6)?;
    format.is_compressed = is_compressed;
    let extra_bytes: usize = attributes.iter().map(|attribute| attribute.values.kind().1).sum();
    format.extra_bytes = extra_bytes as u16; // some dozens
    let first = places.first().copied().unwrap_or_default();
    let transform = |axis: usize| Transform { scale: STEP_M, offset: first[axis].floor() };
    let transforms = Vector { x: transform(0), y: transform(1), z: transform(2) };
    let mut builder = Builder::from((1, 4));
    builder.point_format = format;
    builder.transforms = transforms;
    builder.generating_software = concat!("wildwood ", env!("CARGO_PKG_VERSION")).to_owned();
    if let &Crs::Epsg(code) = crs
        && let Ok(code) = u16::try_from(code)
    {
        builder.vlrs.push(geo_keys(code));
    }
    builder.vlrs.push(Vlr {
        user_id: "LASF_Spec".to_owned(),
        record_id: 4,
        description: "Extra Bytes".to_owned(),
        data: attributes.iter().flat_map(descriptor).collect(),
    });
    builder.vlrs.push(Vlr {
        user_id: "wildwood".to_owned(),
        record_id: 1,
        description: "what codes stand for".to_owned(),
        data: note.as_bytes().to_vec(),
    });
    let mut writer = Writer::new(out, builder.into_header()?)?;
    let record_bytes = usize::from(format.len());
    for start in (0..places.len()).step_by(BATCH_POINTS) {
        let end = (start + BATCH_POINTS).min(places.len());
        let mut bytes = vec![0_u8; (end - start) * record_bytes];
        for (record, i) in bytes.chunks_exact_mut(record_bytes).zip(start..end) {
            for (axis, transform) in [transforms.x, transforms.y, transforms.z].iter().enumerate() {
                let step = transform.inverse(places[i][axis])?;
                record[4 * axis..][..4].copy_from_slice(&step.to_le_bytes());
            }
            record[14] = 0x11; // return 1 of 1
            record[16] = classes[i];
            record[17] = user_data[i];
            let mut at = POINT_BYTES;
            for attribute in *attributes {
                let (_, width) = attribute.values.kind();
                attribute.values.copy(i, &mut record[at..at + width]);
                at += width;
            }
        }
        let data = PointDataBuilder::new()
            .with_format(format)
            .with_transforms(transforms)
            .build_from_bytes(bytes)?;
        writer.write_points(&data)?;
    }
    writer.close()?;
    writer.into_inner()
}

/// An attribute's part of the Extra Bytes record.
fn descriptor(attribute: &Attribute<'_>) -> [u8; 192] {
    let mut bytes = [0; 192];
    bytes[2] = attribute.values.kind().0;
    text(&mut bytes[4..36], attribute.name);
    text(&mut bytes[160..192], attribute.description);
    bytes
}

/// A text with a 0 behind it.
fn text(into: &mut [u8], text: &str) {
    assert!(text.len() < TEXT_BYTES, "`{text}` is longer than the format's {TEXT_BYTES} bytes");
    into[..text.len()].copy_from_slice(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn points_read_back_with_their_measures() {
        let places = [[564_300.5, 146_299.25, 260.125], [564_310.0, 146_280.0, 301.5]];
        let (heights, species, ids) = ([21.5_f32, 3.25], [7_u16, 0], [1_u64 << 40, 9]);
        let attributes = [
            Attribute {
                name: "height_m",
                description: "",
                values: AttributeValues::Reals(&heights),
            },
            Attribute {
                name: "species",
                description: "",
                values: AttributeValues::Codes(&species),
            },
            Attribute { name: "id", description: "", values: AttributeValues::Ids(&ids) },
        ];
        let points = AttributedPoints {
            places: &places,
            classes: &[5, 3],
            user_data: &[0, 1],
            attributes: &attributes,
            note: "0 oak",
        };
        for is_compressed in [false, true] {
            let out = Cursor::new(Vec::new());
            let out = write_attributed(&points, &Crs::Epsg(3794), is_compressed, out).unwrap();
            let mut reader = las::Reader::new(Cursor::new(out.into_inner())).unwrap();
            let data = reader.read_all().unwrap();
            let found: Vec<las::Point> = data.points().map(Result::unwrap).collect();
            assert_eq!(found.len(), 2);
            for (point, place) in found.iter().zip(&places) {
                for (found, expected) in [point.x, point.y, point.z].iter().zip(place) {
                    assert!((found - expected).abs() < 1e-6, "{found} {expected}");
                }
            }
            let extra = &found[0].extra_bytes;
            assert_eq!(extra[..4], 21.5_f32.to_le_bytes());
            assert_eq!(extra[4..6], [7, 0]);
            assert_eq!(extra[6..], (1_u64 << 40).to_le_bytes());
            assert_eq!((found[1].user_data, u8::from(found[1].classification)), (1, 3));
        }
    }
}
