"""Trees grown on measured canopies: opened by GeoPandas, their fit worked out anew from the files alone."""

import geopandas
import numpy as np
import pytest
import rasterio
from scipy import ndimage, spatial
from skimage.feature import peak_local_max

from conftest import read, real, run_grow, tomllib

PAIRS = ["neon_sjer_4m", "neon_harv_4m", "bcts_bc", "pyfor_osbs", "lidR_topography"]
MOST_OVERHANG = {"neon_sjer_4m": 0.15, "neon_harv_4m": 0.15}  # cells of 4 m; 0.08 elsewhere


def crown_cells(trees, transform, shape, per_cell):
    """Which cells, cut into `per_cell` by `per_cell`, have their centre under a crown."""
    rows, cols = shape[0] * per_cell, shape[1] * per_cell
    cell = transform.a / per_cell
    under = np.zeros((rows, cols), bool)
    for x, y, r in zip(trees.geometry.x, trees.geometry.y, trees.crown_radius_m):
        col, row = (x - transform.c) / cell - 0.5, (transform.f - y) / cell - 0.5
        reach = r / cell
        top, left = max(0, int(np.ceil(row - reach))), max(0, int(np.ceil(col - reach)))
        bottom, right = int(row + reach) + 1, int(col + reach) + 1
        dy, dx = np.ogrid[top - row:min(bottom, rows) - row, left - col:min(right, cols) - col]
        under[top:bottom, left:right] |= dy**2 + dx**2 <= reach**2 + 1e-6
    return under


@pytest.mark.parametrize("name", PAIRS)
def test_trees_fit_the_canopy(name, tmp_path):
    terrain = real(f"canopy_pairs/{name}_dtm.tif")
    folder = run_grow(terrain, real(f"canopy_pairs/{name}_chm.tif"), tmp_path / "forest", "--gpu", "off")
    plants = geopandas.read_parquet(folder / "plants.parquet")
    trees = plants[plants["layer"] == "canopy"]
    figures = tomllib.loads((folder / "scene.toml").read_text())["stages"]["canopy"]["figures"]
    assert len(trees) == figures["trees"] > 0
    with rasterio.open(terrain) as source:
        assert trees.crs == source.crs
        transform = source.transform
    chm = read(real(f"canopy_pairs/{name}_chm.tif")).filled(0.0)

    # every tree on canopy as high as it is, trunks apart, no crown within another
    places = np.column_stack([trees.geometry.x, trees.geometry.y])
    rows = ((transform.f - places[:, 1]) / transform.a).astype(int)
    cols = ((places[:, 0] - transform.c) / transform.a).astype(int)
    at_trunk = chm[rows, cols]
    assert at_trunk.min() >= 3.0
    assert np.sqrt(np.mean((trees.height_m - at_trunk) ** 2)) <= 1.5
    tree = spatial.cKDTree(places)
    radius = trees.crown_radius_m.to_numpy()
    distance, _ = tree.query(places, k=2)
    assert distance[:, 1].min() >= 1.0
    # a crown within another has its trunk closer than that one's radius
    pairs = tree.query_pairs(radius.max(), output_type="ndarray")
    assert len(pairs)
    apart = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    assert (apart > np.abs(radius[pairs[:, 0]] - radius[pairs[:, 1]]) - 1e-3).all()

    # coverage and overhang
    per_cell = figures["working_cells_per_cell"]
    under = crown_cells(trees, transform, chm.shape, per_cell)
    canopy = np.kron(chm >= 3.0, np.ones((per_cell, per_cell), bool))
    coverage = (under & canopy).sum() / canopy.sum()
    overhang = (under & ~canopy).sum() / under.sum()
    assert coverage == pytest.approx(figures["coverage_fraction"], abs=2e-3)
    assert overhang == pytest.approx(figures["overhang_fraction"], abs=2e-3)
    assert coverage >= 0.98
    if per_cell > 1:  # by area, at places that no crown was fitted to
        by_area = crown_cells(trees, transform, chm.shape, 12)[np.kron(chm >= 3.0, np.ones((12, 12), bool))].mean()
        assert by_area >= {"neon_harv_4m": 0.98, "neon_sjer_4m": 0.955}[name]
    if name == "lidR_topography":
        assert 0.08 < overhang < 0.14
        pytest.xfail("8 % of overhang is missed: a sparse cloud's canopy is as ragged as its cells, see README")
    assert overhang <= MOST_OVERHANG.get(name, 0.08)


@pytest.mark.parametrize("name", ["bcts_bc", "pyfor_osbs"])
def test_as_many_trees_as_tops(name, tmp_path):
    chm_file = real(f"canopy_pairs/{name}_chm.tif")
    folder = run_grow(real(f"canopy_pairs/{name}_dtm.tif"), chm_file, tmp_path / "forest", "--gpu", "off")
    plants = geopandas.read_parquet(folder / "plants.parquet")
    trees = plants[plants["layer"] == "canopy"]
    smooth = ndimage.gaussian_filter(read(chm_file).filled(0.0), 0.5)
    tops = peak_local_max(smooth, min_distance=1, threshold_abs=3.0, exclude_border=False)
    assert 0.75 <= len(trees) / len(tops) <= 1.25
