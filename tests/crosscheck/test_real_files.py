"""Every real file at hand becomes a scene whose rasters other programs accept."""

import numpy as np
import pytest
import rasterio
from rio_cogeo.cogeo import cog_validate

from conftest import DATA, run_import, tomllib

PATTERNS = ["dem/*.tif", "clouds/*.laz", "canopy_pairs/*_dtm.tif", "gresolet/heightfield.elv"]
FILES = [path for pattern in PATTERNS for path in sorted(DATA.glob(pattern))]


def test_the_shared_data_is_there():
    if not FILES:
        pytest.skip("the shared data is missing: no real file was tried")
    assert len(FILES) >= 11


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_real_file(path, tmp_path):
    biome = "pyrenees" if path.suffix == ".elv" else "sonoma"
    folder = run_import(path, tmp_path / "forest", "--biome", biome)
    rasters = {raster.name for raster in folder.glob("*.tif")}
    assert {"terrain.tif", "sunlight.tif", "moisture.tif", "temperature.tif", "slope.tif"} <= rasters
    assert ({"chm.tif", "dsm.tif"} <= rasters) == (path.suffix == ".laz")
    for raster in folder.glob("*.tif"):
        assert cog_validate(raster, strict=True, quiet=True)[0], raster.name
    with rasterio.open(folder / "moisture.tif") as moisture:
        values = moisture.read(masked=True)
    assert values.min() >= 0 and values.max() <= 180.01
    with rasterio.open(folder / "sunlight.tif") as sunlight:
        hours = sunlight.read(masked=True)
    assert hours.min() >= 0 and hours.max() < 17
    assert np.isfinite(hours.compressed()).all()
    manifest = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
    books = manifest["stages"]["abiotics"]["figures"]
    spent = sum(books[f"{way}_mm_per_year"] for way in ("evaporation", "transpiration", "outflow"))
    assert spent == pytest.approx(books["rain_mm_per_year"], rel=1e-5)  # soil gains up to 2 µm a year
