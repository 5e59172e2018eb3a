//! Header and directories of a cloud-optimised GeoTIFF, as bytes.

use super::read::tag;
use super::tiles::TileGrid;
use super::write::{Band, NODATA};
use crate::io::geokeys;
use crate::raster::{Crs, Frame};

/// Tells GDAL what it may rely on; only what is true of these files.
const LAYOUT: &str = "LAYOUT=IFDS_BEFORE_DATA\nKNOWN_INCOMPATIBLE_EDITION=NO\n ";

/// One image of the file: the full one, or an overview.
#[derive(Debug)]
pub(super) struct Image {
    pub(super) grid: TileGrid,
    /// Where each tile lies, band after band.
    pub(super) offsets: Vec<u64>,
    /// Bytes of each tile.
    pub(super) byte_counts: Vec<u64>,
}

impl Image {
    /// An image whose tiles are not yet written.
    pub(super) fn unwritten(grid: TileGrid, bands: usize) -> Self {
        let tiles = grid.len() * bands;
        Self { grid, offsets: vec![0; tiles], byte_counts: vec![0; tiles] }
    }
}

/// Everything in front of the tiles.
#[derive(Debug)]
pub(super) struct Head<'a> {
    pub(super) frame: &'a Frame,
    pub(super) bands: &'a [Band],
    pub(super) big: bool,
    /// The full image first, then overviews from the largest.
    pub(super) images: Vec<Image>,
}

/// A tag's values.
enum Values {
    Shorts(Vec<u16>),
    Longs(Vec<u32>),
    Long8s(Vec<u64>),
    Doubles(Vec<f64>),
    Text(String),
}

impl Values {
    fn kind(&self) -> u16 {
        match self {
            Self::Text(_) => 2,
            Self::Shorts(_) => 3,
            Self::Longs(_) => 4,
            Self::Doubles(_) => 12,
            Self::Long8s(_) => 16,
        }
    }

    fn count(&self) -> usize {
        match self {
            Self::Text(text) => text.len() + 1, // and a zero byte
            Self::Shorts(values) => values.len(),
            Self::Longs(values) => values.len(),
            Self::Doubles(values) => values.len(),
            Self::Long8s(values) => values.len(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Text(text) => text.bytes().chain([0]).collect(),
            Self::Shorts(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Longs(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Doubles(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Long8s(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

impl Head<'_> {
    /// The bytes, as many whatever the tiles' places and sizes are.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mark = format!("GDAL_STRUCTURAL_METADATA_SIZE={:06} bytes\n{LAYOUT}", LAYOUT.len());
        let header_len = if self.big { 16 } else { 8 };
        let first = (header_len + mark.len()).next_multiple_of(8);
        if self.big {
            bytes.extend(b"II\x2b\0\x08\0\0\0");
            bytes.extend((first as u64).to_le_bytes());
        } else {
            bytes.extend(b"II\x2a\0");
            bytes.extend((first as u32).to_le_bytes()); // about 100
        }
        bytes.extend(mark.bytes());
        bytes.resize(first, 0);
        for (index, image) in self.images.iter().enumerate() {
            let is_last = index + 1 == self.images.len();
            self.push_directory(&self.tags(image, index > 0), is_last, &mut bytes);
        }
        bytes
    }

    /// An image's tags in ascending order.
    fn tags(&self, image: &Image, is_overview: bool) -> Vec<(u16, Values)> {
        let bands = self.bands.len();
        let short = |value: u16| Values::Shorts(vec![value]);
        // sizes of rasters and tiles fit: they are checked against the format's limits before
        let long = |value: usize| Values::Longs(vec![value as u32]);
        let places = if self.big {
            Values::Long8s(image.offsets.clone())
        } else {
            Values::Longs(image.offsets.iter().map(|o| *o as u32).collect()) // below 4 GiB unless big
        };
        let sizes = image.byte_counts.iter().map(|c| *c as u32).collect(); // of one tile: about a MB
        let mut tags = vec![
            (254, long(usize::from(is_overview))),
            (tag::IMAGE_WIDTH, long(image.grid.cols)),
            (tag::IMAGE_LENGTH, long(image.grid.rows)),
            (tag::BITS_PER_SAMPLE, Values::Shorts(vec![32; bands])),
            (tag::COMPRESSION, short(8)),
            (tag::PHOTOMETRIC, short(1)),
            (tag::SAMPLES_PER_PIXEL, short(bands as u16)), // at most u16::MAX, checked before
            (tag::PLANAR_CONFIGURATION, short(if bands > 1 { 2 } else { 1 })),
            (tag::PREDICTOR, short(3)),
            (tag::TILE_WIDTH, long(image.grid.tile_cols)),
            (tag::TILE_LENGTH, long(image.grid.tile_rows)),
            (tag::TILE_OFFSETS, places),
            (tag::TILE_BYTE_COUNTS, Values::Longs(sizes)),
        ];
        if bands > 1 {
            tags.push((338, Values::Shorts(vec![0; bands - 1]))); // extra bands of no colour
        }
        tags.push((tag::SAMPLE_FORMAT, Values::Shorts(vec![3; bands])));
        if !is_overview {
            let t = &self.frame.transform;
            tags.push((tag::MODEL_PIXEL_SCALE, Values::Doubles(vec![t.cell_m, t.cell_m, 0.0])));
            let tie = vec![0.0, 0.0, 0.0, t.west_m, t.north_m, 0.0];
            tags.push((tag::MODEL_TIEPOINT, Values::Doubles(tie)));
            let (directory, citation) = geo_keys(&self.frame.crs);
            tags.push((tag::GEO_KEY_DIRECTORY, Values::Shorts(directory)));
            if let Some(citation) = citation {
                tags.push((tag::GEO_ASCII_PARAMS, Values::Text(citation)));
            }
            tags.push((tag::GDAL_METADATA, Values::Text(self.metadata())));
        }
        tags.push((tag::GDAL_NODATA, Values::Text(NODATA.to_string())));
        tags
    }

    /// Appends a directory, with the values that do not fit into it behind it.
    fn push_directory(&self, tags: &[(u16, Values)], is_last: bool, bytes: &mut Vec<u8>) {
        let (word, entry) = if self.big { (8, 20) } else { (4, 12) };
        let head = if self.big { 8 } else { 2 };
        let values_start = (bytes.len() + head + tags.len() * entry + word).next_multiple_of(8);
        let push_word = |bytes: &mut Vec<u8>, value: usize| {
            bytes.extend(&(value as u64).to_le_bytes()[..word]); // low bytes first: the rest is zero
        };
        let mut values: Vec<u8> = Vec::new();
        bytes.extend(&(tags.len() as u64).to_le_bytes()[..head]);
        for (tag, content) in tags {
            bytes.extend(tag.to_le_bytes());
            bytes.extend(content.kind().to_le_bytes());
            push_word(bytes, content.count());
            let mut content = content.bytes();
            if content.len() <= word {
                content.resize(word, 0);
                bytes.extend(content);
            } else {
                push_word(bytes, values_start + values.len());
                values.extend(content);
                values.resize(values.len().next_multiple_of(8), 0);
            }
        }
        push_word(bytes, if is_last { 0 } else { values_start + values.len() });
        bytes.resize(values_start, 0);
        bytes.extend(values);
    }

    /// GDAL's metadata: names and units of the bands.
    fn metadata(&self) -> String {
        let mut xml = String::from("<GDALMetadata>\n");
        for (index, band) in self.bands.iter().enumerate() {
            for (name, role, text) in
                [("DESCRIPTION", "description", &band.name), ("UNITTYPE", "unittype", &band.unit)]
            {
                if !text.is_empty() {
                    let text = escaped(text);
                    xml += &format!(
                        "  <Item name=\"{name}\" sample=\"{index}\" role=\"{role}\">{text}</Item>\n"
                    );
                }
            }
        }
        xml + "</GDALMetadata>\n"
    }
}

/// The GeoKey directory of a metric CRS, and its text.
fn geo_keys(crs: &Crs) -> (Vec<u16>, Option<String>) {
    match crs {
        // model projected; cells are areas; the code
        Crs::Epsg(code) => {
            let code = *code as u16; // checked before
            (vec![1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, code], None)
        }
        // model user-defined; cells are areas; a citation that says so; metres
        _ => {
            let citation = format!("{}|", geokeys::LOCAL_CITATION);
            let len = citation.len() as u16; // a short constant
            let keys = [1024, 0, 1, 32767, 1025, 0, 1, 1, 1026, 34737, len, 0, 3076, 0, 1, 9001];
            ([1, 1, 0, 4].into_iter().chain(keys).collect(), Some(citation))
        }
    }
}

/// Text as GDAL stores it in its metadata: escaped for XML twice, once as a value and once as an element.
fn escaped(text: &str) -> String {
    let once = |text: &str| {
        text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
    };
    once(&once(&text.replace('\0', "")))
}
