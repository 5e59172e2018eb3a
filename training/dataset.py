"""Co-registered terrain and canopy rasters become training samples.

A *pair* is a DTM and a CHM on one grid. Both are brought to cells of about 4 m, the terrain is encoded relative to its
surroundings, and sketches and stand heights are derived from the canopy. Blocks that are held out never reach training.
"""

import csv
import dataclasses
import pathlib

import numpy as np
import rasterio
from scipy import ndimage

CELL_M = 4.0
"""Cell size of the networks, metres."""

CANOPY_M = 3.0
"""Height above which a cell is canopy, metres (Kapp 2020, section 4)."""

MAX_HEIGHT_M = 36.0
"""Height at the top of the encoding, metres: above every canopy of the training data."""

EMPTY, SPARSE, DENSE = 0, 1, 2
SKETCH_CLASSES = 3

RELIEF_RADIUS_CELLS = 50
RELIEF_M = 15.0
GRADIENT = 0.3
STAND_RADIUS_CELLS = 8.0
"""Standard deviation of the blur that a stand's height is taken over: 32 m."""


# Encodings. The program's twin is src/canopy/learned/conditions.rs.


def box_blur(values, weights, radius):
    """Mean over three passes of a (2·radius+1)² box, of what has weight; near a Gaussian of deviation radius."""
    size = 2 * radius + 1
    total, weight = values * weights, weights.astype(np.float64)
    for _ in range(3):
        total = ndimage.uniform_filter(total, size, mode="constant")
        weight = ndimage.uniform_filter(weight, size, mode="constant")
    return total / np.maximum(weight, 1e-12)


def terrain_channels(elevation_m, valid, cell_m):
    """Relief and the gradients east and north, compressed by asinh: (3, rows, cols), zero where there is no terrain.

    Only height against the surroundings counts: a plateau at sea level and one at 2000 m look alike.
    """
    filled = np.where(valid, elevation_m, 0.0).astype(np.float64)
    mean = box_blur(filled, valid, RELIEF_RADIUS_CELLS)
    relief = np.where(valid, filled - mean, 0.0)
    north, east = np.zeros_like(relief), np.zeros_like(relief)
    east[:, 1:-1] = (filled[:, 2:] - filled[:, :-2]) * (valid[:, 2:] & valid[:, :-2])
    north[1:-1] = (filled[:-2] - filled[2:]) * (valid[2:] & valid[:-2])
    east[:, [0, -1]] = east[:, [1, -2]]
    north[[0, -1]] = north[[1, -2]]
    east, north = east / (2 * cell_m), north / (2 * cell_m)
    channels = np.stack([np.arcsinh(relief / RELIEF_M), np.arcsinh(east / GRADIENT), np.arcsinh(north / GRADIENT)])
    return np.where(valid, channels, 0.0).astype(np.float32)


def encode_height(height_m):
    """Heights as the networks see them: 2·sqrt(h/36) − 1, so that low canopy is resolved finely."""
    return (2.0 * np.sqrt(np.clip(height_m, 0.0, MAX_HEIGHT_M) / MAX_HEIGHT_M) - 1.0).astype(np.float32)


def stand_height_m(chm_m, valid, radius=STAND_RADIUS_CELLS):
    """Mean height of canopy cells around each cell; far from canopy, that of the nearest surroundings that have some."""
    canopy = (chm_m > CANOPY_M) & valid
    height = np.where(canopy, chm_m, 0.0)
    overall = height.sum() / max(canopy.sum(), 1) if canopy.any() else 5.0
    weight, total = np.full(chm_m.shape, 1e-6), np.full(chm_m.shape, 1e-6 * overall)
    # wider surroundings count for less, so that they decide only where nothing is near
    for spread, share in ((1, 1.0), (4, 1e-2), (12, 1e-4)):
        weight += share * ndimage.gaussian_filter(canopy.astype(np.float64), radius * spread, mode="nearest")
        total += share * ndimage.gaussian_filter(height.astype(np.float64), radius * spread, mode="nearest")
    return (total / weight).astype(np.float32)


STAND_BOX_CELLS = 8
"""Radius of the box whose three passes come near the blur that a stand's height is taken over."""

TRAINED_M = (4.5, 24.0)
"""Stand heights that networks are asked for."""

FORM_KEPT_FRACTION, LEAST_FOUND_FRACTION = 0.5, 0.16
TALLEST_ABOVE_M, TALLEST_ABOVE_STANDS = 14.0, 1.6


def at_stand_height(height_m, canopy, stand_m):
    """Canopy heights brought to the stand heights that were asked for, in metres. Twin of src/canopy/learned/stand_height.rs.

    Networks know few open stands that are tall, and none beyond their training. What lies above 3 m is scaled, place by
    place, until its mean is the one asked for. Where a network's canopy is lower than half a stand of its training that was
    asked for, cells draw nearer to the mean as they are made taller, those above it more. No cell grows far beyond its stand.
    """
    above = np.where(canopy, np.maximum(height_m - CANOPY_M, 1e-3), 0.0)
    wanted, asked = (np.maximum(stand - CANOPY_M, 1e-3) for stand in (stand_m, np.clip(stand_m, *TRAINED_M)))
    mean = np.maximum(box_blur(above, canopy, STAND_BOX_CELLS), 1e-3)
    ratio, power = above / mean, np.clip(mean / (FORM_KEPT_FRACTION * asked), LEAST_FOUND_FRACTION, 1.0)
    shape = np.where(canopy, ratio ** np.where(ratio > 1.0, power**1.5, np.sqrt(power)), 0.0)
    tall = wanted * shape / np.maximum(box_blur(shape, canopy, STAND_BOX_CELLS), 1e-3)
    return np.where(canopy, CANOPY_M + np.minimum(tall, TALLEST_ABOVE_M + TALLEST_ABOVE_STANDS * wanted), height_m)


# Sketches.


@dataclasses.dataclass(frozen=True)
class SketchStyle:
    """How a painted density is derived from a footprint: what a person would paint who sees it."""

    blur_cells: float = 4.0
    empty_below: float = 0.10
    dense_above: float = 0.35
    majority_cells: int = 9
    speck_cells: int = 60

    @staticmethod
    def random(rng):
        """Another hand: finer or coarser strokes, another idea of where sparse ends."""
        return SketchStyle(
            blur_cells=float(rng.uniform(3.0, 6.0)),
            empty_below=float(rng.uniform(0.07, 0.14)),
            dense_above=float(rng.uniform(0.29, 0.43)),
            majority_cells=int(rng.choice([5, 7, 9, 11, 13])),
            speck_cells=int(rng.uniform(20, 160)),
        )


PLAIN_STYLE = SketchStyle()


def derive_sketch(footprint, style=PLAIN_STYLE, known=None):
    """Painted density that suits a footprint: 0 empty, 1 sparse, 2 dense. Cells that are not `known` have no say."""
    blur = lambda a: ndimage.gaussian_filter(a.astype(np.float32), style.blur_cells, mode="nearest")
    cover = blur(footprint) if known is None else blur(footprint & known) / np.maximum(blur(known), 1e-3)
    sketch = np.where(cover < style.empty_below, EMPTY, np.where(cover > style.dense_above, DENSE, SPARSE))
    for _ in range(2):
        sketch = _majority(sketch, style.majority_cells)
    return _without_specks(sketch, style.speck_cells).astype(np.uint8)


def _majority(sketch, size):
    counts = [ndimage.uniform_filter((sketch == k).astype(np.float32), size, mode="nearest") for k in range(SKETCH_CLASSES)]
    return np.argmax(counts, axis=0)


def _without_specks(sketch, fewest_cells):
    speck = np.zeros(sketch.shape, bool)
    for k in range(SKETCH_CLASSES):
        labels, count = ndimage.label(sketch == k)
        sizes = np.bincount(labels.ravel(), minlength=count + 1)
        sizes[0] = fewest_cells
        speck |= sizes[labels] < fewest_cells
    if speck.all() or not speck.any():
        return sketch
    nearest = ndimage.distance_transform_edt(speck, return_distances=False, return_indices=True)
    return sketch[tuple(nearest)]


def brush_sketch(shape, rng):
    """Strokes of a round brush on empty, sparse or dense ground, as somebody paints who has no real forest in mind."""
    sketch = np.full(shape, rng.integers(SKETCH_CLASSES), np.uint8)
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    for _ in range(rng.integers(2, 7)):
        kind, radius = rng.integers(SKETCH_CLASSES), rng.uniform(5, 16)
        row, col, heading = rng.uniform(0, shape[0]), rng.uniform(0, shape[1]), rng.uniform(0, 2 * np.pi)
        for _ in range(rng.integers(1, 12)):
            sketch[(rows - row) ** 2 + (cols - col) ** 2 < radius**2] = kind
            heading += rng.normal(0, 0.5)
            row, col = row + radius * 0.8 * np.sin(heading), col + radius * 0.8 * np.cos(heading)
    return sketch


def one_hot(sketch):
    return np.stack([(sketch == k) for k in range(SKETCH_CLASSES)]).astype(np.float32)


# Sites.


@dataclasses.dataclass
class Site:
    """One pair at the networks' cell size, with all that is derived from it."""

    name: str
    cell_m: float
    dtm_m: np.ndarray
    chm_m: np.ndarray
    valid: np.ndarray
    held_out: np.ndarray
    painted: np.ndarray | None = None

    def __post_init__(self):
        self.terrain = terrain_channels(self.dtm_m, self.valid, self.cell_m)
        self.footprint = (self.chm_m > CANOPY_M) & self.valid
        self.stand_m = stand_height_m(self.chm_m, self.valid)
        self.sketch = self.painted if self.painted is not None else derive_sketch(self.footprint)

    def part(self, rows, cols):
        """The same site cut to a rectangle, with everything derived anew from what is inside."""
        cut = lambda a: None if a is None else a[rows, cols]
        return Site(self.name, self.cell_m, cut(self.dtm_m), cut(self.chm_m), cut(self.valid), cut(self.held_out), cut(self.painted))


def read_pair(dtm_path, chm_path, name, holdout="none", sketch_path=None):
    """A pair of rasters on one grid as a site. Finer cells are brought to about 4 m: heights by their 90th percentile."""
    with rasterio.open(dtm_path) as dtm_file, rasterio.open(chm_path) as chm_file:
        if dtm_file.shape != chm_file.shape or not dtm_file.transform.almost_equals(chm_file.transform, 1e-3):
            raise ValueError(f"{name}: {dtm_path} and {chm_path} are not on one grid: warp one onto the other first")
        if not (dtm_file.crs and dtm_file.crs.is_projected):
            raise ValueError(f"{name}: {dtm_path} is not in a metric projection: warp both rasters to the local UTM zone first")
        dtm, chm = dtm_file.read(1, masked=True), chm_file.read(1, masked=True)
        cell = abs(dtm_file.transform.a) * (dtm_file.crs.linear_units_factor[1] or 1.0)
    if cell > 1.6 * CELL_M:
        raise ValueError(f"{name}: cells of {cell:g} m are too wide: training needs 4 m or finer")
    painted = None
    if sketch_path:
        with rasterio.open(sketch_path) as file:
            painted = file.read(1).astype(np.uint8)
        if painted.shape != chm.shape or painted.max() > DENSE:
            raise ValueError(f"{name}: {sketch_path} must lie on the pair's grid, with 0 empty, 1 sparse, 2 dense")
    valid = ~(np.ma.getmaskarray(dtm) | np.ma.getmaskarray(chm))
    valid &= np.isfinite(dtm.filled(0)) & np.isfinite(chm.filled(0))
    factor = max(1, round(CELL_M / cell))
    dtm_m = _coarser(np.where(valid, dtm.filled(0), np.nan), factor, np.nanmean)
    chm_m = _coarser(np.where(valid, np.maximum(chm.filled(0), 0.0), np.nan), factor, lambda a, axis: np.nanpercentile(a, 90, axis=axis))
    if painted is not None:
        painted = painted[factor // 2 :: factor, factor // 2 :: factor][: dtm_m.shape[0], : dtm_m.shape[1]]
    valid = np.isfinite(dtm_m) & np.isfinite(chm_m)
    held_out = held_out_cells(dtm_m.shape, holdout)
    return Site(name, cell * factor, np.where(valid, dtm_m, 0.0), np.where(valid, chm_m, 0.0), valid, held_out, painted)


def _coarser(values, factor, statistic):
    if factor == 1:
        return values.astype(np.float64)
    rows, cols = (n // factor for n in values.shape)
    blocks = values[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor).transpose(0, 2, 1, 3)
    blocks = blocks.reshape(rows, cols, factor * factor)
    out = np.full((rows, cols), np.nan)
    some = np.isfinite(blocks).mean(axis=2) >= 0.5
    out[some] = statistic(blocks[some], axis=1)
    return out


def held_out_cells(shape, rule):
    """Cells kept out of training: `none`, `all`, `south:0.25` (a side and its share), or `blocks:5` (every fifth block of 96²)."""
    held = np.zeros(shape, bool)
    kind, _, value = rule.partition(":")
    rows, cols = shape
    if kind == "none":
        return held
    if kind == "all":
        return ~held
    if kind == "blocks":
        row, col = np.mgrid[:rows, :cols] // 96
        return (row * -(-cols // 96) + col) % int(value) == 0
    if kind in ("north", "south", "west", "east"):
        share = float(value)
        cut = {
            "north": np.s_[: round(rows * share)],
            "south": np.s_[rows - round(rows * share) :],
            "west": np.s_[:, : round(cols * share)],
            "east": np.s_[:, cols - round(cols * share) :],
        }[kind]
        held[cut] = True
        return held
    raise ValueError(f"unknown hold-out rule '{rule}': none, all, north|south|west|east:SHARE or blocks:N")


def pairs_table(path):
    """Rows of a table of pairs (CSV: name,dtm,chm[,holdout][,sketch][,weight][,source][,licence]) or of a folder of *_dtm.tif
    and *_chm.tif, and the folder that their paths are relative to: (root, rows)."""
    path = pathlib.Path(path)
    if path.is_dir():
        dtms = sorted(path.glob("*_dtm.tif"))
        table = [{"name": d.name[: -len("_dtm.tif")], "dtm": d.name, "chm": d.name.replace("_dtm", "_chm"), "holdout": "blocks:5"} for d in dtms]
        root = path
    else:
        with open(path, newline="") as file:
            table = list(csv.DictReader(line for line in file if not line.startswith("#")))
        root = path.parent
    if not table:
        raise ValueError(f"no pairs in {path}: expected *_dtm.tif beside *_chm.tif, or a table with the columns name,dtm,chm")
    return root, table


def read_pairs(path):
    """Every site of a table or folder of pairs (`pairs_table`), and the share of training samples that each is to have."""
    root, table = pairs_table(path)
    sites, weights = [], []
    for row in table:
        sketch = row.get("sketch")
        sites.append(read_pair(root / row["dtm"], root / row["chm"], row["name"], row.get("holdout") or "none", root / sketch if sketch else None))
        weights.append(float(row.get("weight") or sites[-1].valid.sum() / 2.5e5))
    return sites, np.array(weights) / np.sum(weights)


# Samples.


@dataclasses.dataclass
class Sample:
    """A square of a site: terrain (3), sketch (3, one-hot), stand height (encoded), canopy height (m), footprint."""

    terrain: np.ndarray
    sketch: np.ndarray
    stand: np.ndarray
    chm_m: np.ndarray
    style: SketchStyle = PLAIN_STYLE


class Sampler:
    """Draws squares from the training part of sites, each with another style of sketch and another sharpness of stand height."""

    def __init__(self, sites, weights, size, seed, sketches_per_site=12, plain_share=0.0):
        self.sites, self.weights, self.size, self.plain_share = sites, weights, size, plain_share
        self.rng = np.random.default_rng(seed)
        style_rng = np.random.default_rng([seed, 1])
        self.sketches, self.stands, self.corners = [], [], []
        for site in sites:
            styles = [PLAIN_STYLE] + [SketchStyle.random(style_rng) for _ in range(sketches_per_site - 1)]
            # sketches see only what may be trained on: a stroke must not tell of held-out canopy
            known = site.valid & ~site.held_out
            derived = [(derive_sketch(site.footprint, style, known), style) for style in styles]
            painted = [] if site.painted is None else [(site.painted, PLAIN_STYLE)] * len(derived)
            self.sketches.append(painted + derived)
            chm = np.where(known, site.chm_m, 0.0)
            self.stands.append([stand_height_m(chm, known, r) for r in (STAND_RADIUS_CELLS, 2 * STAND_RADIUS_CELLS, 5 * STAND_RADIUS_CELLS)])
            self.corners.append(_corners(known, size))
            if len(self.corners[-1]) == 0:
                raise ValueError(f"{site.name}: no square of {size} cells is free of held-out and missing cells: hold out less, or take a smaller --crop")

    def draw(self):
        index = self.rng.choice(len(self.sites), p=self.weights)
        site, rng, size = self.sites[index], self.rng, self.size
        row, col = self.corners[index][rng.integers(len(self.corners[index]))]
        cut = np.s_[row : row + size, col : col + size]
        # the first of the hands is the plain one, or somebody's own paint
        hand = 0 if rng.random() < self.plain_share else rng.integers(len(self.sketches[index]))
        sketch, style = self.sketches[index][hand]
        sketch = sketch[cut]
        stand = self.stands[index][rng.choice(3, p=[0.6, 0.2, 0.2])][cut]
        if rng.random() < 0.15:
            stand = np.full_like(stand, stand.mean())
        sample = Sample(site.terrain[(slice(None), *cut)], one_hot(sketch), encode_height(stand)[None], site.chm_m[cut].astype(np.float32)[None], style)
        return _mirrored(sample) if rng.random() < 0.5 else sample


def _corners(free, size):
    """Upper left corners of squares that are wholly free."""
    if min(free.shape) < size:
        return np.zeros((0, 2), int)
    sums = np.pad(np.cumsum(np.cumsum(free, 0), 1), ((1, 0), (1, 0)))
    inside = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    return np.argwhere(inside == size * size)


def _mirrored(sample):
    """East and west exchanged. The sun's path is its own mirror image, so exposure stays right; north and south never are."""
    flip = lambda a: a[..., ::-1].copy()
    terrain = flip(sample.terrain)
    terrain[1] *= -1
    return Sample(terrain, flip(sample.sketch), flip(sample.stand), flip(sample.chm_m), sample.style)
