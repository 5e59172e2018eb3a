"""Files that other programs write are read as what they are."""

import itertools

import laspy
import numpy as np
import pytest
import rasterio

from conftest import hills, read, run_import, write_tiff

LAYOUTS = {
    "strips": {},
    "tiles": dict(tiled=True, blockxsize=32, blockysize=16),
    "bigtiff": dict(BIGTIFF="YES", tiled=True, blockxsize=64, blockysize=64),
    "big-endian": dict(ENDIANNESS="BIG"),
}
TYPES = {"int16": [1, 2], "uint16": [1, 2], "float32": [1, 2, 3], "float64": [1, 2, 3]}
COMPRESSIONS = ["none", "deflate", "lzw", "zstd"]


def variants():
    for (layout, options), dtype in itertools.product(LAYOUTS.items(), TYPES):
        for compress, predictor in itertools.product(COMPRESSIONS, TYPES[dtype]):
            if compress == "none" and predictor > 1:
                continue
            yield pytest.param(
                options, dtype, compress, predictor, id=f"{layout}-{dtype}-{compress}-{predictor}"
            )


@pytest.mark.parametrize("options, dtype, compress, predictor", variants())
def test_geotiff_variant(options, dtype, compress, predictor, tmp_path):
    values = np.round(hills(50, 70)).astype(dtype)
    values[10:40, 0:3] = 9999
    more = dict(options, compress=compress, nodata=9999)
    if predictor > 1:
        more["predictor"] = predictor
    source = write_tiff(tmp_path / "dem.tif", values, **more)
    got = read(run_import(source, tmp_path / "forest") / "terrain.tif")
    expected = np.ma.masked_equal(values.astype("float32"), 9999)
    assert np.array_equal(np.ma.getmaskarray(got), expected.mask)
    assert np.array_equal(got.compressed(), expected.compressed())


def test_cog_with_overviews(tmp_path):
    values = hills(600, 700).astype("float32")
    source = write_tiff(tmp_path / "dem.tif", values, driver="COG", BLOCKSIZE=256)
    got = read(run_import(source, tmp_path / "forest") / "terrain.tif")
    assert np.array_equal(got, values)


def test_ascii_grid(tmp_path):
    values = hills(40, 60).astype("float32")
    values[5, 5:9] = -9999
    source = tmp_path / "dem.asc"
    with rasterio.open(write_tiff(tmp_path / "x.tif", values, nodata=-9999)) as tif:
        rasterio.shutil.copy(tif, source, driver="AAIGrid", DECIMAL_PRECISION=4)
    got = read(run_import(source, tmp_path / "forest", "--crs", "EPSG:32611", "--fill-holes", "0") / "terrain.tif")
    assert np.ma.allclose(got, np.ma.masked_equal(values, -9999), atol=1e-3)
    assert got.mask.sum() == 4


def test_feet_become_metres(tmp_path):
    """California zone 3 in US survey feet, heights in feet by the user's word."""
    values = (hills(80, 80, cell=1.0) / 0.3048).astype("float32")
    source = write_tiff(tmp_path / "dem.tif", values, cell=3.0, crs="EPSG:2227", west=6e6, north=2.1e6)
    folder = run_import(source, tmp_path / "forest", "--vertical-unit", "ft")
    with rasterio.open(folder / "terrain.tif") as out:
        assert out.crs.to_epsg() == 32610
        assert abs(out.transform.a - 0.9144) < 0.01
        got = out.read(1, masked=True)
    assert abs(got.mean() - values.mean() * 0.3048) < 1.0


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_point_cloud(suffix, tmp_path):
    """A plane with one tree: the terrain is the plane, the canopy the tree."""
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 60, (2, 40_000))
    ground = 100 + 0.1 * x + 0.05 * y
    tree = np.hypot(x - 30, y - 30) < 5
    canopy = tree & (rng.uniform(size=x.size) < 0.6)
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.01] * 3, [500000, 4100000, 0]
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = x + 500000, y + 4100000, ground + 12 * canopy
    cloud.classification = np.where(canopy, 5, 2).astype("uint8")
    source = tmp_path / f"cloud.{suffix}"
    cloud.write(source)
    folder = run_import(source, tmp_path / "forest", "--crs", "EPSG:32611", "--cell", "1")
    with rasterio.open(folder / "terrain.tif") as out:
        dem = out.read(1, masked=True)
        rows, cols = np.indices(dem.shape)
        east, north = rasterio.transform.xy(out.transform, rows.ravel(), cols.ravel())
    plane = 100 + 0.1 * (np.array(east) - 500000) + 0.05 * (np.array(north) - 4100000)
    off = np.ma.abs(dem.ravel() - plane)
    assert off.max() < 0.2 and dem.count() > 3000
    chm = read(folder / "chm.tif")
    assert chm.max() == pytest.approx(12, abs=0.3)
    assert np.ma.median(chm) < 0.1
