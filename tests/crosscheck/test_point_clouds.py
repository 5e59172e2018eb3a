"""Point clouds that laspy writes become the ground and the trees they were made of."""

import struct

import laspy
import lazrs
import numpy as np
import pyproj
import pytest
import rasterio

from conftest import read, run_import

SIDE_M = 60.0
WEST, SOUTH = 500_000.0, 4_100_000.0
TREE_HEIGHT_M = 12.0


def plane(x, y):
    return 100 + 0.1 * (x - WEST) + 0.05 * (y - SOUTH)


def plane_with_a_tree(point_format, version):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, SIDE_M, (2, 40_000))
    x, y = x + WEST, y + SOUTH
    in_tree = np.hypot(x - WEST - 30, y - SOUTH - 30) < 5
    is_canopy = in_tree & (rng.uniform(size=x.size) < 0.6)
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.01] * 3, [WEST, SOUTH, 0]
    header.add_crs(pyproj.CRS.from_epsg(32611))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = x, y, plane(x, y) + TREE_HEIGHT_M * is_canopy
    cloud.classification = np.where(is_canopy, 5, 2).astype("uint8")
    cloud.return_number[:] = cloud.number_of_returns[:] = 1
    cloud.update_header()
    return cloud


def write_copc(cloud, path):
    """Root chunk with a tenth of the points, one chunk for each quarter: COPC 1.0 as its specification has it."""
    records = np.frombuffer(cloud.points.array.tobytes(), np.uint8).reshape(len(cloud), -1)
    middle, half = [WEST + 32, SOUTH + 32, 132], 32.0
    is_root = np.arange(len(cloud)) % 10 == 0
    east, north, top = (np.asarray(a) > m for a, m in zip((cloud.x, cloud.y, cloud.z), middle))
    nodes = [((0, 0, 0, 0), is_root)]
    for octant in np.ndindex(2, 2, 2):
        inside = ~is_root & (east == octant[0]) & (north == octant[1]) & (top == octant[2])
        nodes.append(((1, *octant), inside))

    vlr = lazrs.LazVlr.new_for_compression(cloud.point_format.id, 0, True)
    wkt = next(v for v in cloud.header.vlrs if v.record_id == 2112).record_data_bytes()
    laszip = vlr.record_data()

    def head(user, number, size, extended=False):
        return struct.pack("<H16sH" + ("Q" if extended else "H") + "32s", 0, user, number, size, b"")

    offset_to_points = 375 + (54 + 160) + (54 + len(laszip)) + (54 + len(wkt))
    with open(path, "w+b") as file:
        file.write(bytes(offset_to_points))
        compressor, entries = lazrs.LasZipCompressor(file, vlr), []
        start = offset_to_points + 8  # behind the chunk table's place
        for key, members in nodes:
            count = int(members.sum())
            if count:
                compressor.compress_many(records[members].ravel())
                compressor.finish_current_chunk()
                entries.append((*key, start, file.tell() - start, count))
                start = file.tell()
        compressor.done()
        file.seek(0, 2)
        evlr = file.tell()
        hierarchy = b"".join(struct.pack("<4iQ2i", *entry) for entry in entries)
        file.write(head(b"copc", 1000, len(hierarchy), extended=True) + hierarchy)
        info = struct.pack("<5d2Q2d88x", *middle, half, 1.0, evlr + 60, len(hierarchy), 0.0, 0.0)
        h = cloud.header
        bounds = [v for pair in zip(h.maxs, h.mins) for v in pair]
        file.seek(0)
        file.write(struct.pack(
            "<4sHH16sBB32s32sHHHIIBHI5I3d3d6dQQIQ15Q", b"LASF", 0, 16, b"", 1, 4, b"", b"", 1, 2024, 375,
            offset_to_points, 3, cloud.point_format.id | 0x80, records.shape[1], 0, *[0] * 5,
            *h.scales, *h.offsets, *bounds, 0, evlr, 1, len(cloud), len(cloud), *[0] * 14,
        ))
        file.write(head(b"copc", 1, 160) + info)
        file.write(head(b"laszip encoded", 22204, len(laszip)) + laszip)
        file.write(head(b"LASF_Projection", 2112, len(wkt)) + wkt)
        assert file.tell() == offset_to_points
    with laspy.CopcReader.open(path) as reader:  # the file is what its name says
        assert len(reader.query()) == len(cloud)


@pytest.mark.parametrize("suffix, point_format, version", [
    ("las", 0, "1.2"), ("las", 3, "1.2"), ("las", 6, "1.4"),
    ("laz", 1, "1.2"), ("laz", 3, "1.3"), ("laz", 6, "1.4"), ("laz", 7, "1.4"),
    ("copc.laz", 6, "1.4"), ("copc.laz", 7, "1.4"),
])
def test_a_plane_with_a_tree(suffix, point_format, version, tmp_path):
    """The terrain is the plane; the canopy is the tree, where the tree stands."""
    cloud, source = plane_with_a_tree(point_format, version), tmp_path / f"cloud.{suffix}"
    write_copc(cloud, source) if suffix == "copc.laz" else cloud.write(source)
    folder = run_import(source, tmp_path / "forest", "--cell", "1")
    with rasterio.open(folder / "terrain.tif") as out:
        assert out.crs.to_epsg() == 32611 and out.transform.a == 1.0
        dem, transform = out.read(1, masked=True), out.transform
    assert dem.count() > 0.9 * SIDE_M * SIDE_M
    rows, cols = np.indices(dem.shape) + 0.5
    x, y = transform.c + cols, transform.f - rows
    off = np.ma.abs(dem - plane(x, y))
    assert off[1:-1, 1:-1].max() < 0.02
    assert off.max() < 0.15  # at the rim half a cell lies beyond the last points: the plane rises 0.11 m a cell
    chm, dsm = read(folder / "chm.tif"), read(folder / "dsm.tif")
    distance = np.hypot(x - WEST - 30, y - SOUTH - 30)
    assert np.abs(chm[distance < 4] - TREE_HEIGHT_M).max() < 0.3
    assert chm[distance > 6.5].max() < 0.15
    assert np.ma.abs(dsm - dem - chm).max() < 0.05


def test_clouds_side_by_side_are_one(tmp_path):
    cloud = plane_with_a_tree(6, "1.4")
    cloud.write(tmp_path / "whole.laz")
    is_west = np.asarray(cloud.x) < WEST + 30
    halves = [tmp_path / "west.laz", tmp_path / "east.laz"]
    for path, members in zip(halves, (is_west, ~is_west)):
        half = laspy.LasData(cloud.header)
        half.points = cloud.points[members]
        half.write(path)
    whole = run_import(tmp_path / "whole.laz", tmp_path / "one", "--cell", "1")
    joined = run_import(halves, tmp_path / "two", "--cell", "1")
    for name in ("terrain.tif", "chm.tif", "dsm.tif"):
        a, b = read(whole / name), read(joined / name)
        assert np.array_equal(a.mask, b.mask), name
        assert np.ma.abs(a - b).max() < 0.02, name
