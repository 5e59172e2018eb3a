"""Learned canopies: the shipped networks by Python's onnxruntime, and grown scenes against a chain of our own."""

import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import onnxruntime
import pytest
import rasterio
from PIL import Image
from scipy import ndimage

from conftest import ROOT, TARGET, WILDWOOD, hills, read, real, tomllib

sys.path.insert(0, str(ROOT / "training"))
import dataset  # noqa: E402

LIBRARY = next((pathlib.Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so*"))
CHANNELS = {"footprint": 7, "height": 5}
HALO, STRIDE = 48, 16


def session(name):
    return onnxruntime.InferenceSession(ROOT / "models" / f"{name}.onnx", providers=["CPUExecutionProvider"])


def run_whole(name, conditions, noise, first_south=0, first_east=0):
    """A network over whole maps: borders go on by a halo, the first cell keeps its place on the stride."""
    rows, cols = noise.shape
    before = [(first % STRIDE) + HALO for first in (first_south, first_east)]
    after = [-(b + n) % STRIDE + 2 * STRIDE + HALO // STRIDE * STRIDE for b, n in zip(before, (rows, cols))]
    pads = [(b, a) for b, a in zip(before, after)]
    conditions = np.pad(conditions, [(0, 0), *pads], mode="edge")[None].astype("float32")
    noise = np.pad(noise, pads, mode="edge")[None, None].astype("float32")
    heights = session(name).run(None, {"conditions": conditions, "noise": noise})[0][0, 0]
    # the network leaves its halo out
    down, right = (b - HALO for b in before)
    return heights[down : down + rows, right : right + cols]


@pytest.mark.parametrize("name", ["footprint", "height"])
@pytest.mark.parametrize("runtime", ["rten", str(LIBRARY)], ids=["rten", "ort"])
def test_runtimes_agree_with_onnxruntime(name, runtime, tmp_path):
    rng = np.random.default_rng(5)
    rows, cols = 150, 203
    conditions = ndimage.gaussian_filter(rng.normal(0, 2, (CHANNELS[name], rows, cols)), (0, 3, 3)).astype("float32")
    first = 3 if name == "footprint" else 1
    conditions[:first] = conditions[:first] > np.sort(conditions[:first], 0)[-1] - 1e-6 if first > 1 else conditions[:1] > 0
    noise = rng.uniform(-(3**0.5), 3**0.5, (rows, cols)).astype("float32")
    (tmp_path / "in").write_bytes(conditions.tobytes() + noise.tobytes())
    program = TARGET / "release" / "examples" / "run_network"
    done = subprocess.run([program, name, runtime, str(rows), str(cols), tmp_path / "in", tmp_path / "out"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ours = np.frombuffer((tmp_path / "out").read_bytes(), "float32").reshape(rows, cols)
    expected = run_whole(name, conditions, noise)
    assert expected.std() > 0.5
    assert np.abs(ours - expected).max() <= 1e-4 * max(1.0, expected.max())


def test_cards_tell_the_files_they_lie_beside():
    import hashlib

    for name in CHANNELS:
        card = tomllib.loads((ROOT / "models" / f"{name}.toml").read_text())
        data = (ROOT / "models" / f"{name}.onnx").read_bytes()
        assert card["sha256"] == hashlib.sha256(data).hexdigest()
        assert (card["halo_cells"], card["stride_cells"], card["opset"]) == (HALO, STRIDE, 17)
        assert card["receptive_field_radius_cells"] <= HALO
        assert card["data"] and all(d["licence"] for d in card["data"])


def philox_uniforms(process, south, east, seed):
    """The first of four uniforms of wildwood's keyed draws, per cell: Philox4x32-10 after its paper."""
    mask = np.uint64(0xFFFFFFFF)
    entity_low = (-south).astype(np.int64).astype(np.uint64) & mask
    entity_high = east.astype(np.int64).astype(np.uint64) & mask
    counter = [entity_low, entity_high, np.zeros_like(entity_low), np.full_like(entity_low, process)]
    key = [np.uint64(seed & 0xFFFFFFFF), np.uint64(seed >> 32)]
    for _ in range(10):
        a, b = counter[0] * np.uint64(0xD2511F53), counter[2] * np.uint64(0xCD9E8D57)
        shift = np.uint64(32)
        counter = [(b >> shift) ^ counter[1] ^ key[0], b & mask, (a >> shift) ^ counter[3] ^ key[1], a & mask]
        key = [(key[0] + np.uint64(0x9E3779B9)) & mask, (key[1] + np.uint64(0xBB67AE85)) & mask]
    return (counter[0] >> np.uint64(8)).astype(np.float64) / 2**24


def write(path, values, cell, north=5_200_000.0, nodata=None):
    transform = rasterio.transform.from_origin(500_000.0, north, cell, cell)
    with rasterio.open(path, "w", driver="GTiff", height=values.shape[0], width=values.shape[1], count=1, dtype=values.dtype, crs="EPSG:32633", transform=transform, nodata=nodata) as file:
        file.write(values, 1)
    return path


def grow(*arguments, expect=0):
    done = subprocess.run([str(a) for a in (WILDWOOD, "grow", *arguments, "--quiet", "--gpu", "off")], capture_output=True, text=True)
    assert done.returncode == expect, done.stderr
    return done.stderr


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Hills of 4 m cells with a sketch of three stripes and stands of 14 m, grown."""
    folder = tmp_path_factory.mktemp("learned")
    dem = write(folder / "dem.tif", hills(120, 150, 4.0), 4.0)
    sketch = np.repeat([0, 1, 2], 50).astype("uint8")[None].repeat(120, 0)
    write(folder / "sketch.tif", sketch, 4.0)
    write(folder / "stand.tif", np.full((120, 150), 14.0, "float32"), 4.0)
    grow(dem, "--sketch", folder / "sketch.tif", "--stand-height", folder / "stand.tif", "--onnx", "rten", "-o", folder / "forest", "--seed", "7")
    return folder


def test_the_footprint_is_that_of_an_independent_chain(scene):
    dem, sketch = hills(120, 150, 4.0), read(scene / "sketch.tif").filled(0)
    south = np.arange(120)[:, None] - 1_300_000 + np.zeros((1, 150), int)
    east = np.arange(150)[None] + 125_000 + np.zeros((120, 1), int)
    noise = (2 * philox_uniforms(98, south, east, 7) - 1) * 3**0.5
    stand = np.full((1, 120, 150), dataset.encode_height(np.float64(14.0)))
    terrain = dataset.terrain_channels(dem, np.ones(dem.shape, bool), 4.0)
    conditions = np.concatenate([dataset.one_hot(sketch), terrain, stand])
    heights = run_whole("footprint", conditions, noise, -1_300_000, 125_000)
    ours = read(scene / "forest" / "footprint.tif").filled(0) == 1
    # noise outside the map is drawn there, not its border's
    inner = np.s_[HALO : 120 - HALO, HALO : 150 - HALO]
    assert 0.1 < ours.mean() < 0.9
    assert ((heights > 3) == ours)[inner].mean() >= 0.999


def test_the_height_is_that_of_an_independent_chain(tmp_path):
    """Network, then the stand heights that were asked for: 8 m in the west, 30 m, beyond training, in the east."""
    rows, cols = 300, 330
    dem = write(tmp_path / "dem.tif", hills(rows, cols, 4.0), 4.0)
    rng = np.random.default_rng(3)
    footprint = ndimage.gaussian_filter(rng.normal(size=(rows, cols)), 1.5) > 0.05
    write(tmp_path / "footprint.tif", footprint.astype("uint8"), 4.0)
    stand = np.linspace(8, 30, cols, dtype="float32")[None].repeat(rows, 0)
    write(tmp_path / "stand.tif", stand, 4.0)
    grow(dem, "--footprint", tmp_path / "footprint.tif", "--stand-height", tmp_path / "stand.tif", "--onnx", "rten", "-o", tmp_path / "forest", "--seed", "7")
    south = np.arange(rows)[:, None] - 1_300_000 + np.zeros((1, cols), int)
    east = np.arange(cols)[None] + 125_000 + np.zeros((rows, 1), int)
    noise = (2 * philox_uniforms(99, south, east, 7) - 1) * 3**0.5
    terrain = dataset.terrain_channels(hills(rows, cols, 4.0), np.ones((rows, cols), bool), 4.0)
    encoded = dataset.encode_height(np.clip(stand, *dataset.TRAINED_M))[None]
    kept = read(tmp_path / "forest" / "footprint.tif").filled(0) == 1
    heights = run_whole("height", np.concatenate([kept[None], terrain, encoded]), noise, -1_300_000, 125_000)
    expected = dataset.at_stand_height(heights.astype(np.float64), kept, stand)
    ours = read(tmp_path / "forest" / "chm.tif").filled(0)
    # noise outside the map is drawn there, not its border's, and stands are blurred twice by three boxes
    rim = HALO + 2 * 3 * dataset.STAND_BOX_CELLS
    inner = np.s_[rim : rows - rim, rim : cols - rim]
    canopy = kept[inner]
    assert canopy.mean() > 0.2
    assert np.abs(ours - expected)[inner][canopy].max() < 0.02


def test_the_forest_obeys_the_sketch(scene):
    footprint = read(scene / "forest" / "footprint.tif").filled(0) == 1
    sketch = read(scene / "forest" / "sketch.tif").filled(0)
    assert np.array_equal(sketch, read(scene / "sketch.tif").filled(0))
    painted = ndimage.binary_dilation(sketch > 0, np.ones((3, 3)))
    assert not footprint[~painted].any()
    assert 0.08 < footprint[:, 55:95].mean() < 0.38
    assert footprint[:, 105:].mean() > 0.6
    chm = read(scene / "forest" / "chm.tif").filled(0)
    assert np.array_equal(chm > 3, footprint)
    # stands are as tall as asked, on the whole and from place to place
    assert abs(chm[footprint].mean() - 14) < 0.7
    around = dataset.box_blur(np.where(footprint, chm, 0), footprint, 12)
    assert np.abs(around[footprint] - 14).max() < 2.5


def test_the_footprint_can_be_edited_and_used_again(scene, tmp_path):
    shutil.copytree(scene / "forest", tmp_path / "forest")
    before = read(tmp_path / "forest" / "chm.tif").filled(0)
    again = ["--stand-height", scene / "stand.tif", "--onnx", "rten"]
    shutil.copy(tmp_path / "forest" / "footprint.tif", tmp_path / "mine.tif")
    grow(tmp_path / "forest", "--footprint", tmp_path / "mine.tif", *again)
    assert np.array_equal(read(tmp_path / "forest" / "chm.tif").filled(0), before)
    with rasterio.open(tmp_path / "mine.tif", "r+") as file:
        edited = file.read(1)
        edited[:40, :] = 0
        file.write(edited, 1)
    grow(tmp_path / "forest", "--footprint", tmp_path / "mine.tif", *again)
    after = read(tmp_path / "forest" / "chm.tif").filled(0)
    assert (after[:40] <= 3).all() and (after[60:] > 3).any()


def test_onnx_runtime_grows_nearly_the_same_and_is_recorded(scene, tmp_path):
    common = [scene / "dem.tif", "--sketch", scene / "sketch.tif", "--stand-height", scene / "stand.tif", "--seed", "7"]
    grow(*common, "--ort-lib", LIBRARY, "-o", tmp_path / "ort")
    a, b = (read(folder / "footprint.tif").filled(0) for folder in (scene / "forest", tmp_path / "ort"))
    assert (a == b).mean() >= 0.999
    figures = lambda folder: tomllib.loads((folder / "scene.toml").read_text())["stages"]["canopy"]["figures"]["learned"]
    assert figures(tmp_path / "ort")["runtime"] == "ONNX Runtime"
    assert figures(scene / "forest")["runtime"].startswith("rten")


def test_seeds_give_other_forests(scene, tmp_path):
    grow(scene / "dem.tif", "--density", "sparse", "--onnx", "rten", "--seed", "1", "-o", tmp_path / "a")
    grow(scene / "dem.tif", "--density", "sparse", "--onnx", "rten", "--seed", "2", "-o", tmp_path / "b")
    a, b = (read(tmp_path / name / "footprint.tif").filled(0) for name in "ab")
    assert (a != b).mean() > 0.05
    assert abs(a.mean() - b.mean()) < 0.04


def test_a_scene_folder_keeps_its_seed_and_stand_height_until_others_are_given(scene, tmp_path):
    grow(scene / "dem.tif", "--density", "sparse", "--stand-height", "24", "--onnx", "rten", "--seed", "2", "-o", tmp_path / "forest")
    manifest = lambda: tomllib.loads((tmp_path / "forest" / "scene.toml").read_text())
    chm = read(tmp_path / "forest" / "chm.tif").filled(0)
    assert abs(chm[chm > 3].mean() / 24 - 1) < 0.15
    grow(tmp_path / "forest", "--density", "dense", "--onnx", "rten")
    assert manifest()["scene"]["seed"] == 2
    assert manifest()["stages"]["canopy"]["parameters"]["learned"]["stand_height_m"] == 24
    before = read(tmp_path / "forest" / "footprint.tif").filled(0)
    grow(tmp_path / "forest", "--density", "dense", "--stand-height", "8", "--onnx", "rten", "--seed", "5")
    assert manifest()["scene"]["seed"] == 5
    assert manifest()["stages"]["canopy"]["parameters"]["learned"]["stand_height_m"] == 8
    assert (read(tmp_path / "forest" / "footprint.tif").filled(0) != before).any()
    assert "--sketch" in grow(tmp_path / "forest", "--seed", "6", expect=2)
    # neither other shares nor the same import again forget them
    grow(tmp_path / "forest", "--shares", "redwood=0.3")
    assert manifest()["stages"]["canopy"]["parameters"]["learned"]["stand_height_m"] == 8
    done = subprocess.run([WILDWOOD, "import", scene / "dem.tif", "-o", tmp_path / "forest", "--quiet"])
    assert done.returncode == 0
    assert manifest()["scene"]["seed"] == 5 and "canopy" in manifest()["stages"]


def test_crowns_are_drawn_at_the_terrains_cell(scene, tmp_path):
    """On cells of 1 m the canopy has crowns, and brought back to 4 m it is the network's."""
    dem = write(tmp_path / "dem.tif", hills(400, 400, 1.0), 1.0)
    grow(dem, "--density", "dense", "--onnx", "rten", "-o", tmp_path / "forest")
    chm = read(tmp_path / "forest" / "chm.tif").filled(0)
    footprint = read(tmp_path / "forest" / "footprint.tif").filled(0) == 1
    back = np.percentile(chm.reshape(100, 4, 100, 4).transpose(0, 2, 1, 3).reshape(100, 100, 16), 90, axis=2)
    assert ((back > 3) == footprint).mean() >= 0.97
    tops = (chm == ndimage.maximum_filter(chm, 3)) & (chm > 3)
    assert 100 < tops.sum() / 16 < 1200  # a hectare


def test_what_is_wrong_is_told_before_anything_is_written(scene, tmp_path):
    dem, out = scene / "dem.tif", tmp_path / "forest"
    picture = np.zeros((20, 20, 3), "uint8")
    picture[5:] = (10, 20, 240)
    Image.fromarray(picture).save(tmp_path / "blue.png")
    assert "#0a14f0 (300)" in grow(dem, "--sketch", tmp_path / "blue.png", "-o", out, expect=2)
    write(tmp_path / "codes.tif", np.full((120, 150), 5, "uint8"), 4.0)
    assert "unknown codes 5" in grow(dem, "--sketch", tmp_path / "codes.tif", "-o", out, expect=2)
    assert "no such file" in grow(dem, "--density", "dense", "--ort-lib", tmp_path / "none.so", "-o", out, expect=2)
    (tmp_path / "bad.so").write_bytes(b"not a library")
    assert "bad.so" in grow(dem, "--density", "dense", "--ort-lib", tmp_path / "bad.so", "-o", out, expect=2)
    shutil.copytree(ROOT / "models", tmp_path / "models")
    data = bytearray((tmp_path / "models" / "height.onnx").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "models" / "height.onnx").write_bytes(data)
    assert "damaged or altered" in grow(dem, "--density", "dense", "--models", tmp_path / "models", "-o", out, expect=2)
    (tmp_path / "models" / "height.onnx").unlink()
    assert "height.onnx" in grow(dem, "--density", "dense", "--models", tmp_path / "models", "-o", out, expect=2)
    assert "--sketch" in grow(dem, "-o", out, expect=2)
    assert "--stand-height" in grow(dem, "--density", "dense", "--stand-height", "900", "-o", out, expect=2)
    assert "neither" in grow(dem, "--density", "dense", "--stand-height", "tall", "-o", out, expect=2)
    assert "3.5" in grow(dem, "--density", "dense", "--stand-height", "-3", "-o", out, expect=2)
    Image.new("RGB", (20, 20)).save(tmp_path / "paint.jpg")
    assert "PNG" in grow(dem, "--sketch", tmp_path / "paint.jpg", "-o", out, expect=2)
    assert not out.exists()


def test_doctor_tells_of_the_networks():
    done = subprocess.run([WILDWOOD, "doctor", "--json"], capture_output=True, text=True)
    assert json.loads(done.stdout)["onnx"]["rten"].startswith("rten")


def test_real_terrain_under_a_sketch(tmp_path):
    grow(real("canopy_pairs/neon_harv_4m_dtm.tif"), "--density", "dense", "--onnx", "rten", "-o", tmp_path / "forest")
    footprint = read(tmp_path / "forest" / "footprint.tif")
    assert footprint.mean() > 0.7
