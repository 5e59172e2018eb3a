//! A raster file of any known format, told by its content.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::geotiff::SharedFile;
use super::{Error, Limits, ParseError, ascii_grid, elv, geotiff, wkt};
use crate::raster::{Affine, Crs, CrsProblem, MapWindow, SourceRaster};

/// Bytes of a text raster per cell at most: more is no text that a program wrote.
const MAX_TEXT_BYTES_PER_CELL: u64 = 32;

/// Kinds of file that their first bytes tell apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    GeoTiff,
    AsciiGrid,
    Elv,
    PointCloud,
    Other,
}

/// The format of a file that begins with `start`; numbers alone need the extension `elv`.
fn format(start: &[u8], path: &Path) -> Format {
    let has_extension =
        |wanted: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
    match start {
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Format::GeoTiff,
        [b'L', b'A', b'S', b'F', ..] => Format::PointCloud,
        _ if ascii_grid::is_ascii_grid(start) => Format::AsciiGrid,
        _ if elv::is_elv(start) || has_extension("elv") => Format::Elv,
        _ if has_extension("asc") => Format::AsciiGrid,
        _ => Format::Other,
    }
}

/// The raster in a file, or the part of it that `window` (in the file's CRS) touches.
///
/// Reads GeoTIFF (cloud-optimised ones too), ESRI ASCII grid (with the `.prj` beside it) and `.elv`; a build with
/// feature `gdal` reads what GDAL reads.
///
/// # Errors
/// If the file cannot be read, is of an unknown format, or its content cannot be used.
pub fn read(
    path: &Path,
    window: Option<&MapWindow>,
    limits: &Limits,
) -> Result<SourceRaster, Error> {
    let failed = |source| Error::Read { path: path.to_path_buf(), source };
    let mut start = Vec::new();
    let file = File::open(path).map_err(failed)?;
    let len = file.metadata().map_err(failed)?.len();
    file.take(512).read_to_end(&mut start).map_err(failed)?;
    if len == 0 {
        let empty = ParseError::new("the file is empty", "copy or download it again");
        return Err(empty.at(path));
    }
    let text = || {
        let most = (limits.max_cells as u64).saturating_mul(MAX_TEXT_BYTES_PER_CELL);
        if len > most.max(1 << 20) {
            let what = format!("the text has {len} bytes, more than the limit of cells needs");
            let hint = "turn it into a GeoTIFF first, with gdal_translate";
            return Err(ParseError::new(what, hint).at(path));
        }
        std::fs::read(path).map_err(failed)
    };
    match format(&start, path) {
        Format::GeoTiff => {
            let source = SharedFile::open(path).map_err(failed)?;
            match geotiff::parse(&source, window, limits) {
                #[cfg(feature = "gdal")]
                Err(e) if e.kind == super::ParseErrorKind::Unsupported => {
                    other(path, window, limits)
                }
                read => read.map_err(|e| e.at(path)),
            }
        }
        Format::AsciiGrid => {
            let mut raster = ascii_grid::parse(&text()?, window, limits).map_err(|e| e.at(path))?;
            name_crs(&mut raster, path);
            Ok(raster)
        }
        Format::Elv => elv::parse(&text()?, window, limits).map_err(|e| e.at(path)),
        Format::PointCloud => Err(ParseError::new(
            "the file is a point cloud (LAS or LAZ), not a raster",
            "read it as one: `las::read`, or `wildwood import`",
        )
        .at(path)),
        Format::Other => other(path, window, limits),
    }
}

/// One band of a GeoTIFF whose bands are stored apart, as this program writes them; 0 is the first.
///
/// # Errors
/// If the file cannot be read, is damaged, or has no such band.
pub fn read_band(path: &Path, band: usize, limits: &Limits) -> Result<SourceRaster, Error> {
    let failed = |source| Error::Read { path: path.to_path_buf(), source };
    let source = SharedFile::open(path).map_err(failed)?;
    geotiff::parse_band(&source, band, None, limits).map_err(|e| e.at(path))
}

#[cfg(feature = "gdal")]
fn other(path: &Path, window: Option<&MapWindow>, limits: &Limits) -> Result<SourceRaster, Error> {
    super::gdal::read(path, window, limits)
}

#[cfg(not(feature = "gdal"))]
fn other(path: &Path, _: Option<&MapWindow>, _: &Limits) -> Result<SourceRaster, Error> {
    Err(ParseError::new(
        "the format is not known",
        "known are GeoTIFF (.tif), ESRI ASCII grid (.asc), .elv, LAS and LAZ; a build with --features gdal reads what GDAL reads, or use gdal_translate IN OUT.tif",
    )
    .at(path))
}

/// What a raster's header tells before any cell is read.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterHead {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Map position.
    pub affine: Affine,
    /// The CRS; local metres where the header is silent, `None` where what it says is not understood.
    pub crs: Option<Crs>,
}

/// The head of a file whose parts can be read alone (GeoTIFF, what GDAL reads); `None` for text, which is read whole.
/// Lets a caller who knows a window only in another CRS decide before cells are read.
///
/// # Errors
/// If the file cannot be read or its header is damaged.
pub fn head(path: &Path) -> Result<Option<RasterHead>, Error> {
    let failed = |source| Error::Read { path: path.to_path_buf(), source };
    let mut start = Vec::new();
    File::open(path).map_err(failed)?.take(512).read_to_end(&mut start).map_err(failed)?;
    match format(&start, path) {
        _ if start.is_empty() => Ok(None),
        Format::GeoTiff => {
            let source = SharedFile::open(path).map_err(failed)?;
            geotiff::read::head(&source).map(Some).map_err(|e| e.at(path))
        }
        #[cfg(feature = "gdal")]
        Format::Other => super::gdal::head(path).map(Some),
        _ => Ok(None),
    }
}

/// Files beside a raster that are read with it.
pub fn beside(path: &Path) -> Vec<PathBuf> {
    let named = |extension| path.with_extension(extension);
    ["prj", "PRJ"]
        .map(named)
        .into_iter()
        .find(|prj| prj != path && prj.is_file())
        .into_iter()
        .collect()
}

/// Bytes read of a `.prj` file at most; chosen: the longest real ones have some thousands.
const MAX_PRJ_BYTES: u64 = 1 << 20;

/// Gives an ASCII grid the CRS and the vertical unit of the `.prj` file beside it, where there is one.
fn name_crs(raster: &mut SourceRaster, path: &Path) {
    let Some(prj) = beside(path).pop() else { return };
    let mut bytes = Vec::new();
    let read = File::open(&prj).and_then(|file| file.take(MAX_PRJ_BYTES).read_to_end(&mut bytes));
    (raster.crs, raster.vertical_unit) = wkt::parse(&String::from_utf8_lossy(&bytes));
    let problem = match read {
        Err(error) => format!("cannot be read ({error})"),
        Ok(_) if raster.crs.is_none() => "names no CRS that is understood".to_owned(),
        Ok(_) => return,
    };
    let prj = prj.file_name().map(|name| name.display().to_string()).unwrap_or_default();
    let text = format!("{prj} beside it {problem}; give the CRS yourself: --crs EPSG:n");
    raster.crs_problem = Some(CrsProblem { text, is_fatal: false });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::LengthUnit;

    const GRID: &str = "ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n5 6\n";

    fn read_as(name: &str, content: &[u8]) -> Result<SourceRaster, Error> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        read(&path, None, &Limits::default())
    }

    #[test]
    fn content_comes_before_the_extension() {
        assert_eq!(read_as("a.tif", GRID.as_bytes()).unwrap().values, [5.0, 6.0]);
        assert_eq!(read_as("b.txt", b"2 1 1.0 45\n5 6\n").unwrap().latitude_deg, Some(45.0));
        let cut = read_as("c.tif", b"II\x2a\0").unwrap_err();
        assert!(cut.to_string().contains("TIFF"), "{cut}");
    }

    #[test]
    fn unknown_files_are_told_what_is_known() {
        assert!(read_as("cloud.tif", b"LASF....").unwrap_err().to_string().contains("point cloud"));
        assert!(read_as("empty.tif", b"").unwrap_err().to_string().contains("empty"));
        let other = read_as("a.docx", b"PK\x03\x04").unwrap_err();
        assert!(matches!(other, Error::Content { .. }), "{other}");
        if cfg!(not(feature = "gdal")) {
            assert!(other.to_string().contains("--features gdal"), "{other}");
        }
        let missing = read(Path::new("no/such/file.tif"), None, &Limits::default()).unwrap_err();
        assert!(!missing.is_machine_failure());
    }

    #[test]
    fn the_projection_beside_an_ascii_grid_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dem.asc");
        std::fs::write(&path, GRID).unwrap();
        // as ESRI programs write it
        let prj = r#"PROJCS["NAD_1983_UTM_Zone_11N",GEOGCS["GCS_North_American_1983",DATUM["D_North_American_1983",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",-117.0],PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#;
        std::fs::write(path.with_extension("prj"), prj).unwrap();
        let raster = read(&path, None, &Limits::default()).unwrap();
        assert_eq!((raster.crs, raster.vertical_unit), (Some(Crs::Epsg(26911)), None));

        // upper case, and the unit of heights that its second part names
        std::fs::remove_file(path.with_extension("prj")).unwrap();
        let vertical = r#",VERTCS["NAVD88",VDATUM["NAVD88"],UNIT["Foot",0.3048]]"#;
        std::fs::write(path.with_extension("PRJ"), format!("{prj}{vertical}")).unwrap();
        let raster = read(&path, None, &Limits::default()).unwrap();
        assert_eq!(raster.crs, Some(Crs::Epsg(26911)));
        assert_eq!(raster.vertical_unit, Some(LengthUnit::Foot));
    }

    #[test]
    fn issue_2_a_projection_not_understood_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dem.asc");
        std::fs::write(&path, GRID).unwrap();
        std::fs::write(path.with_extension("prj"), "Projection UTM\nZone 11").unwrap();
        let raster = read(&path, None, &Limits::default()).unwrap();
        let problem = raster.crs_problem.unwrap();
        assert!(problem.text.contains("dem.prj") && !problem.is_fatal, "{problem:?}");
        std::fs::remove_file(path.with_extension("prj")).unwrap();
        assert!(read(&path, None, &Limits::default()).unwrap().crs_problem.is_none());
    }
}
