"""What `wildwood export` writes for GIS opens in GeoPandas, GDAL, SQLite and laspy as the scene's own tables."""

import json
import os
import shutil
import sqlite3
import subprocess

import geopandas
import laspy
import numpy as np
import pandas
import pyogrio
import pytest
import shapely

from conftest import WILDWOOD, canopy_pair, run_grow, write_tiff

TABLES = {"plants": "Point", "snags": "Point", "downed_logs": "LineString"}
CRS = "EPSG:32611"
# directions are radians inside: the last digit of degrees, and what it moves a thin end by
AZIMUTH_ERROR_DEG, END_ERROR_M = 7e-5, {"plants": 0.0, "snags": 0.0, "downed_logs": 5e-5}


def export(scene, output, *options):
    command = [WILDWOOD, "export", scene, "-o", output, "--quiet", *options]
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300)


def exported(scene, output, *options):
    done = export(scene, output, *options)
    assert done.returncode == 0 and not done.stderr, done.stderr
    return output


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A forest with undergrowth in its tables, aged by some years."""
    folder = tmp_path_factory.mktemp("exports")
    dem, canopy = canopy_pair()
    terrain = write_tiff(folder / "dtm.tif", dem, cell=1.0, crs=CRS)
    chm = write_tiff(folder / "chm.tif", canopy, cell=1.0, crs=CRS)
    grown = run_grow(terrain, chm, folder / "forest")
    command = [WILDWOOD, "age", grown, "--years", "25", "--quiet"]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return grown


@pytest.fixture(scope="module")
def tables(scene):
    read = {name: geopandas.read_parquet(scene / f"{name}.parquet") for name in TABLES}
    assert all(len(table) > 20 for table in read.values())
    return read


@pytest.fixture(scope="module")
def package(scene, tmp_path_factory):
    return exported(scene, tmp_path_factory.mktemp("gpkg") / "forest.gpkg", "--crowns")


def assert_same(found, expected, error=0.0):
    """The columns of a table; texts stand for single floats."""
    assert len(found) == len(expected)
    errors = {"azimuth_deg": max(error, AZIMUTH_ERROR_DEG)}
    for name in expected.columns.drop("geometry"):
        one, other = found[name].to_numpy(), expected[name].to_numpy()
        if other.dtype == np.float32:
            difference = np.abs(one.astype("float32") - other).max()
            assert difference <= errors.get(name, error), (name, difference)
        else:
            assert (one == other).all(), name


@pytest.mark.parametrize("name", TABLES)
def test_layers_are_the_scene_s_tables(package, tables, name):
    layer = geopandas.read_file(package, layer=name, engine="pyogrio")
    assert layer.crs == tables[name].crs and layer.crs.to_epsg() == 32611
    assert (layer.geometry.geom_type == TABLES[name]).all() and layer.geometry.has_z.all()
    flat = geopandas.GeoSeries(shapely.force_2d(layer.geometry.values), crs=CRS)
    assert flat.geom_equals_exact(tables[name].geometry, END_ERROR_M[name]).all()
    assert_same(layer, tables[name])
    assert layer["height_m" if name != "downed_logs" else "length_m"].dtype == np.float32


def test_points_stand_on_the_ground_and_lines_lie_on_it(package, tables):
    plants = geopandas.read_file(package, layer="plants", engine="pyogrio")
    assert (plants.geometry.z.to_numpy("float32") == tables["plants"]["z_m"]).all()
    logs = geopandas.read_file(package, layer="downed_logs", engine="pyogrio")
    ends = np.array([line.coords for line in logs.geometry])
    middle = ends[:, :, 2].mean(axis=1)
    # the ground of these hills is no straighter
    assert np.abs(middle - logs["z_m"]).max() < 2.0


def test_crowns_have_the_area_of_their_disks(package, tables):
    crowns = geopandas.read_file(package, layer="crowns", engine="pyogrio")
    plants = tables["plants"]
    assert (crowns["id"] == plants["id"]).all() and (crowns.geom_type == "Polygon").all()
    assert crowns.geometry.count_coordinates().eq(17).all()
    area = np.pi * plants["crown_radius_m"].astype("float64") ** 2
    assert np.abs(crowns.area - area).max() < 1e-6
    assert crowns.centroid.distance(plants.geometry).max() < 1e-6


def test_sqlite_finds_nothing_wrong(package):
    file = sqlite3.connect(package)
    assert file.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert file.execute("PRAGMA foreign_key_check").fetchall() == []
    assert file.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
    for name in [*TABLES, "crowns"]:
        assert file.execute(f"SELECT rtreecheck('rtree_{name}_geom')").fetchone() == ("ok",)


@pytest.mark.parametrize("name", [*TABLES, "crowns"])
def test_index_and_scan_agree(package, name):
    everything = geopandas.read_file(package, layer=name, engine="pyogrio")
    west, south, east, north = everything.total_bounds
    contents = sqlite3.connect(package).execute(
        "SELECT min_x, min_y, max_x, max_y FROM gpkg_contents WHERE table_name = ?", (name,)
    )
    assert contents.fetchone() == (west, south, east, north)
    for shares in [(0.2, 0.3, 0.6, 0.5), (0.0, 0.0, 0.05, 1.0), (0.5, 0.5, 0.5001, 0.5001)]:
        box = shapely.box(
            west + shares[0] * (east - west), south + shares[1] * (north - south),
            west + shares[2] * (east - west), south + shares[3] * (north - south),
        )
        found = geopandas.read_file(package, layer=name, engine="pyogrio", bbox=box.bounds)
        expected = everything[everything.intersects(box)]
        assert sorted(found["id"]) == sorted(expected["id"])


def test_an_edited_package_keeps_its_index(package, tmp_path):
    """GDAL edits through the triggers; what it adds is found by the index, and counted."""
    copy = shutil.copy(package, tmp_path / "copy.gpkg")
    plants = geopandas.read_file(copy, layer="plants", engine="pyogrio")
    moved = plants.iloc[:500].copy()
    moved["geometry"] = moved.geometry.translate(5000.0, 0.0)
    pyogrio.write_dataframe(moved, copy, layer="plants", append=True)
    bounds = tuple(moved.total_bounds)
    found = geopandas.read_file(copy, layer="plants", engine="pyogrio", bbox=bounds)
    assert sorted(found["id"]) == sorted(moved["id"])
    file = sqlite3.connect(copy)
    assert file.execute("SELECT rtreecheck('rtree_plants_geom')").fetchone() == ("ok",)
    counted = "SELECT feature_count FROM gpkg_ogr_contents WHERE table_name = 'plants'"
    assert file.execute(counted).fetchone() == (len(plants) + 500,)


def test_gdal_validates_the_package(package):
    ogrinfo = shutil.which("ogrinfo")
    if ogrinfo is None:
        pytest.skip("no ogrinfo")
    told = subprocess.run([ogrinfo, "-so", "-al", package], capture_output=True, text=True)
    assert told.returncode == 0 and not told.stderr.strip(), told.stderr
    assert "3D Point" in told.stdout and "WGS 84 / UTM zone 11N" in told.stdout
    checker = "from osgeo_utils.samples import validate_gpkg"
    python = shutil.which("python3", path="/usr/bin:/usr/local/bin")
    if python is None or subprocess.run([python, "-c", checker], capture_output=True).returncode:
        pytest.skip("no osgeo_utils: validated by ogrinfo alone")
    code = f"{checker}; validate_gpkg.check({str(package)!r}, abort_at_first_error=True)"
    told = subprocess.run([python, "-c", code], capture_output=True, text=True)
    assert told.returncode == 0, told.stdout + told.stderr


def test_equal_exports_are_equal_bytes(scene, package, tmp_path):
    again = exported(scene, tmp_path / "forest.gpkg", "--crowns", "--threads", "1")
    assert again.read_bytes() == package.read_bytes()


def test_tables_are_the_scene_s(scene, tables, tmp_path):
    folder = exported(scene, tmp_path / "tables", "--to", "parquet")
    texts = exported(scene, tmp_path / "texts", "--to", "csv")
    note = json.loads((texts / "export.json").read_text())
    assert note["format"] == "csv" and note["crs"] == CRS
    for name, table in tables.items():
        again = geopandas.read_parquet(folder / f"{name}.parquet")
        assert again.crs == table.crs and again.columns.equals(table.columns)
        assert again.geometry.geom_equals_exact(table.geometry, END_ERROR_M[name]).all()
        assert_same(again, table)
        text = pandas.read_csv(texts / f"{name}.csv")
        assert len(text) == len(table) == note["rows"][name]
        assert_same(text, table, error=6e-3)
    one = exported(scene, tmp_path / "snags.csv", "--layers", "snags")
    assert one.read_bytes() == (texts / "snags.csv").read_bytes()


def test_a_part_is_the_rows_within(scene, tables, tmp_path):
    west, south, east, north = bbox = (500030.0, 4099900.0, 500100.0, 4099960.0)
    box = ",".join(map(str, bbox))
    options = ["--bbox", box, "--layers", "canopy,snags", "--min-height", "3"]
    path = exported(scene, tmp_path / "part.gpkg", *options)
    assert {name for name, _ in pyogrio.list_layers(path)} == {"plants", "snags"}
    for name in ["plants", "snags"]:
        table = tables[name]
        x, y = table.geometry.x, table.geometry.y
        rows = (x >= west) & (x < east) & (y >= south) & (y < north) & (table["height_m"] >= 3)
        if name == "plants":
            rows &= table["layer"] == "canopy"
        found = geopandas.read_file(path, layer=name, engine="pyogrio")
        assert sorted(found["id"]) == sorted(table["id"][rows])
    # four boxes are the whole
    middle = [(west + east) / 2, (south + north) / 2]
    parts = []
    for w, e in [(west, middle[0]), (middle[0], east)]:
        for s, n in [(south, middle[1]), (middle[1], north)]:
            to = tmp_path / "quarter.parquet"
            exported(scene, to, "--bbox", f"{w},{s},{e},{n}", "--layers", "canopy,undergrowth")
            parts.extend(geopandas.read_parquet(to)["id"])
    whole = exported(scene, tmp_path / "w.parquet", "--bbox", box, "--layers", "canopy,undergrowth")
    assert sorted(parts) == sorted(geopandas.read_parquet(whole)["id"])


def test_geojson_is_the_tables_in_degrees(scene, tables, tmp_path):
    path = exported(scene, tmp_path / "forest.geojson")
    text = json.loads(path.read_text())
    assert text["type"] == "FeatureCollection" and "crs" not in text
    everything = geopandas.read_file(path, engine="pyogrio")
    assert everything.crs.to_epsg() == 4326
    for name, table in tables.items():
        found = everything[everything["table"] == name]
        assert_same(found, table)
        places = table.to_crs(4326).geometry.get_coordinates().to_numpy()
        assert np.abs(found.geometry.get_coordinates().to_numpy() - places).max() < 6e-8


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_a_cloud_has_a_point_a_plant(scene, tables, tmp_path, ending):
    cloud = laspy.read(exported(scene, tmp_path / f"trees.{ending}"))
    plants = tables["plants"]
    assert len(cloud.points) == len(plants) and cloud.header.parse_crs().to_epsg() == 32611
    order = np.argsort(np.asarray(cloud["id"]), kind="stable")
    assert (np.asarray(cloud["id"])[order] == plants["id"].sort_values()).all()
    plants = plants.sort_values("id")
    places = np.column_stack([cloud.x, cloud.y, cloud.z])[order]
    top = plants["z_m"].astype("float64") + plants["height_m"]
    expected = np.column_stack([plants.geometry.x, plants.geometry.y, top])
    assert np.abs(places - expected).max() < 1e-3
    for name in ["height_m", "crown_radius_m", "dbh_m"]:
        assert (np.asarray(cloud[name])[order] == plants[name].to_numpy()).all()
    note = next(v for v in cloud.header.vlrs if v.user_id == "wildwood").record_data_bytes().decode()
    numbers = dict(entry.split() for entry in note.split(";")[0].removeprefix("species: ").split(", "))
    species = [numbers[str(number)] for number in np.asarray(cloud["species"])[order]]
    assert species == plants["species"].tolist()
    assert ((np.asarray(cloud.user_data)[order] == 0) == (plants["layer"] == "canopy")).all()


def test_iland_reads_trees_of_four_metres(scene, tables, tmp_path):
    done = export(scene, tmp_path / "init.csv", "--to", "iland", "--layers", "canopy")
    assert done.returncode == 0, done.stderr
    trees = pandas.read_csv(tmp_path / "init.csv", comment="#")
    assert list(trees.columns) == ["id", "x", "y", "species", "dbh", "height", "age"]
    plants = tables["plants"]
    plants = plants[(plants["layer"] == "canopy") & (plants["height_m"] >= 4)].sort_values("id")
    assert 0 < len(trees) <= len(plants) and trees["species"].str.fullmatch("[a-z]{4}").all()
    assert trees["height"].min() >= 4 and trees["dbh"].max() > 5
    assert trees["x"].between(0, 160).all() and trees["y"].between(0, 120).all()
    if len(trees) == len(plants):
        assert np.abs(trees["x"].to_numpy() - (plants.geometry.x - 500000.0)).max() < 1e-3
        assert np.abs(trees["dbh"].to_numpy() - 100 * plants["dbh_m"]).max() < 6e-3


def test_ecoviz_s_list_counts_its_trees(scene, tables, tmp_path):
    lines = exported(scene, tmp_path / "forest.pdb").read_text().splitlines()
    assert lines[:3] == ["3.0", "500000 4099880", "25"]
    count = int(lines[3])
    assert count == len(tables["plants"]) + len(tables["snags"])
    assert lines[4 + count:] == ["0"]
    rows = [line.split(" ") for line in lines[4 : 4 + count]]
    assert {len(row) for row in rows} == {8}
    assert sum(row[7] == "1" for row in rows) == len(tables["snags"])


def bad_inputs(scene, folder):
    """Options that cannot be, and what is said of them."""
    (folder / "note.txt").write_text("mine")
    (folder / "mine").mkdir()
    (folder / "mine" / "a.txt").write_text("mine")
    (folder / "empty").mkdir()
    os.mkfifo(folder / "pipe")
    new = folder / "new.gpkg"
    return {
        "unknown format": (scene, folder / "a.b", ["--to", "shp"], "shp"),
        "no format": (scene, folder / "a.b", [], "--to"),
        "unknown layer": (scene, new, ["--layers", "trees"], "no such layer"),
        "layer the format lacks": (scene, folder / "a.las", ["--layers", "logs"], "holds none"),
        "box outside": (scene, new, ["--bbox", "0,0,10,10"], "outside the scene"),
        "box upside down": (scene, new, ["--bbox", "10,0,0,10"], "west must be less"),
        "box of three": (scene, new, ["--bbox", "10,0,0"], "four numbers"),
        "nothing so high": (scene, new, ["--layers", "canopy", "--min-height", "200"], "nothing is selected"),
        "height below zero": (scene, new, ["--min-height", "-1"], "0 to 1000"),
        "height of words": (scene, new, ["--min-height", "high"], "0 to 1000"),
        "no such scene": (folder / "nowhere", new, [], "no scene"),
        "folder of others": (folder / "mine", new, [], "not a scene"),
        "empty folder": (folder / "empty", new, [], "no scene"),
        "output is a text": (scene, folder / "note.txt", ["--to", "gpkg"], "is no gpkg"),
        "output is a folder": (scene, folder / "mine", ["--to", "gpkg"], "is a folder"),
        "output folder of others": (scene, folder / "mine", ["--to", "csv"], "is no export"),
        "output folder missing": (scene, folder / "no" / "a.gpkg", [], "does not exist"),
        "output folder is a file": (scene, folder / "note.txt" / "a.gpkg", [], "does not exist"),
        "output is the scene": (scene, scene, ["--to", "csv"], "the scene itself"),
        "output is the scene's table": (scene, scene / "plants.parquet", [], "the scene itself"),
        "crowns without plants": (scene, new, ["--crowns", "--layers", "snags"], "needs plants"),
        "crowns in a table": (scene, folder / "a.las", ["--crowns"], "is for gpkg"),
        "output is a pipe": (scene, folder / "pipe", ["--to", "gpkg"], "no regular file"),
        "output is another text": (scene, folder / "note.txt", ["--to", "iland"], "is no iland"),
        "two tables in a file": (scene, folder / "a.csv", [], "holds one table"),
    }


@pytest.mark.parametrize("case", range(25))
def test_bad_input_is_told_and_leaves_nothing(scene, tmp_path, case):
    name, (of, output, options, word) = list(bad_inputs(scene, tmp_path).items())[case]
    before = {path: path.stat().st_mtime_ns for path in [*tmp_path.rglob("*"), *scene.rglob("*")]}
    done = export(of, output, *options)
    assert done.returncode == 2, (name, done.stderr)
    assert word in done.stderr and "panicked" not in done.stderr, (name, done.stderr)
    after = {path: path.stat().st_mtime_ns for path in [*tmp_path.rglob("*"), *scene.rglob("*")]}
    assert after == before, name


def test_bad_input_has_one_message(scene, tmp_path):
    done = export(scene, tmp_path / "a.gpkg", "--bbox", "0,0,10,10")
    assert len(done.stderr.strip().splitlines()) == 1 and done.stderr.startswith("error: ")


def test_too_many_rows_for_geojson(scene, tables, tmp_path):
    """The limit is told before anything is written; a scene beyond it is made of copies of one table."""
    big = tmp_path / "big"
    shutil.copytree(scene, big)
    plants = tables["plants"]
    copies = pandas.concat([plants] * (200_000 // len(plants) + 1), ignore_index=True)
    copies["id"] = np.arange(len(copies))
    geopandas.GeoDataFrame(copies, crs=plants.crs).to_parquet(
        big / "plants.parquet", compression="zstd", use_dictionary=False
    )
    done = export(big, tmp_path / "a.geojson")
    assert done.returncode == 2 and "200000" in done.stderr, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["big"]
    exported(big, tmp_path / "a.gpkg")
    assert pyogrio.read_info(tmp_path / "a.gpkg", layer="plants")["features"] == len(copies)
