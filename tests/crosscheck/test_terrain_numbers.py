"""Slope and warps against GDAL."""

import shutil
import subprocess

import numpy as np
import pytest
import rasterio
from rasterio.warp import Resampling, calculate_default_transform, reproject

from conftest import hills, read, real, run_import, write_tiff


def gdaldem_slope(terrain, out):
    if not shutil.which("gdaldem"):
        pytest.skip("gdaldem is missing: install gdal-bin")
    command = ["gdaldem", "slope", "-compute_edges", "-q", str(terrain), str(out)]
    subprocess.run(command, check=True)
    return read(out)


@pytest.mark.parametrize("name", [None, "dem/slovenia_TM1_564_146_1m.tif", "canopy_pairs/bcts_bc_dtm.tif"])
def test_slope_is_gdaldem_slope(name, tmp_path):
    source = real(name) if name else write_tiff(tmp_path / "dem.tif", hills(200, 230).astype("float32"))
    folder = run_import(source, tmp_path / "forest")
    expected = np.radians(gdaldem_slope(folder / "terrain.tif", tmp_path / "slope.tif"))
    got = np.radians(read(folder / "slope.tif"))
    both = ~np.ma.getmaskarray(expected) & ~np.ma.getmaskarray(got)
    assert both.mean() > 0.8
    off = np.abs(got.data - expected.data)[both]
    assert off.max() < 1e-4, off.max()


def local_height_change(values, cell):
    """Largest height difference to a neighbour, halved: how far half a cell can move a height."""
    change = np.zeros(values.shape)
    for axis in (0, 1):
        for shift in (1, -1):
            moved = np.roll(values, shift, axis)
            change = np.maximum(change, np.abs(values - moved))
    return change / 2


def geographic_copy(source, path):
    with rasterio.open(source) as src:
        transform, width, height = calculate_default_transform(
            src.crs, "EPSG:4326", src.width, src.height, *src.bounds
        )
        values = np.full((height, width), -9999, "float32")
        reproject(
            src.read(1), values, src_transform=src.transform, src_crs=src.crs, src_nodata=src.nodata,
            dst_transform=transform, dst_crs="EPSG:4326", dst_nodata=-9999, resampling=Resampling.cubic,
        )
    profile = dict(driver="GTiff", height=height, width=width, count=1, dtype="float32",
                   crs="EPSG:4326", transform=transform, nodata=-9999)
    with rasterio.open(path, "w", **profile) as out:
        out.write(values, 1)
    return path


@pytest.mark.parametrize("name", [None, "dem/slovenia_TM1_564_146_1m.tif"])
@pytest.mark.parametrize("method", ["bicubic", "bilinear"])
def test_warp_is_gdal_warp(name, method, tmp_path):
    original = real(name) if name else write_tiff(tmp_path / "m.tif", hills(300, 260).astype("float32"))
    source = geographic_copy(original, tmp_path / "degrees.tif")
    folder = run_import(source, tmp_path / "forest", "--resampling", method, "--fill-holes", "0")
    with rasterio.open(folder / "terrain.tif") as out, rasterio.open(source) as src:
        assert out.crs.is_projected and out.crs.to_epsg() // 100 == 326
        got = out.read(1, masked=True)
        expected = np.full(got.shape, -9999, "float32")
        reproject(
            src.read(1), expected, src_transform=src.transform, src_crs=src.crs, src_nodata=-9999,
            dst_transform=out.transform, dst_crs=out.crs, dst_nodata=-9999,
            resampling=Resampling.cubic if method == "bicubic" else Resampling.bilinear, tolerance=0.01,
        )
        cell = out.transform.a
    both = ~np.ma.getmaskarray(got) & (expected != -9999)
    assert both.mean() > 0.8 * (expected != -9999).mean() > 0.4
    inner = both.copy()  # GDAL and wildwood may treat the outermost cells of the data differently
    for axis in (0, 1):
        for shift in (1, -1, 2, -2):
            inner &= np.roll(both, shift, axis)
    inner[:2] = inner[-2:] = inner[:, :2] = inner[:, -2:] = False
    allowed = np.maximum(local_height_change(expected, cell), 0.01)
    off = np.abs(got.data - expected)
    assert (off[inner] <= allowed[inner]).all(), float((off - allowed)[inner].max())
