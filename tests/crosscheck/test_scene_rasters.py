"""Every raster of a scene opens elsewhere as what it claims to be."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
import rasterio
from rio_cogeo.cogeo import cog_validate

from conftest import NODATA, assert_equal, hills, read, real, run_import, write_tiff

MONTHS = (
    "January", "February", "March", "April", "May", "June",
    "July", "August", "September", "October", "November", "December",
)
BANDS = {
    "terrain.tif": (("elevation",), "m"),
    "slope.tif": (("slope",), "°"),
    "sunlight.tif": (MONTHS, "h/day"),
    "moisture.tif": (MONTHS, "mm"),
    "temperature.tif": (MONTHS, "°C"),
    "discharge.tif": (("mean discharge",), "m3/s"),
}
REAL_TILES = [
    "dem/slovenia_TM1_564_146_1m.tif", "canopy_pairs/neon_harv_4m_dtm.tif",
    "canopy_pairs/lidR_topography_dtm.tif", "dem/SFX_A01_2012_laz_1_denoised_dtm.tif",
]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Two lakes, one at the rim, and more cells than one tile of the output has."""
    home = tmp_path_factory.mktemp("scene")
    values = hills(700, 900)
    values[300:380, 400:520] = NODATA
    values[:90, 850:] = NODATA
    source = write_tiff(home / "dem.tif", values, nodata=NODATA)
    return run_import(source, home / "forest"), source


def assert_valid_cogs(folder):
    for path in sorted(folder.glob("*.tif")):
        valid, errors, warnings = cog_validate(path, strict=True, quiet=True)
        assert valid and not errors and not warnings, (path.name, errors, warnings)


def test_terrain_reads_back_equal(scene):
    folder, source = scene
    assert_equal(read(folder / "terrain.tif"), read(source))
    with rasterio.open(folder / "terrain.tif") as got, rasterio.open(source) as given:
        assert got.crs == given.crs and got.transform == given.transform


def test_every_raster_is_a_valid_cog(scene):
    assert {path.name for path in scene[0].glob("*.tif")} == set(BANDS)
    assert_valid_cogs(scene[0])


@pytest.mark.parametrize("name", BANDS)
def test_bands_tell_name_and_unit_and_keep_lakes_masked(name, scene):
    folder, source = scene
    names, unit = BANDS[name]
    with rasterio.open(folder / name) as raster, rasterio.open(source) as given:
        assert raster.descriptions == names and raster.units == (unit,) * len(names)
        assert set(raster.dtypes) == {"float32"} and set(raster.nodatavals) == {NODATA}
        assert raster.crs == given.crs and raster.transform == given.transform
        lakes = given.read(1) == NODATA
        for band, name in enumerate(names, start=1):
            assert raster.overviews(band) == [2], name
            values = raster.read(band, masked=True)
            assert np.array_equal(values.mask, lakes), name
            assert np.isfinite(values.compressed()).all(), name
            assert len(np.unique(values.compressed())) > 1, f"{name} is one value everywhere"


def test_the_command_rio_tells_months_and_units(scene):
    """A user's view: `rio info` with what the bands are called."""
    command = [pathlib.Path(sys.executable).parent / "rio", "info", scene[0] / "moisture.tif"]
    told = json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    assert tuple(told["descriptions"]) == MONTHS and set(told["units"]) == {"mm"}
    assert told["nodata"] == NODATA and told["crs"] == "EPSG:32611" and told["tiled"]


@pytest.mark.parametrize("name", ["terrain.tif", "sunlight.tif"])
def test_overviews_average_the_full_raster(name, scene):
    path, lake = scene[0] / name, (slice(100, 220), slice(150, 300))
    full = read(path)
    with rasterio.open(path, overview_level=0) as half:
        small = half.read(1, masked=True)
    assert small.shape == (350, 450)
    blocks = full.reshape(350, 2, 450, 2)
    expected = blocks.mean(axis=(1, 3))  # of the valid cells
    assert np.array_equal(small.mask, expected.mask) and small.mask[lake].any()
    # values of monthly maps are rounded to 14 bits of mantissa
    assert np.ma.allclose(small, expected, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", REAL_TILES)
def test_real_tiles_keep_their_heights(name, tmp_path):
    source = real(name)
    folder = run_import(source, tmp_path / "forest", "--fill-holes", "0")
    given = read(source).astype("float32")
    assert_equal(read(folder / "terrain.tif"), given)
    assert_valid_cogs(folder)
    for raster in BANDS:
        assert np.array_equal(read(folder / raster).mask, given.mask), raster
