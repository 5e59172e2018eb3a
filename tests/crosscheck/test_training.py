"""Training from scratch on two small planted pairs: losses fall, and what is exported grows a forest."""

import csv
import subprocess
import sys

import pytest
import rasterio

from conftest import ROOT, WILDWOOD, hills

torch = pytest.importorskip("torch", reason="torch is missing: install training/requirements.txt")
sys.path.insert(0, str(ROOT / "training"))
import synthetic  # noqa: E402

STEPS = 900


def write(path, values, cell=4.0):
    transform = rasterio.transform.from_origin(500_000.0, 5_200_000.0, cell, cell)
    with rasterio.open(path, "w", driver="GTiff", height=values.shape[0], width=values.shape[1], count=1, dtype="float32", crs="EPSG:32633", transform=transform) as file:
        file.write(values.astype("float32"), 1)
    return path


def run(script, *arguments):
    done = subprocess.run([sys.executable, ROOT / "training" / script, *[str(a) for a in arguments]], capture_output=True, text=True, cwd=ROOT / "training")
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    home = tmp_path_factory.mktemp("training")
    pairs = home / "pairs"
    pairs.mkdir()
    for i, site in enumerate(synthetic.sites(2, size=128, first_seed=40)):
        write(pairs / f"toy{i}_dtm.tif", site.dtm_m)
        write(pairs / f"toy{i}_chm.tif", site.chm_m)
    small = ["--pairs", pairs, "--crop", 32, "--batch", 4, "--features", 8, "--critic-features", 8, "--synthetic-sites", 2, "--save-every", 120, "--sheet-every", STEPS, "--learning-rate", 1e-3]
    for stage in ("footprint", "height"):
        run("train.py", stage, "--out", home / stage, "--steps", STEPS, *small)
    return home


@pytest.mark.parametrize("stage", ["footprint", "height"])
def test_losses_fall(runs, stage):
    with open(runs / stage / "losses.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    first, last = ({k: float(v) for k, v in row.items() if v} for row in (rows[0], rows[-1]))
    assert last["step"] == STEPS
    for loss in ("texture", "blocks", "levels") + (("sketch",) if stage == "footprint" else ()):
        assert last[loss] < 0.85 * first[loss], f"{loss}: {first[loss]} to {last[loss]}"
    for file in ("config.json", "checkpoint.pt", "losses.png", f"samples_{STEPS:06}.png"):
        assert (runs / stage / file).exists()


def test_exported_networks_grow_a_forest(runs, tmp_path):
    run("export.py", "--footprint", runs / "footprint", "--height", runs / "height", "--out", tmp_path / "models")
    dem = write(tmp_path / "dem.tif", hills(64, 64, 4.0))
    command = [WILDWOOD, "grow", dem, "--density", "dense", "--models", tmp_path / "models", "--onnx", "rten", "-o", tmp_path / "forest", "--quiet"]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "forest" / "footprint.tif").exists()
