"""The tour in README.md runs as it is printed there, on a small cut of a real tile with a painted sketch."""

import json
import re
import shlex
import sqlite3
import subprocess

import geopandas
import numpy as np
import pytest
import rasterio
from PIL import Image
from rasterio.windows import Window

from conftest import ROOT, WILDWOOD, real

SIDE = 96  # cells of 1 m


def tour():
    """The commands of the tour's code block, word by word, without their remarks."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = re.search(r"^## A tour in five minutes\n(.*?)^## ", text, re.M | re.S).group(1)
    block = re.search(r"^```sh\n(.*?)^```", section, re.M | re.S).group(1)
    return [shlex.split(line, comments=True) for line in block.splitlines() if line.strip()]


def outputs(command):
    """What a command of the tour names that it writes: -o, else the scene folder that it changes."""
    return command[command.index("-o") + 1] if "-o" in command else command[2]


@pytest.fixture(scope="module")
def toured(tmp_path_factory):
    """A folder after the tour, with what each command was to write."""
    home = tmp_path_factory.mktemp("tour")
    with rasterio.open(real("dem/slovenia_TM1_564_146_1m.tif")) as tile:
        window = Window(300, 300, SIDE, SIDE)
        cut = dict(
            driver="GTiff", height=SIDE, width=SIDE, count=1, dtype=tile.dtypes[0], crs=tile.crs,
            nodata=tile.nodata, transform=tile.window_transform(window),
        )
        with rasterio.open(home / "dtm.tif", "w", **cut) as out:
            out.write(tile.read(1, window=window), 1)
    sketch = np.full((SIDE, SIDE), 255, "uint8")  # woods
    sketch[40:60] = 128  # a belt of single trees
    sketch[60:, :30] = 0  # a meadow
    Image.fromarray(np.dstack([sketch] * 3)).save(home / "sketch.png")
    written = []
    for command in tour():
        assert command[0] == "wildwood", command
        done = subprocess.run(
            [str(WILDWOOD), *command[1:]], cwd=home, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, (command, done.stderr)
        path = home / outputs(command)
        assert path.exists(), command
        written.append(path)
    return home, written


def test_the_tour_goes_from_terrain_to_every_program(toured):
    home, written = toured
    verbs = [command[1] for command in tour()]
    assert [verb for n, verb in enumerate(verbs) if verb not in verbs[:n]] == [
        "import", "grow", "age", "render", "export",
    ]
    assert {path.name for path in written} == {
        "forest", "forest.png", "forest.gpkg", "forest-tiles", "forest.usda", "forest.glb",
    }
    made = {path.name for path in home.iterdir()} - {"dtm.tif", "sketch.png"}
    assert made == {path.name for path in written}, "the tour leaves something it does not name"


def test_what_it_says_to_open_is_there(toured):
    home, _ = toured
    # QGIS
    with sqlite3.connect(home / "forest.gpkg") as package:
        layers = {name for (name,) in package.execute("SELECT table_name FROM gpkg_contents")}
    assert layers == {"plants", "snags", "downed_logs", "crowns"}
    assert "species" in geopandas.read_file(home / "forest.gpkg", layer="crowns", rows=1)
    for name, bands in {"moisture": 12, "sunlight": 12, "chm": 1}.items():
        with rasterio.open(home / "forest" / f"{name}.tif") as raster:
            assert raster.count == bands and raster.crs.to_epsg() == 3794
    tileset = json.loads((home / "forest-tiles" / "tileset.json").read_text(encoding="utf-8"))
    assert tileset["asset"]["version"] == "1.1"
    # Blender
    assert (home / "forest.usda").read_text(encoding="utf-8").startswith("#usda 1.0")
    assert (home / "forest.glb").read_bytes().startswith(b"glTF")
    # pictures
    for picture in ["forest.png", "forest/preview.png"]:
        pixels = np.asarray(Image.open(home / picture).convert("L"), dtype="float32")
        assert pixels.std() > 10.0, picture


def test_the_forest_follows_the_sketch_and_has_aged(toured):
    home, _ = toured
    start = geopandas.read_parquet(home / "forest" / "plants_at_start.parquet")
    trees = start[start.layer == "canopy"]
    with rasterio.open(home / "forest" / "terrain.tif") as terrain:
        rows, cols = rasterio.transform.rowcol(terrain.transform, trees.geometry.x, trees.geometry.y)
    rows, cols = np.asarray(rows), np.asarray(cols)
    meadow = (rows > 64) & (cols < 26)
    woods = rows < 36
    assert not meadow.any() and woods.sum() > 20
    for table in ["snags", "downed_logs"]:
        assert len(geopandas.read_parquet(home / "forest" / f"{table}.parquet")) > 10, table


def test_named_files_and_headings_exist():
    """Examples and the section that the tour points to."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = re.search(r"^## A tour in five minutes\n(.*?)^## ", text, re.M | re.S).group(1)
    for example in ["quickstart", "sketch_to_forest", "ageing_with_a_storm"]:
        assert example in section and (ROOT / "examples" / f"{example}.rs").exists()
    assert "(#the-scene-folder)" in section and "\n## The scene folder\n" in text
