"""The table of plants opens in GeoPandas and pyarrow as what it claims to be."""

import json
import subprocess
import tomllib

import geopandas
import numpy as np
import pandas
import pyarrow.parquet
import pyproj
import pytest
import rasterio
from scipy import spatial

from conftest import TARGET, canopy_pair, run_grow, scene_head, write_tiff

MEASURES = ["z_m", "height_m", "crown_radius_m", "dbh_m", "age_years", "vigor"]
COLUMNS = ["id", "species", "layer", "geometry", *MEASURES]
CSV_COLUMNS = ["id", "species", "layer", "x", "y", *MEASURES]
# half of the last digit that texts show, and what binary fractions add to it
CSV_ERROR = {"x": 6e-5, "y": 6e-5, "dbh_m": 6e-5, "vigor": 6e-5, "age_years": 6e-3}
SYSTEMS = [
    "EPSG:32611", "EPSG:32618", "EPSG:3005", "EPSG:2949", "EPSG:32617", "EPSG:3794", "EPSG:32633",
    "EPSG:2154", "EPSG:25831", "EPSG:3857", "EPSG:5070", "EPSG:2056", "EPSG:28992", "EPSG:27700",
    "EPSG:31466", "EPSG:3035", "EPSG:27572", "EPSG:2193",
]
# the registry's newest edition gives them another datum's name, or PROJ's own names have to do
NAMED_OTHERWISE = ["EPSG:2180", "EPSG:5514", "EPSG:3413"]
PROJ_STRINGS = [
    "+proj=tmerc +lat_0=46 +lon_0=11.5 +k=0.9999 +x_0=1000 +y_0=2000 +datum=WGS84 +units=m",
    "+proj=laea +lat_0=46.5 +lon_0=11.5 +ellps=GRS80 +units=m",
    "+proj=lcc +lat_0=40 +lat_1=41 +lat_2=47 +lon_0=9 +ellps=GRS80",
    "+proj=eqc +lat_ts=40 +lon_0=10 +datum=WGS84",
]


def equal_tables(plants, text):
    """GeoParquet and CSV hold the same plants."""
    assert list(plants.columns) == COLUMNS and list(text.columns) == CSV_COLUMNS
    assert len(plants) == len(text)
    for name in ("id", "species", "layer"):
        assert (plants[name] == text[name]).all(), name
    values = {"x": plants.geometry.x, "y": plants.geometry.y, **{m: plants[m] for m in MEASURES}}
    for name, found in values.items():
        difference = np.abs(found.to_numpy("float64") - text[name].to_numpy())
        # single floats of elevations have steps of a tenth of a millimetre
        assert difference.max() <= CSV_ERROR.get(name, 6e-4), name


def assert_contract(path):
    """Types, metadata and geometry of a table of plants; gives it as GeoPandas reads it."""
    schema = pyarrow.parquet.read_schema(path)
    types = [str(schema.field(name).type) for name in COLUMNS]
    assert types == ["int64", "string", "string", "binary"] + ["float"] * 6
    assert not any(schema.field(name).nullable for name in COLUMNS)
    parquet = pyarrow.parquet.ParquetFile(path)
    groups = parquet.metadata
    assert "RLE_DICTIONARY" in groups.row_group(0).column(1).encodings
    geo = json.loads(schema.metadata[b"geo"])
    assert geo["version"] == "1.1.0" and geo["primary_column"] == "geometry"
    column = geo["columns"]["geometry"]
    assert column["encoding"] == "WKB" and column["geometry_types"] == ["Point"]
    plants = geopandas.read_parquet(path)
    assert (plants.geometry.geom_type == "Point").all() and not plants.geometry.has_z.any()
    assert np.array_equal(plants.total_bounds, column["bbox"])
    assert plants["id"].is_monotonic_increasing and plants["id"].is_unique
    assert [str(plants[name].dtype) for name in MEASURES] == ["float32"] * 6
    return plants


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Tables in many systems, written by the example program."""
    program = TARGET / "debug" / "examples" / "plants_table"
    if not program.exists():
        pytest.skip("no program plants_table: cargo build --example plants_table")
    folder = tmp_path_factory.mktemp("tables")
    systems = [*SYSTEMS, *NAMED_OTHERWISE, *PROJ_STRINGS, "local"]
    done = subprocess.run([program, folder, *systems], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {system: folder / f"{index}.parquet" for index, system in enumerate(systems)}


@pytest.mark.parametrize("system", SYSTEMS)
def test_registered_systems_are_the_registrys(tables, system):
    crs = assert_contract(tables[system]).crs
    assert crs == pyproj.CRS.from_user_input(system)
    assert crs.to_string() == system


@pytest.mark.parametrize("system", NAMED_OTHERWISE + PROJ_STRINGS)
def test_other_systems_project_alike(tables, system):
    """The same place has the same coordinates, whatever the parts are called."""
    crs, expected = geopandas.read_parquet(tables[system]).crs, pyproj.CRS.from_user_input(system)
    area = expected.area_of_use
    longitude, latitude = (11.0, 45.0) if area is None else (
        0.5 * (area.west + area.east), 0.5 * (area.south + area.north))
    places = [
        pyproj.Transformer.from_crs(c.geodetic_crs, c, always_xy=True).transform(longitude, latitude)
        for c in (crs, expected)
    ]
    assert np.allclose(places[0], places[1], rtol=0, atol=1e-4), places
    if area is not None:
        assert f"EPSG:{crs.to_json_dict()['id']['code']}" == system


def test_local_metres_have_no_system(tables):
    assert assert_contract(tables["local"]).crs is None


def test_both_formats_hold_the_same(tables):
    for path in tables.values():
        plants = assert_contract(path)
        equal_tables(plants, pandas.read_csv(path.with_suffix(".csv")))
        assert len(plants) == 1000
        assert np.array_equal(plants.total_bounds[:2], [500000.5 + float(np.float32(0.3)), 4100060.25])


def test_other_formats_take_the_table(tables, tmp_path):
    """What GDAL's own drivers write of it, as QGIS does, reads back equal."""
    plants = geopandas.read_parquet(tables["EPSG:32611"])
    plants.to_file(tmp_path / "plants.gpkg", engine="pyogrio")
    again = geopandas.read_file(tmp_path / "plants.gpkg", engine="pyogrio")
    assert again.crs == plants.crs and again.geometry.geom_equals(plants.geometry).all()
    assert (again["id"] == plants["id"]).all() and (again["species"] == plants["species"]).all()


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    home = tmp_path_factory.mktemp("pair")
    ground, canopy = canopy_pair()
    return [
        write_tiff(home / f"{name}.tif", values, cell=1.0, nodata=-9999.0)
        for name, values in (("dtm", ground), ("chm", canopy))
    ]


def test_a_grown_scene_has_its_plants(pair, tmp_path):
    folder = run_grow(*pair, tmp_path / "forest")
    plants = assert_contract(folder / "plants.parquet")
    head = scene_head(folder)
    assert plants.crs == pyproj.CRS.from_user_input(head["crs"]) and len(plants) > 10
    west, south = head["south_west_m"]
    bounds = plants.total_bounds
    assert west <= bounds[0] and south <= bounds[1]
    assert bounds[2] <= west + head["extent_m"][0] and bounds[3] <= south + head["extent_m"][1]
    assert set(plants["layer"]) == {"canopy", "undergrowth"}
    # a tree stands where the canopy is about as high as it
    trees, beneath = (plants[plants["layer"] == layer] for layer in ("canopy", "undergrowth"))
    with rasterio.open(pair[1]) as raster:
        above = np.array([v[0] for v in raster.sample(zip(trees.geometry.x, trees.geometry.y))])
    assert np.median(np.abs(above - trees["height_m"])) < 2.0
    # undergrowth from 10 cm up, outside trunks, where its maps say
    assert beneath["height_m"].min() >= 0.1 - 1e-3 and beneath["height_m"].median() < 1.5
    stages = tomllib.loads((folder / "scene.toml").read_text())["stages"]
    assert stages["undergrowth"]["figures"]["plants"] == len(beneath)
    nearest, at = spatial.cKDTree(np.column_stack([trees.geometry.x, trees.geometry.y])).query(
        np.column_stack([beneath.geometry.x, beneath.geometry.y])
    )
    assert (nearest >= trees["dbh_m"].to_numpy()[at] / 2 - 1e-3).all()
    for name, most in (("grass", 0.6), ("litterfall", 1.0)):
        with rasterio.open(folder / f"{name}.tif") as raster:
            values = raster.read(1, masked=True)
        assert 0.0 <= values.min() < values.max() <= most, name


def test_a_grown_scene_as_text(pair, tmp_path):
    as_table = run_grow(*pair, tmp_path / "table")
    as_text = run_grow(*pair, tmp_path / "text", "--table", "csv")
    text = pandas.read_csv(as_text / "plants.csv")
    equal_tables(geopandas.read_parquet(as_table / "plants.parquet"), text)
