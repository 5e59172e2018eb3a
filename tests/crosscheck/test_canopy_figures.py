"""The shipped networks on held-out real blocks, beside guided quilting, which is the reference of texture."""

import json
import subprocess
import sys

import pytest

from conftest import ROOT, real

pytest.importorskip("torch", reason="torch is missing: install training/requirements.txt")


@pytest.fixture(scope="module")
def sites(tmp_path_factory):
    for site in ("sjer", "harv"):
        for kind in ("dtm", "chm"):
            real(f"canopy_pairs/neon_{site}_4m_{kind}.tif")
    out = tmp_path_factory.mktemp("figures")
    models = [str(ROOT / "models" / f"{name}.onnx") for name in ("footprint", "height")]
    command = [sys.executable, "evaluate.py", "--footprint", models[0], "--height", models[1], "--out", str(out), "--synthetic-sites", "2", "--foreign-seeds", "1"]
    done = subprocess.run(command, cwd=ROOT / "training", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (out / "sheet.png").stat().st_size > 100_000
    return json.loads((out / "figures.json").read_text())["sites"]


SHIPPED = "two nets, generated stand height"
BARS = [
    # figure, low, high by site; sjer misses agreement, variogram, gaps and heights
    ("agreement", {"sjer": (0.93, 1), "harv": (0.95, 1)}, {"sjer"}),
    ("balanced", {"sjer": (0.90, 1), "harv": (0.88, 1)}, set()),
    ("cover_error", {"sjer": (0, 0.03), "harv": (0, 0.03)}, set()),
    ("maxima", {"sjer": (0.9, 1.15), "harv": (0.9, 1.15)}, set()),
    ("rumple", {"sjer": (0.9, 1.1), "harv": (0.9, 1.1)}, set()),
    ("variogram", {"sjer": (0, 0.13), "harv": (0, 0.31)}, {"sjer"}),
    ("lag4", {"sjer": (0.9, 1.1), "harv": (0.9, 1.1)}, set()),
    ("gap_ks", {"sjer": (0, 0.25), "harv": (0, 0.25)}, {"sjer"}),
    ("emd_m", {"sjer": (0, 0.3), "harv": (0, 1.8)}, {"sjer"}),
    ("spectrum", {"sjer": (0, 1.3), "harv": (0, 1.3)}, set()),
    ("order_jsd", {"sjer": (0, 1.18), "harv": (0, 0.92)}, set()),
]


@pytest.mark.parametrize("site", ["sjer", "harv"])
@pytest.mark.parametrize("figure, limits, missed", BARS, ids=[b[0] for b in BARS])
def test_generated_canopies_are_like_real_ones(sites, site, figure, limits, missed, request):
    if site in missed:
        request.applymarker(pytest.mark.xfail(reason="missed, see models/figures.md", raises=AssertionError, strict=True))
    low, high = limits[site]
    assert low <= sites[site]["rows"][SHIPPED][figure]["mean"] <= high


def test_quilting_is_the_reference_of_texture(sites):
    for site, order in (("sjer", 1.1), ("harv", 0.8)):
        row = sites[site]["rows"]["quilting 16"]
        assert row["order_jsd"]["mean"] < order
        assert 0.8 < row["maxima"]["mean"] < 1.2
