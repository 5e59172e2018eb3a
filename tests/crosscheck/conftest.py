"""Outside programs hold wildwood's files to their formats and its numbers to their own."""

import os
import pathlib
import subprocess

import numpy as np
import pytest
import rasterio

try:
    import tomllib
except ModuleNotFoundError:  # before Python 3.11
    import tomli as tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
TARGET = ROOT / os.environ.get("CARGO_TARGET_DIR", "target")
WILDWOOD = TARGET / "release" / "wildwood"
DATA = pathlib.Path(os.environ.get("WILDWOOD_DATA", ROOT.parent / "shared" / "data"))
NODATA = -9999.0


def run_import(inputs, folder, *options):
    inputs = [inputs] if isinstance(inputs, (str, pathlib.Path)) else inputs
    command = [WILDWOOD, "import", *inputs, "-o", folder, "--quiet", *options]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def run_grow(terrain, chm, folder, *options):
    """A scene with canopy trees fitted to a canopy height model."""
    if subprocess.run([WILDWOOD, "grow", "--help"], capture_output=True).returncode != 0:
        pytest.skip("this wildwood has no command `grow`")
    command = [WILDWOOD, "grow", terrain, "--chm", chm, "--biome", "sonoma", "-o", folder, "--quiet"]
    done = subprocess.run([str(c) for c in [*command, *options]], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def scene_head(folder):
    """What scene.toml says of the scene as a whole."""
    return tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))["scene"]


def real(path):
    """A real file, or the test is skipped aloud."""
    full = DATA / path
    if not full.exists():
        pytest.skip(f"../shared/data is missing: {path}")
    return full


def hills(rows=96, cols=120, cell=2.0, amplitude=40.0):
    """A smooth landscape whose every cell differs from its neighbours, float32."""
    y, x = np.mgrid[0:rows, 0:cols] * cell
    waves = amplitude * np.sin(x / 47.0) * np.cos(y / 39.0)
    return (400.0 + waves + 0.11 * x - 0.07 * y).astype("float32")


def canopy_pair(rows=120, cols=160, spacing=9, cell=1.0):
    """Smooth ground, and over it round crowns on a grid: terrain and canopy height, float32."""
    y, x = np.mgrid[0:rows, 0:cols]
    tree_row, tree_col = y // spacing, x // spacing
    top = 12.0 + 7.0 * ((3 * tree_row + 5 * tree_col) % 4)
    off_y, off_x = y - (tree_row + 0.5) * spacing, x - (tree_col + 0.5) * spacing
    canopy = top - (off_x**2 + off_y**2) * cell**2 / 8.0
    return hills(rows, cols, cell, 8.0), np.maximum(canopy, 0.0).astype("float32")


def write_tiff(path, values, cell=2.0, crs="EPSG:32611", west=500000.0, north=4100000.0, **options):
    profile = dict(
        driver="GTiff", height=values.shape[0], width=values.shape[1], count=1,
        dtype=str(values.dtype), crs=crs,
        transform=rasterio.transform.from_origin(west, north, cell, cell),
    )
    profile.update(options)
    with rasterio.open(path, "w", **profile) as out:
        out.write(values, 1)
    return path


def read(path, band=1):
    """A band in which masked cells are masked; the mask is an array always."""
    with rasterio.open(path) as source:
        values = source.read(band, masked=True)
    return np.ma.array(values.data, mask=np.ma.getmaskarray(values))


def assert_equal(got, expected):
    """Same cells masked, same bits in the others."""
    assert got.shape == expected.shape
    assert np.array_equal(np.ma.getmaskarray(got), np.ma.getmaskarray(expected))
    assert np.array_equal(got.compressed(), np.ma.compressed(expected))
