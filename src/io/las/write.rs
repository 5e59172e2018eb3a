//! A cloud to LAZ.

use std::io::BufWriter;
use std::path::Path;

use las::point::Format;
use las::{Builder, PointDataBuilder, Transform, Vector, Vlr, Writer};

use super::PointCloud;
use crate::io::Error;
use crate::raster::Crs;

/// Points handed to the compressor at a time. chosen: 4 chunks of 50,000 for each of 4 threads.
pub(super) const BATCH_POINTS: usize = 800_000;

/// Writes a cloud as LAZ 1.4, point format 6, beside `path` and renames it when it is whole.
/// The CRS goes in as GeoTIFF keys where it has an EPSG code; each point is the only return of its pulse.
///
/// # Errors
/// If the file cannot be written.
pub fn write_laz(cloud: &PointCloud, path: &Path) -> Result<(), Error> {
    let failed = |source| Error::Write { path: path.to_path_buf(), source };
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut beside = tempfile::Builder::new();
    #[cfg(unix)] // readable as any other file: the process's umask applies
    beside.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = beside.tempfile_in(folder).map_err(failed)?;
    let out = file.reopen().map_err(failed)?;
    write(cloud, BufWriter::new(out)).map_err(|e| failed(std::io::Error::other(e)))?;
    file.persist(path).map_err(|e| failed(e.error))?;
    Ok(())
}

/// Writes a cloud as LAZ to a stream.
pub(super) fn write<W>(cloud: &PointCloud, out: W) -> las::Result<W>
where
    W: std::io::Write + std::io::Seek + Send + Sync + 'static,
{
    let transform =
        |axis: usize| Transform { scale: cloud.axes[axis].scale, offset: cloud.axes[axis].offset };
    let transforms = Vector { x: transform(0), y: transform(1), z: transform(2) };
    let mut format = Format::new(6)?;
    format.is_compressed = true;
    let mut builder = Builder::from((1, 4));
    builder.point_format = format;
    builder.transforms = transforms;
    builder.generating_software = concat!("wildwood ", env!("CARGO_PKG_VERSION")).to_owned();
    if let Some(Crs::Epsg(code)) = cloud.crs
        && let Ok(code) = u16::try_from(code)
    {
        builder.vlrs.push(geo_keys(code));
    }
    let mut writer = Writer::new(out, builder.into_header()?)?;
    let record_bytes = usize::from(format.len());
    let c = &cloud.columns;
    for start in (0..cloud.len()).step_by(BATCH_POINTS) {
        let end = (start + BATCH_POINTS).min(cloud.len());
        let mut bytes = vec![0_u8; (end - start) * record_bytes];
        for (record, i) in bytes.chunks_exact_mut(record_bytes).zip(start..end) {
            record[0..4].copy_from_slice(&c.x[i].to_le_bytes());
            record[4..8].copy_from_slice(&c.y[i].to_le_bytes());
            record[8..12].copy_from_slice(&c.z[i].to_le_bytes());
            record[14] = 0x11; // return 1 of 1
            record[16] = c.class[i];
        }
        let points = PointDataBuilder::new()
            .with_format(format)
            .with_transforms(transforms)
            .build_from_bytes(bytes)?;
        writer.write_points(&points)?;
    }
    writer.close()?;
    writer.into_inner()
}

/// Record 34735 naming a projected CRS by its EPSG code, in metres.
pub(super) fn geo_keys(epsg: u16) -> Vlr {
    // version 1.1.0, three keys: projected model, the CRS, vertical metres
    let keys: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, epsg, 4099, 0, 1, 9001];
    Vlr {
        user_id: "LASF_Projection".to_owned(),
        record_id: 34735,
        description: "GeoTIFF GeoKeyDirectoryTag".to_owned(),
        data: keys.iter().flat_map(|k| k.to_le_bytes()).collect(),
    }
}
