"""Slope, warps, mosaics, windows and averages against GDAL, PROJ and numpy."""

import shutil
import subprocess

import numpy as np
import pyproj
import pytest
import rasterio
import rasterio.shutil
from rasterio.warp import Resampling, calculate_default_transform, reproject

from conftest import NODATA, assert_equal, hills, read, real, run_import, write_tiff

SLOVENIA = "dem/slovenia_TM1_564_146_1m.tif"
METHODS = {"bilinear": Resampling.bilinear, "bicubic": Resampling.cubic}


def gdal(*command):
    if not shutil.which(command[0]):
        pytest.skip(f"{command[0]} is missing: install gdal-bin")
    subprocess.run([str(word) for word in command], check=True)


@pytest.mark.parametrize("name", [None, SLOVENIA, "canopy_pairs/bcts_bc_dtm.tif"])
def test_slope_is_gdaldem_slope(name, tmp_path):
    """Horn's slope, rims and neighbours of voids too. Both files hold degrees; both are compared in radians."""
    if name:
        source = real(name)
    else:
        values = hills(200, 230)
        values[60:80, 100:140] = NODATA
        source = write_tiff(tmp_path / "dem.tif", values, nodata=NODATA)
    folder = run_import(source, tmp_path / "forest")
    gdal("gdaldem", "slope", "-compute_edges", "-q", folder / "terrain.tif", tmp_path / "slope.tif")
    expected, got = read(tmp_path / "slope.tif"), read(folder / "slope.tif")
    both = ~expected.mask & ~got.mask
    assert both.sum() > 0.99 * (~got.mask).sum() > 0
    off_rad = np.abs(np.radians(got.data.astype("float64")) - np.radians(expected.data.astype("float64")))
    assert off_rad[both].max() < 1e-4, off_rad[both].max()


def height_change_over_half_a_cell(values):
    """Half the largest height difference to a neighbour."""
    padded = np.pad(values, 1, mode="edge")
    rows, cols = values.shape
    shifted = (padded[r:r + rows, c:c + cols] for r, c in ((0, 1), (2, 1), (1, 0), (1, 2)))
    return np.max([np.abs(values - neighbour) for neighbour in shifted], axis=0) / 2


def geographic_copy(source, path):
    with rasterio.open(source) as src:
        transform, width, height = calculate_default_transform(
            src.crs, "EPSG:4326", src.width, src.height, *src.bounds
        )
        values = np.full((height, width), NODATA, "float32")
        reproject(
            src.read(1), values, src_transform=src.transform, src_crs=src.crs, src_nodata=src.nodata,
            dst_transform=transform, dst_crs="EPSG:4326", dst_nodata=NODATA, resampling=Resampling.cubic,
        )
    profile = dict(driver="GTiff", height=height, width=width, count=1, dtype="float32",
                   crs="EPSG:4326", transform=transform, nodata=NODATA)
    with rasterio.open(path, "w", **profile) as out:
        out.write(values, 1)
    return path


class Warped:
    """A raster in degrees, wildwood's terrain of it, and what others make of it on the same grid."""

    def __init__(self, original, method, home):
        self.method, self.source = method, geographic_copy(original, home / "degrees.tif")
        folder = run_import(self.source, home / "forest", "--resampling", method, "--fill-holes", "0")
        self.got = read(folder / "terrain.tif")
        with rasterio.open(folder / "terrain.tif") as out, rasterio.open(self.source) as src:
            self.transform, self.crs = out.transform, out.crs
            self.degrees, self.degrees_transform = src.read(1), src.transform
        assert self.crs.to_epsg() // 100 == 326
        self.exact = self.interpolated()
        self.whole = np.isfinite(self.exact)
        assert (self.whole & self.got.mask).sum() == 0, "a cell with all its neighbours has a height"
        assert self.whole.sum() > 0.95 * (~self.got.mask).sum() > 0.4 * self.got.size

    def interpolated(self):
        """Exact positions of PROJ, weights written out; NaN where one of the 4 × 4 neighbours is missing."""
        rows, cols = np.indices(self.got.shape) + 0.5
        x, y = self.transform.c + cols * self.transform.a, self.transform.f + rows * self.transform.e
        lon, lat = pyproj.Transformer.from_crs(self.crs, "EPSG:4326", always_xy=True).transform(x, y)
        t = self.degrees_transform
        places = (lat - t.f) / t.e - 0.5, (lon - t.c) / t.a - 0.5
        firsts = [np.floor(place).astype(int) for place in places]
        padded = np.pad(np.where(self.degrees == NODATA, np.nan, self.degrees.astype("float64")), 3,
                        constant_values=np.nan)
        firsts_clipped = [np.clip(f, -2, n) for f, n in zip(firsts, self.degrees.shape)]
        row_weights, col_weights = (
            self.weights(place - first) for place, first in zip(places, firsts)
        )
        total = np.zeros(self.got.shape)
        for r, c in np.ndindex(4, 4):
            neighbour = padded[firsts_clipped[0] + r + 2, firsts_clipped[1] + c + 2]
            total += row_weights[r] * col_weights[c] * neighbour
        return total

    def weights(self, t):
        if self.method == "bilinear":
            return 0 * t, 1 - t, t, 0 * t
        # Keys's cubic, a = -1/2
        near, far = (lambda d: 1.5 * d**3 - 2.5 * d**2 + 1), (lambda d: -0.5 * d**3 + 2.5 * d**2 - 4 * d + 2)
        return far(1 + t), near(t), near(1 - t), far(2 - t)

    def farthest(self, expected):
        """Largest distance from `expected` where every neighbour has a height, metres."""
        return float(np.abs(self.got.data - expected)[self.whole].max())


@pytest.fixture(scope="module", params=[(n, m) for n in (None, SLOVENIA) for m in METHODS], ids=str)
def warped(request, tmp_path_factory):
    name, method = request.param
    home = tmp_path_factory.mktemp("warp")
    original = real(name) if name else write_tiff(home / "m.tif", hills(300, 260))
    return Warped(original, method, home)


def test_warp_is_gdal_warp_within_half_a_cell(warped):
    """GDAL with its approximate transformer, as users run it, and the plain kernel.

    Degrees are narrower cells one way than the other: GDAL then takes the target for coarser and widens its
    kernel, which smooths; XSCALE and YSCALE hold it to the kernel that was asked for.
    """
    expected = np.full(warped.got.shape, NODATA, "float32")
    reproject(
        warped.degrees, expected, src_transform=warped.degrees_transform, src_crs="EPSG:4326", src_nodata=NODATA,
        dst_transform=warped.transform, dst_crs=warped.crs, dst_nodata=NODATA,
        resampling=METHODS[warped.method], XSCALE=1, YSCALE=1,
    )
    inside = ~warped.got.mask & (expected != NODATA)
    assert inside.sum() > 0.99 * (~warped.got.mask).sum()
    allowed = height_change_over_half_a_cell(np.where(expected == NODATA, warped.got.data, expected))
    off = np.abs(warped.got.data - expected)
    # 1 cm: GDAL places to an eighth of a cell, and flat ground has next to no height change
    excess = (off - np.maximum(allowed, 0.01))[inside]
    assert excess.max() <= 0, (int((excess > 0).sum()), float(excess.max()))


def test_warp_is_gdal_warp_exactly(warped, tmp_path):
    """GDAL with its exact transformer agrees to a millimetre."""
    rows, cols = warped.got.shape
    west, north, cell = warped.transform.c, warped.transform.f, warped.transform.a
    gdal(
        "gdalwarp", "-q", "-et", 0, "-wo", "XSCALE=1", "-wo", "YSCALE=1", "-r",
        {"bilinear": "bilinear", "bicubic": "cubic"}[warped.method], "-t_srs", warped.crs.to_string(),
        "-te", west, north - rows * cell, west + cols * cell, north, "-ts", cols, rows,
        "-dstnodata", NODATA, warped.source, tmp_path / "warped.tif",
    )
    assert warped.farthest(read(tmp_path / "warped.tif").data) < 1e-3


def test_warp_is_proj_and_the_kernel_written_out(warped):
    assert warped.farthest(warped.exact) < 1e-3


QUARTERS = [((70, 150), (80, 170)), ((0, 70), (0, 80)), ((70, 150), (0, 80)), ((0, 70), (80, 170))]


def ascii_copy(source):
    """As an ESRI ASCII grid, its .prj beside."""
    target = source.with_suffix(".asc")
    rasterio.shutil.copy(source, target, driver="AAIGrid", SIGNIFICANT_DIGITS=9)
    assert target.with_suffix(".prj").exists()
    return target


@pytest.mark.parametrize("suffix", ["tif", "asc"])
@pytest.mark.parametrize("overlap", [0, 6])
def test_four_tiles_equal_the_whole(suffix, overlap, tmp_path):
    """Tiles with a lake across all seams, given in no order: every raster as if there was one file."""
    values = hills(150, 170)
    values[60:90, 70:100] = NODATA
    whole = write_tiff(tmp_path / "whole.tif", values, nodata=NODATA)
    tiles = []
    for number, quarter in enumerate(QUARTERS):
        (top, bottom), (left, right) = ((max(start - overlap, 0), end) for start, end in quarter)
        corner = dict(west=500000.0 + 2 * left, north=4100000.0 - 2 * top, nodata=NODATA)
        tile = write_tiff(tmp_path / f"tile{number}.tif", values[top:bottom, left:right], **corner)
        tiles.append(tile if suffix == "tif" else ascii_copy(tile))
    one, joined = run_import(whole, tmp_path / "one"), run_import(tiles, tmp_path / "joined")
    with rasterio.open(one / "terrain.tif") as a, rasterio.open(joined / "terrain.tif") as b:
        assert a.transform == b.transform and a.crs == b.crs
    for raster in sorted(one.glob("*.tif")):
        assert_equal(read(joined / raster.name), read(raster))


@pytest.mark.parametrize("suffix", ["tif", "asc"])
@pytest.mark.parametrize("window, rows, cols", [
    ((500040, 4099900, 500140, 4099960), (20, 50), (20, 70)),
    # cells whose middles lie inside
    ((500040.9, 4099900.9, 500140.9, 4099960.9), (20, 50), (20, 70)),
    ((500041.1, 4099901.1, 500141.1, 4099961.1), (19, 49), (21, 71)),
    # beyond the raster
    ((499000, 4099900, 500140, 4200000), (0, 50), (0, 70)),
])
def test_bbox_crops_exactly(suffix, window, rows, cols, tmp_path):
    values = hills(100, 120)
    source = write_tiff(tmp_path / "dem.tif", values, tiled=True, blockxsize=32, blockysize=32)
    if suffix == "asc":
        source = ascii_copy(source)
    folder = run_import(source, tmp_path / "forest", "--bbox", ",".join(map(str, window)))
    with rasterio.open(folder / "terrain.tif") as out:
        corner = (out.transform.c, out.transform.f, out.transform.a)
        assert corner == (500000 + 2 * cols[0], 4100000 - 2 * rows[0], 2)
        assert_equal(out.read(1, masked=True), values[slice(*rows), slice(*cols)])


def test_wider_cells_are_means(tmp_path):
    """--cell 2 over 1 m cells: each cell the mean of its four, where at least two have heights."""
    values = hills(80, 100, cell=1.0)
    values[20:27, 30:41] = NODATA
    source = write_tiff(tmp_path / "dem.tif", values, cell=1.0, nodata=NODATA)
    folder = run_import(source, tmp_path / "forest", "--cell", "2", "--fill-holes", "0")
    blocks = np.ma.masked_equal(values, NODATA).astype("float64").reshape(40, 2, 50, 2)
    expected = np.ma.masked_where(blocks.count(axis=(1, 3)) < 2, blocks.mean(axis=(1, 3)))
    got = read(folder / "terrain.tif")
    with rasterio.open(folder / "terrain.tif") as out:
        assert (out.transform.c, out.transform.f, out.transform.a) == (500000, 4100000, 2)
    assert np.array_equal(got.mask, np.ma.getmaskarray(expected)) and got.mask.any()
    assert np.ma.abs(got - expected).max() < 1e-4
