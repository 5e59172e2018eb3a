//! Formats that a scene is exported to: their names, what they are written to, and what an existing one looks like.

use std::path::Path;

use crate::export::instances::FeatureTable;

/// A format that a scene is exported to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// GeoPackage.
    GeoPackage,
    /// GeoParquet.
    Parquet,
    /// Comma-separated values.
    Csv,
    /// GeoJSON.
    GeoJson,
    /// LAS or LAZ, a point a plant.
    Las,
    /// iLand's list of single trees.
    ILand,
    /// EcoViz's list of trees.
    EcoViz,
    /// Universal Scene Description.
    Usd,
    /// glTF, binary.
    Glb,
    /// 3D Tiles.
    Tiles3d,
    /// Mitsuba 3.
    Mitsuba,
    /// Lists of points for Unreal, Unity and Houdini.
    Points,
}

/// What a format is written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// One file.
    File,
    /// A folder of its own.
    Folder,
}

impl ExportFormat {
    /// Every format, in the order of the help text.
    pub const ALL: [Self; 12] = [
        Self::GeoPackage,
        Self::Parquet,
        Self::Csv,
        Self::GeoJson,
        Self::Las,
        Self::ILand,
        Self::EcoViz,
        Self::Usd,
        Self::Glb,
        Self::Tiles3d,
        Self::Mitsuba,
        Self::Points,
    ];

    /// The format's name in flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::GeoPackage => "gpkg",
            Self::Parquet => "parquet",
            Self::Csv => "csv",
            Self::GeoJson => "geojson",
            Self::Las => "las",
            Self::ILand => "iland",
            Self::EcoViz => "pdb",
            Self::Usd => "usd",
            Self::Glb => "glb",
            Self::Tiles3d => "3dtiles",
            Self::Mitsuba => "mitsuba",
            Self::Points => "points",
        }
    }

    /// The format of a name in a flag.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// The format that a path's ending stands for; `None` where none or more than one does.
    pub fn of_ending(path: &Path) -> Option<Self> {
        match ending(path).as_str() {
            "gpkg" => Some(Self::GeoPackage),
            "parquet" => Some(Self::Parquet),
            "csv" => Some(Self::Csv),
            "geojson" => Some(Self::GeoJson),
            "las" | "laz" => Some(Self::Las),
            "pdb" => Some(Self::EcoViz),
            "usd" | "usda" | "usdc" => Some(Self::Usd),
            "glb" => Some(Self::Glb),
            _ => None,
        }
    }

    /// What the format is written to at a path: tables go into a folder, or as a single file where the path names one.
    pub fn output_kind(self, path: &Path) -> OutputKind {
        match self {
            Self::Parquet | Self::Csv if ending(path) == self.name() => OutputKind::File,
            Self::Parquet | Self::Csv | Self::Tiles3d | Self::Mitsuba | Self::Points => {
                OutputKind::Folder
            }
            _ => OutputKind::File,
        }
    }

    /// Tables that the format can hold.
    pub fn tables(self) -> &'static [FeatureTable] {
        use FeatureTable::{DownedLogs, Plants, Snags};
        match self {
            Self::Las | Self::ILand => &[Plants],
            Self::EcoViz => &[Plants, Snags],
            _ => &[Plants, Snags, DownedLogs],
        }
    }

    /// Whether the first bytes of a file are those of the format, so that an export may take its place.
    pub fn is_of_kind(self, head: &[u8]) -> bool {
        let holds = |text: &str| String::from_utf8_lossy(head).contains(text);
        match self {
            // SQLite files name the application that they are of at byte 68
            Self::GeoPackage => {
                head.starts_with(b"SQLite format 3\0") && head.get(68..72) == Some(b"GPKG")
            }
            Self::Parquet => head.starts_with(b"PAR1"),
            Self::Las => head.starts_with(b"LASF"),
            Self::Glb => head.starts_with(b"glTF"),
            Self::GeoJson => holds("\"FeatureCollection\""),
            Self::EcoViz => head.starts_with(b"3.0\n"),
            Self::Usd => head.starts_with(b"#usda") || head.starts_with(b"PXR-USDC"),
            Self::Csv => head.starts_with(b"id,"),
            Self::ILand => head.starts_with(b"# ") && holds("x and y in metres"),
            Self::Tiles3d | Self::Mitsuba | Self::Points => false,
        }
    }
}

/// A path's ending in small letters, without its point.
fn ending(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_ascii_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_keep_their_names() {
        for format in ExportFormat::ALL {
            assert_eq!(ExportFormat::from_name(format.name()), Some(format));
        }
        assert_eq!(ExportFormat::from_name("shp"), None);
    }

    #[test]
    fn endings_tell_formats() {
        let of = |path: &str| ExportFormat::of_ending(Path::new(path));
        assert_eq!(of("a/forest.GPKG"), Some(ExportFormat::GeoPackage));
        assert_eq!(of("forest.laz"), Some(ExportFormat::Las));
        assert_eq!((of("forest"), of("forest.json"), of("tables/")), (None, None, None));
    }

    #[test]
    fn tables_are_a_file_where_the_path_names_one() {
        let kind = |path: &str| ExportFormat::Csv.output_kind(Path::new(path));
        assert_eq!((kind("a.csv"), kind("a")), (OutputKind::File, OutputKind::Folder));
        assert_eq!(ExportFormat::GeoPackage.output_kind(Path::new("a")), OutputKind::File);
    }
}
