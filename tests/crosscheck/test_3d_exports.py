"""3D programs read exported scenes: every row of the tables stands where, and as large as, the table says."""

import functools
import json
import pathlib
import shutil
import struct
import subprocess

import geopandas
import numpy as np
import pandas
import pyproj
import pytest

from conftest import WILDWOOD, canopy_pair, run_grow, scene_head, write_tiff

NODE = pathlib.Path(__file__).with_name("node")
SYSTEM = "EPSG:32611"
TABLES = {"Plants": "plants", "Snags": "snags", "DownedLogs": "downed_logs"}
STORM = """
[[event]]
type = "wind-storm"
year = 9
speed_m_s = 32
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A small aged forest with snags and downed logs."""
    if subprocess.run([WILDWOOD, "export", "--help"], capture_output=True).returncode != 0:
        pytest.skip("this wildwood has no command `export`")
    home = tmp_path_factory.mktemp("forest")
    terrain, canopy = canopy_pair()
    place = dict(cell=1.0, crs=SYSTEM, west=256000.0, north=4110000.0)
    terrain = write_tiff(home / "terrain.tif", terrain, **place)
    canopy = write_tiff(home / "chm.tif", canopy, **place)
    folder = run_grow(terrain, canopy, home / "scene")
    (home / "events.toml").write_text(STORM, encoding="utf-8")
    command = [WILDWOOD, "age", folder, "--years", 12, "--events", home / "events.toml", "--quiet"]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def tables(scene):
    """The scene's tables, in the order of ids, with map coordinates."""
    found = {}
    for name, file in TABLES.items():
        table = geopandas.read_parquet(scene / f"{file}.parquet")
        points = table.geometry
        if name == "DownedLogs":
            points = points.apply(lambda line: line.interpolate(0))
        table["x"], table["y"] = points.x, points.y
        found[name] = table.set_index("id", drop=False)
    assert all(len(table) > 5 for table in found.values())
    return found


def export(scene, output, form, *options):
    command = [WILDWOOD, "export", scene, "--to", form, "-o", output, "--quiet", *options]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return output


def turned(quaternions, vector):
    """A vector turned by unit quaternions x, y, z, w."""
    xyz, w = quaternions[:, :3], quaternions[:, 3:]
    vector = np.broadcast_to(vector, xyz.shape)
    return vector + 2 * np.cross(xyz, np.cross(xyz, vector) + w * vector)


def assert_features(name, table, ids, places, turns, scales):
    """Instances of a table, in map coordinates, are its rows."""
    assert len(ids) == len(table) and set(ids) == set(table["id"])
    rows = table.loc[ids]
    assert np.abs(np.linalg.norm(turns, axis=1) - 1).max() < 2e-3
    off = np.hypot(places[:, 0] - rows["x"], places[:, 1] - rows["y"])
    assert off.max() < 2e-3, off.max()
    if name == "DownedLogs":
        azimuth = np.radians(rows["azimuth_deg"].to_numpy())
        along = turned(turns, [1.0, 0.0, 0.0])
        level = along[:, :2] / np.linalg.norm(along[:, :2], axis=1)[:, None]
        assert np.abs(level[:, 0] - np.sin(azimuth)).max() < 3e-3
        assert np.abs(level[:, 1] - np.cos(azimuth)).max() < 3e-3
        # as long along the map as the table says, whatever the slope
        length = scales[:, 0] * np.linalg.norm(along[:, :2], axis=1)
        assert np.abs(length / rows["length_m"] - 1).max() < 0.02
    else:
        assert np.abs(places[:, 2] - rows["z_m"]).max() < 2e-3
        assert np.abs(scales[:, 2] / rows["height_m"] - 1).max() < 2e-2
        up = turned(turns, [0.0, 0.0, 1.0])
        assert up[:, 2].min() > 0.9
    if name == "Plants":
        assert np.abs(scales[:, 0] - rows["crown_radius_m"]).max() < 2e-3


# OpenUSD


def usd_instancers(stage, table):
    from pxr import Usd, UsdGeom

    root = stage.GetPrimAtPath(f"/Forest/{table}")
    return [UsdGeom.PointInstancer(p) for p in Usd.PrimRange(root) if p.IsA(UsdGeom.PointInstancer)]


@pytest.mark.parametrize("origin", ["local", "map"])
def test_usd_holds_the_tables(scene, tables, tmp_path, origin):
    from pxr import Gf, Usd, UsdGeom

    path = export(scene, tmp_path / "forest.usda", "usd", "--origin", origin)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    root = stage.GetDefaultPrim()
    assert root.GetPath() == "/Forest"
    layer = stage.GetRootLayer().customLayerData["wildwood"]
    assert layer["crs"] == SYSTEM
    translate = UsdGeom.Xformable(root).GetLocalTransformation().ExtractTranslation()
    assert translate == (Gf.Vec3d(layer["origin"]) if origin == "map" else Gf.Vec3d(0))
    for name, table in tables.items():
        ids, places, turns, scales = [], [], [], []
        for instancer in usd_instancers(stage, name):
            count = len(instancer.GetIdsAttr().Get())
            assert instancer.GetInstanceCount() == count
            assert len(instancer.GetPrototypesRel().GetForwardedTargets()) == 1
            ids.extend(instancer.GetIdsAttr().Get())
            places.extend(instancer.GetPositionsAttr().Get())
            half = instancer.GetOrientationsAttr().Get()
            turns.extend([[*q.GetImaginary(), q.GetReal()] for q in half])
            scales.extend(instancer.GetScalesAttr().Get())
            primvars = UsdGeom.PrimvarsAPI(instancer)
            for primvar in primvars.GetPrimvars():
                if primvar.GetInterpolation() == "vertex":
                    assert len(primvar.Get()) == count
            size = "length_m" if name == "DownedLogs" else "height_m"
            sizes = np.array(primvars.GetPrimvar(size).Get())
            own = list(instancer.GetIdsAttr().Get())
            assert np.abs(sizes - table.loc[own, size]).max() < 1e-3
            assert set(table.loc[own, "species"]) == {primvars.GetPrimvar("species").Get()}
        map_places = np.array(places, "float64") + layer["origin"]
        assert_features(name, table, ids, map_places, np.array(turns, "float64"), np.array(scales))


def test_usd_is_sound(scene, tmp_path):
    from pxr import Usd, UsdGeom, UsdShade, UsdValidation

    path = export(scene, tmp_path / "forest.usda", "usd", "--lod", "near")
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    # a text is told to be no package, which it does not claim to be
    said = [f"{e.GetName()}: {e.GetMessage()}" for e in errors if "usdz" not in e.GetMessage().lower()]
    assert not said, said[:5]
    meshes = 0
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            counts, indices = mesh.GetFaceVertexCountsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()
            points = mesh.GetPointsAttr().Get()
            valid, why = UsdGeom.Mesh.ValidateTopology(indices, counts, len(points))
            assert valid, why
            assert len(mesh.GetNormalsAttr().Get()) == len(points)
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            assert material and material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"
            meshes += 1
    assert meshes > 10


def test_usd_levels_are_variants(scene, tmp_path):
    from pxr import Usd, UsdGeom

    path = export(scene, tmp_path / "forest.usda", "usd", "--lod", "middle")
    stage = Usd.Stage.Open(str(path))
    variants = stage.GetPrimAtPath("/Forest").GetVariantSets().GetVariantSet("lod")
    assert variants.GetVariantSelection() == "middle" and set(variants.GetVariantNames()) == {"near", "middle", "far"}
    faces = {}
    for level in variants.GetVariantNames():
        variants.SetVariantSelection(level)
        faces[level] = 0
        for instancer in usd_instancers(stage, "Plants"):
            target = instancer.GetPrototypesRel().GetForwardedTargets()[0]
            assert target.name == level
            for prim in Usd.PrimRange(stage.GetPrimAtPath(target)):
                if prim.IsA(UsdGeom.Mesh):
                    faces[level] += len(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get())
    assert faces["near"] > faces["middle"] > faces["far"] > 0


# glTF


def node_run(script, *arguments):
    if shutil.which("node") is None or not (NODE / "node_modules").is_dir():
        pytest.skip("no node, or its packages are not installed: see test.sh")
    command = ["node", NODE / script, *arguments]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def node_check(*files):
    reports = node_run("check_gltf.mjs", *files)
    for report in reports:
        assert report["errors"] == 0 and report["warnings"] == 0, report["messages"]
    return reports


class Glb:
    """A binary glTF by its specification."""

    def __init__(self, path):
        data = pathlib.Path(path).read_bytes()
        magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
        assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
        self.json = json.loads(data[20 : 20 + size])
        self.bin = data[28 + size :]

    def view(self, index, dtype):
        view = self.json["bufferViews"][index]
        assert view["buffer"] == 0
        return np.frombuffer(self.bin, dtype, view["byteLength"] // np.dtype(dtype).itemsize, view["byteOffset"])

    def floats(self, accessor):
        accessor = self.json["accessors"][accessor]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        values = self.view(accessor["bufferView"], "<f4")
        return values.reshape(-1, width).astype("float64")

    def features(self):
        """Per table: ids, places, turns, scales of all instances, z up."""
        metadata = self.json["extensions"]["EXT_structural_metadata"]
        found = {}
        for node in self.json["nodes"]:
            if "extensions" not in node:
                continue
            instancing = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
            feature = node["extensions"]["EXT_instance_features"]["featureIds"][0]
            table = metadata["propertyTables"][feature["propertyTable"]]
            rows = self.floats(instancing["_FEATURE_ID_0"])[:, 0].astype(int)
            ids = self.view(table["properties"]["id"]["values"], "<u8")
            assert len(ids) == table["count"]
            columns = [ids[rows]] + [self.floats(instancing[k]) for k in ("TRANSLATION", "ROTATION", "SCALE")]
            found.setdefault(table["name"], []).append(columns)
        return {name: [np.concatenate(c) for c in zip(*all_)] for name, all_ in found.items()}

    def words(self, table, name):
        """A column of words of a property table, by the schema's enums."""
        metadata = self.json["extensions"]["EXT_structural_metadata"]
        table = next(t for t in metadata["propertyTables"] if t["name"] == table)
        definition = metadata["schema"]["classes"][table["class"]]["properties"][name]
        enum = metadata["schema"]["enums"][definition["enumType"]]
        dtype = {"UINT8": "u1", "UINT16": "<u2"}[enum["valueType"]]
        names = {value["value"]: value["name"] for value in enum["values"]}
        return [names[v] for v in self.view(table["properties"][name]["values"], dtype)]


@pytest.mark.parametrize("level", ["near", "middle", "far"])
def test_glb_is_valid_and_holds_the_tables(scene, tables, tmp_path, level):
    path = export(scene, tmp_path / "forest.glb", "glb", "--lod", level)
    glb = Glb(path)
    origin = glb.json["asset"]["extras"]["origin"]
    features = glb.features()
    for name, table in tables.items():
        ids, places, turns, scales = features[name]
        assert_features(name, table, ids, places + origin, turns, scales)
        rows = glb.view(next(
            t["properties"]["id"]["values"]
            for t in glb.json["extensions"]["EXT_structural_metadata"]["propertyTables"] if t["name"] == name
        ), "<u8")
        assert glb.words(name, "species") == list(table.loc[rows, "species"])
    (report,) = node_check(path)
    assert report["instances"] == sum(map(len, tables.values()))
    assert all(group["triangles"] > 0 for group in report["groups"])


def test_glb_stands_on_the_map_if_asked(scene, tables, tmp_path):
    glb = Glb(export(scene, tmp_path / "forest.glb", "glb", "--origin", "map"))
    root = glb.json["nodes"][glb.json["scenes"][0]["nodes"][0]]
    matrix = np.array(root["matrix"]).reshape(4, 4).T
    ids, places, _, _ = glb.features()["Plants"]
    world = (matrix @ np.c_[places, np.ones(len(places))].T).T
    rows = tables["Plants"].loc[ids]
    # y up: north is −z
    assert np.abs(world[:, 0] - rows["x"]).max() < 2e-3
    assert np.abs(-world[:, 2] - rows["y"]).max() < 2e-3
    assert np.abs(world[:, 1] - rows["z_m"]).max() < 2e-3


# 3D Tiles


def walk(tile, matrix, parent_error):
    """Every tile below, with its matrix to geocentric metres."""
    matrix = matrix @ np.array(tile.get("transform", np.eye(4).ravel())).reshape(4, 4).T
    assert tile["geometricError"] < parent_error
    yield tile, matrix
    for child in tile.get("children", []):
        yield from walk(child, matrix, tile["geometricError"])


def test_tiles_place_every_row_on_the_globe(scene, tables, tmp_path):
    folder = export(scene, tmp_path / "tiles", "3dtiles")
    tileset = json.loads((folder / "tileset.json").read_text(encoding="utf-8"))
    assert tileset["asset"]["version"] == "1.1"
    to_globe = pyproj.Transformer.from_crs(SYSTEM, "EPSG:4326", always_xy=True)
    geocentric = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    seen = {name: [] for name in tables}
    y_to_z = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    tiles = list(walk(tileset["root"], np.eye(4), tileset["geometricError"]))
    depths = {}
    for tile, matrix in tiles:
        if tile.get("content", {}).get("uri", "terrain.glb") == "terrain.glb":
            continue
        glb = Glb(folder / tile["content"]["uri"])
        root = np.array(glb.json["nodes"][glb.json["scenes"][0]["nodes"][0]]["matrix"]).reshape(4, 4).T
        box = np.array(tile["boundingVolume"]["box"])
        half = np.abs(box[3:]).reshape(3, 3).sum(axis=0)
        for name, (ids, places, _, scales) in glb.features().items():
            local = y_to_z @ root @ np.c_[places, np.ones(len(places))].T
            # the foot and, upright, the top of all that stands lie in the tile's box
            for lift in [0.0] if name == "DownedLogs" else [0.0, scales[:, 2]]:
                point = local[:3].T + np.c_[np.zeros((len(ids), 2)), np.broadcast_to(lift, len(ids))]
                assert (np.abs(point - box[:3]) <= half + 0.05).all()
            found = (matrix @ local)[:3].T
            rows = tables[name].loc[ids]
            longitude, latitude = to_globe.transform(rows["x"], rows["y"])
            if name != "DownedLogs":
                expected = np.c_[geocentric.transform(longitude, latitude, rows["z_m"])]
                assert np.linalg.norm(found - expected, axis=1).max() < 0.01
            if "children" not in tile:
                seen[name].extend(ids)
    for name, table in tables.items():
        assert sorted(seen[name]) == sorted(table["id"]), "leaves hold every row once"
    files = sorted(folder.glob("tiles/*.glb"))
    assert len(files) == sum("content" in tile for tile, _ in tiles) - 1
    assert {file.name[0] for file in files} == {"0", "1", "2"}
    node_check(folder / "terrain.glb", *files)


def test_tiles_are_walked_by_cesiums_tools(scene, tables, tmp_path):
    folder = export(scene, tmp_path / "tiles", "3dtiles")
    [counts] = node_run("count_tiles.mjs", folder / "tileset.json")
    assert counts["instances"] == sum(len(table) for table in tables.values())
    assert counts["levels"] > 2 and counts["contents"] == counts["tiles"]


def test_a_click_in_cesium_tells_what_a_tree_is(scene, tables, tmp_path):
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no chromium: see test.sh")
    folder = export(scene, tmp_path / "tiles", "3dtiles", "--layers", "canopy")
    plants = tables["Plants"]
    canopy = plants[plants["layer"] == "canopy"]
    trees = canopy.nlargest(len(canopy) // 2, "height_m").sample(2, random_state=1)
    # a click on its top from above meets its own crown: half the trees are lower
    longitude, latitude = pyproj.Transformer.from_crs(SYSTEM, "EPSG:4326", always_xy=True).transform(trees["x"], trees["y"])
    tops = trees["z_m"] + trees["height_m"]
    places = [dict(longitude=o, latitude=a, height_m=h) for o, a, h in zip(longitude, latitude, tops)]
    (tmp_path / "places.json").write_text(json.dumps(places), encoding="utf-8")
    [seen] = node_run("click_tiles.mjs", chromium, folder, tmp_path / "places.json", tmp_path / "forest.png")
    assert seen["problems"] == []
    for (_, tree), click in zip(trees.iterrows(), seen["clicks"], strict=True):
        assert click is not None, "the click met no tree"
        assert (click["id"], click["species"], click["layer"]) == (tree["id"], tree["species"], "canopy")
        for name in ("height_m", "crown_radius_m", "age_years", "dbh_m", "vigor"):
            assert click[name] == pytest.approx(tree[name], rel=2e-3, abs=1e-3), name


def test_tiles_ground_follows_the_globe(scene, tmp_path):
    folder = export(scene, tmp_path / "tiles", "3dtiles")
    tileset = json.loads((folder / "tileset.json").read_text(encoding="utf-8"))
    matrix = np.array(tileset["root"]["transform"]).reshape(4, 4).T
    glb = Glb(folder / "terrain.glb")
    mesh = glb.json["meshes"][0]["primitives"][0]
    view = glb.json["accessors"][mesh["attributes"]["POSITION"]]["bufferView"]
    points = glb.view(view, "<f4").reshape(-1, 3).astype("float64")
    world = (matrix @ np.c_[points, np.ones(len(points))].T)[:3]
    back = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*world)
    x, y = pyproj.Transformer.from_crs("EPSG:4326", SYSTEM, always_xy=True).transform(back[0], back[1])
    (west, south), (width, height) = scene_head(scene)["south_west_m"], scene_head(scene)["extent_m"]
    assert abs(x.min() - west) < 0.01 and abs(x.max() - west - width) < 0.01
    assert abs(y.min() - south) < 0.01 and abs(y.max() - south - height) < 0.01


# Mitsuba


def test_mitsuba_renders_the_scene(scene, tables, tmp_path):
    mitsuba = pytest.importorskip("mitsuba")
    middle = np.array([tables["Plants"]["x"].median(), tables["Plants"]["y"].median()])
    box = ",".join(map(str, np.concatenate([middle - 30, middle + 30])))
    folder = export(scene, tmp_path / "render", "mitsuba", f"--bbox={box}", "--lod", "far")
    mitsuba.set_variant("scalar_rgb")
    forest = mitsuba.load_file(str(folder / "scene.xml"), spp=8, width=64, height=64)
    expected = json.loads((folder / "export.json").read_text())["rows"]
    instances = [s for s in forest.shapes() if "instance" in str(type(s)).lower() or "Instance" in str(s)]
    assert len(instances) == sum(expected.values())
    picture = np.array(mitsuba.render(forest))
    assert picture.shape[:2] == (64, 64) and np.isfinite(picture).all()
    assert 0.03 < picture.mean() < 1.0 and picture.std() > 0.03


# Lists of points


@functools.cache
def axes_of(flavour):
    """From east, north, up to the flavour's axes, in its unit."""
    return {
        "houdini": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
        "unity": np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]]),
        "unreal": 100.0 * np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1]]),
    }[flavour]


@pytest.mark.parametrize("flavour", ["houdini", "unity", "unreal"])
def test_points_are_the_tables_in_the_axes_of_their_flavour(scene, tables, tmp_path, flavour):
    folder = export(scene, tmp_path / "points", "points", "--flavour", flavour)
    points = pandas.read_csv(folder / "points.csv")
    record = json.loads((folder / "points.json").read_text(encoding="utf-8"))
    assert record["flavour"] == flavour and record["crs"] == SYSTEM
    same = pandas.DataFrame(record["points"])
    assert list(same.columns) == list(points.columns)
    pandas.testing.assert_frame_equal(points, same, check_dtype=False)
    axes = axes_of(flavour)
    unit = np.abs(axes).max()
    turn = axes / unit
    for name, table in tables.items():
        own = points[points["table"] == TABLES[name]]
        places = own[["x", "y", "z"]].to_numpy() @ np.linalg.inv(axes).T + record["origin"]
        # an axis of rotation changes its sign where handedness does
        sign = np.linalg.det(turn)
        xyz = sign * own[["qx", "qy", "qz"]].to_numpy() @ turn
        turns = np.c_[xyz, own["qw"]]
        scales = np.abs(own[["sx", "sy", "sz"]].to_numpy() @ np.abs(turn))
        assert_features(name, table, own["id"].to_numpy(), places, turns, scales)
        assert list(table.loc[own["id"], "species"]) == list(own["species"])
    models = pandas.read_csv(folder / "models.csv")
    assert set(models["mesh"]) == set(points["mesh"])
    assert models["instances"].sum() == len(points)
