"""Every raster of a scene opens elsewhere as what it claims to be."""

import numpy as np
import pytest
import rasterio
from rio_cogeo.cogeo import cog_validate

from conftest import hills, read, real, run_import, write_tiff

MONTHS = [
    "January", "February", "March", "April", "May", "June",
    "July", "August", "September", "October", "November", "December",
]
MONTHLY = {"sunlight.tif": "h/day", "moisture.tif": "mm", "temperature.tif": "°C"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    home = tmp_path_factory.mktemp("scene")
    values = hills(700, 900).astype("float32")
    values[300:380, 400:520] = -9999  # a lake
    source = write_tiff(home / "dem.tif", values, nodata=-9999)
    return run_import(source, home / "forest"), source


def test_terrain_reads_back_equal(scene):
    folder, source = scene
    got, given = read(folder / "terrain.tif"), read(source)
    assert np.array_equal(got.mask, given.mask)
    assert np.array_equal(got.compressed(), given.compressed())
    with rasterio.open(folder / "terrain.tif") as a, rasterio.open(source) as b:
        assert a.crs == b.crs and a.transform == b.transform


def test_every_raster_is_a_valid_cog(scene):
    folder, _ = scene
    rasters = sorted(folder.glob("*.tif"))
    assert len(rasters) >= 5
    for path in rasters:
        valid, errors, warnings = cog_validate(path, strict=True, quiet=True)
        assert valid, (path.name, errors, warnings)


def test_bands_tell_month_and_unit(scene):
    folder, _ = scene
    for name, unit in MONTHLY.items():
        with rasterio.open(folder / name) as source:
            assert list(source.descriptions) == MONTHS, name
            assert set(source.units) == {unit}, name
            assert source.nodata == -9999
            assert source.overviews(1), name
            lake = source.read(7, masked=True).mask
            assert lake[320, 450] and not lake[0, 0], f"{name}: the lake stays masked"


def test_overviews_average_the_full_raster(scene):
    folder, _ = scene
    with rasterio.open(folder / "terrain.tif") as full:
        values = full.read(1, masked=True)
    with rasterio.open(folder / "terrain.tif", overview_level=0) as half:
        small = half.read(1, masked=True)
    expected = values[:200, :200].reshape(100, 2, 100, 2).mean(axis=(1, 3))
    assert np.allclose(small[:100, :100], expected, atol=1e-3)


@pytest.mark.parametrize("name", [
    "dem/slovenia_TM1_564_146_1m.tif", "canopy_pairs/neon_harv_4m_dtm.tif",
    "canopy_pairs/lidR_topography_dtm.tif", "dem/SFX_A01_2012_laz_1_denoised_dtm.tif",
])
def test_real_tiles_keep_their_heights(name, tmp_path):
    source = real(name)
    folder = run_import(source, tmp_path / "forest", "--fill-holes", "0")
    got, given = read(folder / "terrain.tif"), read(source).astype("float32")
    assert np.array_equal(np.ma.getmaskarray(got), np.ma.getmaskarray(given))
    assert np.array_equal(got.compressed(), given.compressed())
    for path in folder.glob("*.tif"):
        assert cog_validate(path, strict=True, quiet=True)[0], path.name
