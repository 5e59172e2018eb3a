"""Files that other programs write are read as what they are."""

import itertools

import numpy as np
import pytest
import rasterio
import rasterio.shutil
import tomllib
from rasterio.warp import Resampling, reproject
from rasterio.windows import Window

from conftest import NODATA, assert_equal, hills, read, run_import, write_tiff

LAYOUTS = {
    "strips": {},
    "tiles": dict(tiled=True, blockxsize=32, blockysize=16),
    "bigtiff": dict(BIGTIFF="YES", tiled=True, blockxsize=64, blockysize=64),
    "big-endian": dict(ENDIANNESS="BIG"),
    "big-endian-bigtiff": dict(ENDIANNESS="BIG", BIGTIFF="YES"),
}
PREDICTORS = {"int16": [1, 2], "uint16": [1, 2], "float32": [1, 2, 3], "float64": [1, 2, 3]}
COMPRESSIONS = ["none", "deflate", "lzw", "zstd"]
VARIANTS = [
    (layout, dtype, compress, predictor)
    for layout, dtype, compress in itertools.product(LAYOUTS, PREDICTORS, COMPRESSIONS)
    for predictor in PREDICTORS[dtype]
    if compress != "none" or predictor == 1
]


def imported_heights(source, tmp_path, *options):
    return read(run_import(source, tmp_path / "forest", *options) / "terrain.tif")


@pytest.mark.parametrize("layout, dtype, compress, predictor", VARIANTS)
def test_geotiff_variant(layout, dtype, compress, predictor, tmp_path):
    values = hills(50, 70)
    if dtype.startswith(("int", "uint")):
        values = np.round(values)
    values = values.astype(dtype)
    values[10:40, 0:3] = 9999
    more = dict(LAYOUTS[layout], compress=compress, nodata=9999)
    if predictor > 1:
        more["predictor"] = predictor
    source = write_tiff(tmp_path / "dem.tif", values, **more)
    expected = np.ma.masked_equal(values, 9999).astype("float32")
    assert_equal(imported_heights(source, tmp_path), expected)


@pytest.mark.parametrize("dtype", ["uint8", "int32", "uint32"])
def test_other_integers(dtype, tmp_path):
    values = np.round(hills(50, 70) - 320).astype(dtype)
    source = write_tiff(tmp_path / "dem.tif", values)
    assert_equal(imported_heights(source, tmp_path), values.astype("float32"))


def test_strips_that_do_not_divide_the_rows(tmp_path):
    values = hills(50, 70)
    source = write_tiff(tmp_path / "dem.tif", values, blockysize=7, compress="deflate")
    assert_equal(imported_heights(source, tmp_path), values)


def test_tiles_never_written_are_nodata(tmp_path):
    values = hills(64, 64)
    source, blocks = tmp_path / "dem.tif", dict(tiled=True, blockxsize=32, blockysize=32)
    write_tiff(source, values[:32, :32], **blocks)  # the profile's author; written over below
    with rasterio.open(source) as first:
        profile = dict(first.profile, height=64, width=64, nodata=NODATA, SPARSE_OK="TRUE")
    with rasterio.open(source, "w", **profile) as out:
        out.write(values[:, :32], 1, window=Window(0, 0, 32, 64))
    expected = np.ma.array(values, mask=np.arange(64) >= np.full((64, 1), 32))
    assert_equal(imported_heights(source, tmp_path), expected)


def test_scale_and_offset_are_applied(tmp_path):
    stored = np.round(hills(50, 70) * 10).astype("int16")
    source = write_tiff(tmp_path / "dem.tif", stored)
    with rasterio.open(source, "r+") as out:
        out.scales, out.offsets = [0.1], [25.0]
    assert np.allclose(imported_heights(source, tmp_path), stored * 0.1 + 25.0, atol=1e-4)


def test_heights_at_points_lie_in_cell_middles(tmp_path):
    """AREA_OR_POINT=Point moves what the file says, not where the cells lie."""
    source = write_tiff(tmp_path / "dem.tif", hills(50, 70))
    with rasterio.open(source, "r+") as out:
        out.update_tags(AREA_OR_POINT="Point")
        transform = out.transform
    with rasterio.open(run_import(source, tmp_path / "forest") / "terrain.tif") as got:
        assert got.transform == transform


@pytest.mark.parametrize("interleave", ["pixel", "band"])
def test_the_first_of_several_bands_is_the_height(interleave, tmp_path):
    values = hills(50, 70)
    source = write_tiff(tmp_path / "dem.tif", values, count=2, interleave=interleave, compress="deflate")
    with rasterio.open(source, "r+") as out:
        out.write(values * 0 + 7, 2)
    assert_equal(imported_heights(source, tmp_path), values)


def test_rows_from_the_south_are_turned(tmp_path):
    values = hills(50, 70)
    upward = rasterio.Affine(2, 0, 500000, 0, 2, 4099900)
    source = write_tiff(tmp_path / "dem.tif", values[::-1], transform=upward)
    folder = run_import(source, tmp_path / "forest")
    assert_equal(read(folder / "terrain.tif"), values)
    with rasterio.open(folder / "terrain.tif") as out:
        assert (out.transform.e, out.transform.f) == (-2, 4100000)


def test_the_vertical_part_of_a_crs_gives_the_unit(tmp_path):
    """UTM with NAVD88 heights in US survey feet."""
    values = hills(50, 70)
    source = write_tiff(tmp_path / "dem.tif", values, crs="EPSG:32611+6360")
    assert np.allclose(imported_heights(source, tmp_path), values * 1200 / 3937, rtol=1e-6)


def test_cog_with_overviews(tmp_path):
    values = hills(600, 700)
    source = write_tiff(tmp_path / "dem.tif", values, driver="COG", BLOCKSIZE=256)
    assert_equal(imported_heights(source, tmp_path), values)


def test_local_metres_stay_local(tmp_path):
    values = hills(50, 70)
    source = write_tiff(tmp_path / "dem.tif", values, crs=None, west=120.0, north=900.0)
    folder = run_import(source, tmp_path / "forest", "--latitude", "-42.5")
    with rasterio.open(folder / "terrain.tif") as got, rasterio.open(source) as given:
        assert not got.crs.is_projected and not got.crs.is_geographic and "LOCAL" in got.crs.to_wkt()
        assert got.transform == given.transform
        assert np.array_equal(got.read(1), values)
    scene = tomllib.loads((folder / "scene.toml").read_text())["scene"]
    assert scene["crs"] == "local" and scene["latitude_deg"] == pytest.approx(-42.5)
    assert scene["south_west_m"] == [120.0, 800.0] and scene["extent_m"] == [140.0, 100.0]


def test_ascii_grid_with_its_projection_beside(tmp_path):
    values = hills(40, 60)
    values[5, 5:9] = NODATA
    source = tmp_path / "dem.asc"
    with rasterio.open(write_tiff(tmp_path / "x.tif", values, nodata=NODATA)) as tif:
        rasterio.shutil.copy(tif, source, driver="AAIGrid", DECIMAL_PRECISION=4)
        transform = tif.transform
    assert source.with_suffix(".prj").exists()
    for crs in ([], ["--crs", "EPSG:32611"]):
        folder = run_import(source, tmp_path / f"forest{len(crs)}", "--fill-holes", "0", *crs)
        with rasterio.open(folder / "terrain.tif") as out:
            assert out.crs.to_epsg() == 32611 and out.transform == transform
        got = read(folder / "terrain.tif")
        assert got.mask.sum() == 4 and np.array_equal(got.mask, values == NODATA)
        assert np.abs(got - values).max() < 1e-3


def test_elv(tmp_path):
    """Columns, rows, cell width, latitude; then rows from the south."""
    values = hills(30, 40)
    source = tmp_path / "heightfield.elv"
    rows = "\n".join(" ".join(f"{v:.3f}" for v in row) for row in values[::-1])
    source.write_text(f"40 30 2.0 42.5\n{rows}\n")
    folder = run_import(source, tmp_path / "forest")
    assert np.abs(read(folder / "terrain.tif") - values).max() < 1e-3
    scene = tomllib.loads((folder / "scene.toml").read_text())["scene"]
    assert (scene["latitude_deg"], scene["cell_m"]) == (pytest.approx(42.5), 2.0)


@pytest.mark.parametrize("unit, metres", [("ft", 0.3048), ("us-ft", 1200 / 3937), (None, 1200 / 3937)])
def test_feet_become_metres(unit, metres, tmp_path):
    """California zone 3 in US survey feet; heights by the user's word, else in the map's unit."""
    feet = (hills(80, 80, cell=1.0) / 0.3048).astype("float32")
    source = write_tiff(tmp_path / "dem.tif", feet, cell=3.0, crs="EPSG:2227", west=6e6, north=2.1e6)
    words = ["--vertical-unit", unit] if unit else []
    folder = run_import(source, tmp_path / "forest", "--resampling", "bilinear", *words)
    with rasterio.open(source) as given, rasterio.open(folder / "terrain.tif") as out:
        assert out.crs.to_epsg() == 32610
        assert abs(out.transform.a - 3.0 * 1200 / 3937) < 0.01
        got, expected = out.read(1, masked=True), np.full(out.shape, NODATA, "float32")
        reproject(
            (given.read(1) * metres).astype("float32"), expected,
            src_transform=given.transform, src_crs=given.crs, src_nodata=NODATA,
            dst_transform=out.transform, dst_crs=out.crs, dst_nodata=NODATA,
            resampling=Resampling.bilinear, XSCALE=1, YSCALE=1,
        )
    inner = np.zeros(got.shape, bool)
    inner[3:-3, 3:-3] = ~got.mask[3:-3, 3:-3]
    assert inner.mean() > 0.8
    # GDAL's and our datum shift agree to millimetres; the two feet differ by 0.8 mm in 400 m
    assert np.abs(got - expected)[inner].max() < 0.02
    assert abs(float((got - expected)[inner].mean())) < 2e-4
