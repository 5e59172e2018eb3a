"""The tables of deadwood and of its history open in GeoPandas, pandas, pyarrow and GDAL as what they claim to be."""

import json
import subprocess

import geopandas
import numpy as np
import pandas
import pyarrow.parquet
import pyproj
import pytest

from conftest import TARGET, WILDWOOD, hills, run_import, scene_head, write_tiff

SYSTEMS = ["EPSG:32611", "EPSG:2154", "local"]
SNAGS = {
    "id": "int64", "species": "string", "geometry": "binary", "z_m": "float", "height_m": "float",
    "height_at_death_m": "float", "dbh_m": "float", "years_dead": "float", "decay_class": "int64",
    "density_fraction": "float", "branch_fraction": "float", "cause": "string",
}
DOWNED_LOGS = {
    "id": "int64", "parent_id": "int64", "species": "string", "kind": "string", "geometry": "binary",
    "z_m": "float", "length_m": "float", "diameter_base_m": "float", "diameter_tip_m": "float",
    "azimuth_deg": "float", "years_down": "float", "decay_class": "int64", "density_fraction": "float",
    "cause": "string",
}
HISTORY = {
    "plant_id": "int64", "year": "int64", "month": "int64", "event": "string", "severity": "float",
    "cause": "string",
}
TIMELINE = {
    "year": "int64", "species": "string", "live": "int64", "live_trees": "int64", "snags": "int64",
    "downed_logs": "int64", "sprouted": "int64", "live_m2_ha": "float", "snag_m2_ha": "float",
    "downed_log_m2_ha": "float",
    **{
        f"{of}deaths_{c}": "int64"
        for of in ("", "tree_")
        for c in ("age", "competition", "drought", "disease", "fire", "storm")
    },
}
GROWTH = {
    "plant_id": "int64", "year": "int64", "height_m": "float", "crown_radius_m": "float",
    "dbh_m": "float", "vigor": "float", "carbon_pool": "float",
}
# half of the last digit that texts show, and what binary fractions add to it
CSV_ERROR = {"years_dead": 6e-3, "years_down": 6e-3}


def assert_types(path, columns):
    schema = pyarrow.parquet.read_schema(path)
    assert {field.name: str(field.type) for field in schema} == columns
    assert schema.names == list(columns)
    assert not any(schema.field(name).nullable for name in columns)
    return schema


def assert_places(path, columns, kind):
    """Types, metadata and geometry of a table with places; gives it as GeoPandas reads it."""
    geo = json.loads(assert_types(path, columns).metadata[b"geo"])
    assert geo["version"] == "1.1.0" and geo["primary_column"] == "geometry"
    column = geo["columns"]["geometry"]
    assert column["encoding"] == "WKB" and column["geometry_types"] == [kind]
    table = geopandas.read_parquet(path)
    assert (table.geometry.geom_type == kind).all() and not table.geometry.has_z.any()
    assert np.array_equal(table.total_bounds, column["bbox"])
    assert table["id"].is_monotonic_increasing and table["id"].is_unique
    return table


def assert_equal_texts(table, text, columns):
    """Both formats hold the same in all columns but the geometry."""
    for name in columns:
        if columns[name] == "string":
            assert (table[name] == text[name]).all(), name
        elif columns[name] != "binary":
            difference = np.abs(table[name].to_numpy("float64") - text[name].to_numpy("float64"))
            assert difference.max() <= CSV_ERROR.get(name, 6e-4), name


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """The folder of tables that the example program wrote."""
    program = TARGET / "debug" / "examples" / "plants_table"
    if not program.exists():
        pytest.skip("no program plants_table: cargo build --example plants_table")
    folder = tmp_path_factory.mktemp("deadwood")
    done = subprocess.run([program, folder, *SYSTEMS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("index, system", [*enumerate(SYSTEMS)])
def test_snags_are_points(tables, index, system):
    path = tables / f"{index}.snags.parquet"
    snags = assert_places(path, SNAGS, "Point")
    assert len(snags) == 125 and set(snags["decay_class"]) == {1, 2, 3, 4, 5}
    assert snags.crs == (None if system == "local" else pyproj.CRS.from_user_input(system))
    # they stand where they lived
    plants = geopandas.read_parquet(tables / f"{index}.parquet").set_index("id")
    assert snags.geometry.geom_equals(plants.geometry.loc[snags["id"]].reset_index(drop=True)).all()
    text = pandas.read_csv(path.with_suffix(".csv"))
    assert [*text.columns[:4]] == ["id", "species", "x", "y"]
    assert np.abs(text["x"] - snags.geometry.x).max() <= 6e-5
    assert_equal_texts(snags, text, SNAGS)


@pytest.mark.parametrize("index, system", [*enumerate(SYSTEMS)])
def test_downed_logs_are_lines_from_the_thick_end(tables, index, system):
    path = tables / f"{index}.downed_logs.parquet"
    logs = assert_places(path, DOWNED_LOGS, "LineString")
    assert len(logs) == 63 and set(logs["kind"]) == {"trunk", "top", "branch", "uprooted"}
    assert logs.crs == (None if system == "local" else pyproj.CRS.from_user_input(system))
    assert np.abs(logs.geometry.length - logs["length_m"]).max() < 1e-3
    ends = np.array([line.coords for line in logs.geometry])
    east, north = (ends[:, 1] - ends[:, 0]).T
    aside = np.radians(logs["azimuth_deg"]) - np.arctan2(east, north)
    assert np.abs(np.sin(aside) * logs["length_m"]).max() < 1e-3 and np.cos(aside).min() > 0
    # the thick end lies where the tree stood
    plants = geopandas.read_parquet(tables / f"{index}.parquet").set_index("id")
    stood = plants.geometry.loc[logs["parent_id"]]
    assert np.array_equal(ends[:, 0], np.column_stack([stood.x, stood.y]))


def test_downed_logs_as_text_open_as_lines(tables):
    """GDAL, and with it QGIS, takes the column wkt for the geometry without being told."""
    logs = geopandas.read_parquet(tables / "0.downed_logs.parquet")
    path = tables / "0.downed_logs.csv"
    lines = geopandas.read_file(path, engine="pyogrio")
    assert (lines.geometry.geom_type == "LineString").all()
    assert lines.geometry.set_crs(logs.crs).geom_equals_exact(logs.geometry, 1e-4).all()
    assert_equal_texts(logs, pandas.read_csv(path), DOWNED_LOGS)


@pytest.mark.parametrize("name", ["snags", "downed_logs"])
def test_other_formats_take_the_tables(tables, tmp_path, name):
    """What GDAL's own drivers write of them, as QGIS does, reads back equal."""
    table = geopandas.read_parquet(tables / f"0.{name}.parquet")
    table.to_file(tmp_path / "table.gpkg", engine="pyogrio")
    again = geopandas.read_file(tmp_path / "table.gpkg", engine="pyogrio")
    assert again.crs == table.crs and again.geometry.geom_equals(table.geometry).all()
    assert (again["id"] == table["id"]).all() and (again["cause"] == table["cause"]).all()


@pytest.mark.parametrize(
    "name, columns, key",
    [
        ("history", HISTORY, ["plant_id"]),
        ("timeline", TIMELINE, ["year"]),
        ("growth", GROWTH, ["plant_id", "year"]),
    ],
)
def test_tables_without_places(tables, name, columns, key):
    path = tables / f"{name}.parquet"
    schema = assert_types(path, columns)
    assert b"geo" not in (schema.metadata or {})
    table = pandas.read_parquet(path)
    assert table.sort_values(key, kind="stable").equals(table) and len(table) > 49
    assert_equal_texts(table, pandas.read_csv(path.with_suffix(".csv"), keep_default_na=False), columns)


def test_histories_keep_their_time_and_name_causes(tables):
    history = pandas.read_parquet(tables / "history.parquet")
    assert history.groupby("plant_id")["year"].apply(lambda years: years.is_monotonic_increasing).all()
    assert [*history["event"].iloc[:3]] == ["sprouted", "died", "snag-fell"]
    died = history["event"] == "died"
    assert died.sum() == 125 and (history["event"] == "snag-fell").sum() == 63
    assert set(history["cause"][died]) == {"age", "competition", "drought", "disease", "fire", "storm"}
    assert (history["cause"][history["event"] == "sprouted"] == "").all()


SIDE = 40  # cells of 2 m
YEARS = 90
EVENTS = """
[[event]]
type = "wind-storm"
year = 60
speed_m_s = 32
[[event]]
type = "wildfire"
year = 75
wind_m_s = 5
[[event]]
type = "wind-storm"
year = 89
speed_m_s = 28
"""


@pytest.fixture(scope="module")
def aged(tmp_path_factory):
    """A scene of bare ground that was aged, storms and a fire included."""
    if subprocess.run([WILDWOOD, "age", "--help"], capture_output=True).returncode != 0:
        pytest.skip("this wildwood has no command `age`")
    home = tmp_path_factory.mktemp("aged")
    ground = write_tiff(home / "dem.tif", 850 + hills(SIDE, SIDE, 2.0, 5.0), crs="EPSG:2154")
    folder = run_import(ground, home / "wood", "--biome", "pyrenees")
    (home / "events.toml").write_text(EVENTS, encoding="utf-8")
    command = [WILDWOOD, "age", folder, "--years", YEARS, "--events", home / "events.toml", "--quiet"]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def test_deadwood_of_an_aged_scene_lies_inside_and_has_parents(aged):
    snags = assert_places(aged / "snags.parquet", SNAGS, "Point")
    logs = assert_places(aged / "downed_logs.parquet", DOWNED_LOGS, "LineString")
    plants = geopandas.read_parquet(aged / "plants.parquet")
    assert len(snags) > 20 and len(logs) > 20 and len(plants) > 100
    (west, south), (width, height) = scene_head(aged)["south_west_m"], scene_head(aged)["extent_m"]
    thick_ends = np.array([line.coords[0] for line in logs.geometry])
    is_stem = (logs["kind"] != "branch").to_numpy()
    for places, rim in [
        (np.column_stack([snags.geometry.x, snags.geometry.y]), 1e-3),
        (np.column_stack([plants.geometry.x, plants.geometry.y]), 1e-3),
        (thick_ends[is_stem], 1e-3),
        (thick_ends, 10.0),  # branches of crowns at the rim fall beyond it
    ]:
        inside = places - [west, south]
        assert inside.min() >= -rim and (inside <= np.array([width, height]) + rim).all()

    # whoever is dead died, when and of what its snag says
    history = pandas.read_parquet(aged / "history.parquet")
    died = history[history["event"] == "died"].set_index("plant_id")
    assert died.index.is_unique and set(snags["id"]) <= set(died.index)
    of_snags = died.loc[snags["id"]]
    assert (of_snags["cause"].to_numpy() == snags["cause"].to_numpy()).all()
    assert (YEARS - of_snags["year"].to_numpy() == snags["years_dead"].to_numpy()).all()
    assert set(logs["parent_id"]) <= set(died.index) | set(plants["id"])
    assert not set(plants["id"]) & set(died.index)
    species = pandas.concat([snags, plants]).set_index("id")["species"]
    known = logs[logs["parent_id"].isin(species.index)]
    assert (species.loc[known["parent_id"]].to_numpy() == known["species"].to_numpy()).all()

    # stems fell from where they stood
    stood = snags.set_index("id").geometry
    of_snag = is_stem & logs["parent_id"].isin(stood.index).to_numpy()
    points = stood.loc[logs["parent_id"][of_snag]]
    assert of_snag.any() and np.allclose(thick_ends[of_snag], np.column_stack([points.x, points.y]))
    uprooted = logs["kind"] == "uprooted"
    assert (logs["cause"][uprooted] == "storm").all()
    assert not set(logs["parent_id"][uprooted]) & set(snags["id"])


def test_the_history_of_an_aged_scene_runs_forward(aged):
    history = pandas.read_parquet(aged / "history.parquet")
    months = 12 * history["year"] + history["month"]
    assert months.groupby(history["plant_id"]).apply(lambda m: m.is_monotonic_increasing).all()
    assert (history.groupby("plant_id")["event"].first() == "sprouted").all()
    is_dead = (history["event"] == "died").groupby(history["plant_id"]).cumsum() > 0
    assert set(history["event"][is_dead]) <= {"died", "snag-snapped", "snag-fell"}


def test_the_timeline_of_an_aged_scene_counts_its_tables(aged):
    timeline = pandas.read_parquet(aged / "timeline.parquet")
    assert [*timeline["year"].unique()] == [*range(YEARS + 1)]
    last = timeline[timeline["year"] == YEARS].set_index("species")
    for column, name in [("live", "plants"), ("snags", "snags"), ("downed_logs", "downed_logs")]:
        rows = geopandas.read_parquet(aged / f"{name}.parquet")["species"].value_counts()
        rows = rows.reindex(last.index, fill_value=0)
        # seedlings below a decimetre are counted, and in no table
        assert ((rows <= last[column]) if name == "plants" else (rows == last[column])).all(), name
    # all that sprouted lives or died
    by_species = timeline.groupby("species")
    deaths = by_species[[c for c in timeline.columns if c.startswith("deaths_")]].sum().sum(axis=1)
    assert (by_species["sprouted"].sum() - deaths == last["live"].loc[deaths.index]).all()
    # basal areas are those of the stems, 7.5 cm and more
    plants = geopandas.read_parquet(aged / "plants.parquet")
    thick = plants[plants["dbh_m"] >= 0.075]
    hectares = np.prod(scene_head(aged)["extent_m"]) / 1e4
    area = (np.pi / 4 * thick["dbh_m"].astype("float64") ** 2).groupby(thick["species"]).sum() / hectares
    assert np.allclose(area.reindex(last.index, fill_value=0), last["live_m2_ha"], rtol=1e-4)
