"""How like a real canopy a generated one is, as figures.

Heights are maps in metres at 4 m cells, canopy is what stands above 3 m. Where the notes give no formula, the one was
taken for which real blocks against real blocks come out as in the notes' table: figures are taken block by block and
averaged over a site's blocks (`figures`), save those that need many cells, which pool the blocks (`pooled_figures`).
"""

import numpy as np
from scipy import ndimage, stats

from dataset import CANOPY_M, CELL_M, SKETCH_CLASSES, encode_height

LAGS_CELLS = range(1, 16)
"""4 to 60 m."""

NEIGHBOURS = [(row, col) for row in (-1, 0, 1) for col in (-1, 0, 1) if row or col]


def figures(made_m, real_m, sketch_made, sketch):
    """Every figure of one generated block against the real one in its place, by name."""
    gamma, real_gamma = variogram(made_m), variogram(real_m)
    return {
        "agreement": agreement(sketch_made, sketch),
        "balanced_by_block": balanced_agreement(sketch_made, sketch),
        "cover_difference": float(canopy(made_m).mean() - canopy(real_m).mean()),
        "emd_m": height_distance_m(made_m, real_m),
        "maxima": ratio(maxima(made_m), maxima(real_m)),
        "variogram": float(np.mean(np.abs(gamma - real_gamma) / real_gamma)),
        "lag4": float(gamma[0] / real_gamma[0]),
        "gap_ks": gap_distance(made_m, real_m),
        "rumple": ratio(excess_surface(made_m), excess_surface(real_m)),
    }


def pooled_figures(made, real, sketches_made, sketches):
    """Figures of all generated blocks of a site against all its real ones: as many of both, all of one shape.

    The balanced agreement pools, for a block of one class alone would count as a perfect one of all classes.
    """
    return {
        "cover_r": cover_correlation(made, real),
        "balanced": balanced_agreement(np.stack(sketches_made), np.stack(sketches)),
        "spectrum": ratio(spectrum_peak(made), spectrum_peak(real)),
        "pattern_jsd": 100 * divergence(footprint_patterns(made), footprint_patterns(real)),
        "order_jsd": 100 * divergence(height_orders(made), height_orders(real)),
    }


def canopy(height_m):
    return height_m > CANOPY_M


def ratio(made, real):
    return float(made / real) if real else float("nan")


def correlation(a, b):
    """Pearson's r of all cells; not a number where either is constant."""
    a, b = np.ravel(a) - np.mean(a), np.ravel(b) - np.mean(b)
    scale = np.sqrt(np.sum(a * a) * np.sum(b * b))
    return float(np.sum(a * b) / scale) if scale > 1e-12 else float("nan")


def block_means(values, side=8):
    """Means over squares of side² cells; a rest at the lower and right border is left out."""
    rows, cols = (n // side for n in values.shape)
    return values[: rows * side, : cols * side].reshape(rows, side, cols, side).mean((1, 3))


# Place: does canopy stand where it should?


def cover_correlation(made, real):
    """r of the cover of squares of 8×8 cells (32 m), all blocks together."""
    covers = lambda blocks: np.concatenate([block_means(canopy(b).astype(float)).ravel() for b in blocks])
    return correlation(covers(made), covers(real))


def agreement(sketch_made, sketch):
    """Share of cells whose class, derived anew from the generated footprint (`dataset.derive_sketch`), is the painted one."""
    return float(np.mean(sketch_made == sketch))


def balanced_agreement(sketch_made, sketch):
    """The same share for each class that is painted at all, then the plain mean of those shares."""
    return float(np.mean([np.mean(sketch_made[sketch == k] == k) for k in range(SKETCH_CLASSES) if np.any(sketch == k)]))


# Heights and surface.


def height_distance_m(made_m, real_m):
    """Earth mover's distance between the heights of canopy cells, metres."""
    made, real = made_m[canopy(made_m)], real_m[canopy(real_m)]
    return float(stats.wasserstein_distance(made, real)) if made.size and real.size else float("nan")


def maxima(height_m):
    """Inner cells of at least 3 m that are strictly higher than their eight neighbours: about the number of crowns."""
    height = np.asarray(height_m)
    inner = height[1:-1, 1:-1]
    return int(np.sum((inner >= CANOPY_M) & (inner > np.max(_neighbours(height), axis=0))))


def excess_surface(height_m):
    """Canopy surface beyond that of the plane, as a share of the plane: mean of sqrt(1 + |∇h|²) − 1 by central differences."""
    rows, cols = np.gradient(height_m, CELL_M)
    return float(np.mean(np.sqrt(1 + rows**2 + cols**2) - 1))


def variogram(height_m, lags=LAGS_CELLS):
    """Half mean squared difference of heights at each lag, east and south together, m²."""
    gamma = []
    for lag in lags:
        south, east = height_m[lag:] - height_m[:-lag], height_m[:, lag:] - height_m[:, :-lag]
        gamma.append(0.5 * (np.sum(south**2) + np.sum(east**2)) / max(south.size + east.size, 1))
    return np.array(gamma)


# Texture.


def gap_sizes(height_m):
    """Cells of each opening: parts without canopy that hang together by their sides."""
    labels, count = ndimage.label(~canopy(height_m))
    return np.bincount(labels.ravel(), minlength=count + 1)[1:]


def gap_distance(made_m, real_m):
    """Kolmogorov–Smirnov distance between the sizes of openings, each opening counted once."""
    made, real = gap_sizes(made_m), gap_sizes(real_m)
    return float(stats.ks_2samp(made, real, method="asymp").statistic) if made.size and real.size else 1.0


def spectrum_peak(blocks):
    """Largest power over the mean of its ring, at periods of 8 cells or less: far above a real canopy's where there is a lattice.

    Power is averaged over the blocks first: a lattice stays, chance is evened out. So compare equal numbers of blocks.
    """
    shape = blocks[0].shape
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None])
    power = np.mean([np.abs(np.fft.fft2(b - np.mean(b))) ** 2 for b in blocks], axis=0)
    ring = np.round(frequency * min(shape)).astype(int).ravel()
    mean = (np.bincount(ring, power.ravel()) / np.maximum(np.bincount(ring), 1))[ring].reshape(shape)
    fine = (frequency >= 1 / 8) & (frequency <= 0.5)
    return float(np.max(power[fine] / np.maximum(mean[fine], 1e-12)))


def footprint_patterns(blocks):
    """Shares of the 512 ways in which 3×3 cells can be canopy or not."""
    counts = np.zeros(512)
    for block in blocks:
        inside = canopy(block).astype(int)
        code = inside[1:-1, 1:-1].copy()
        for bit, cells in enumerate(_neighbours(inside)):
            code += cells << (bit + 1)
        counts += np.bincount(code.ravel(), minlength=512)
    return counts / max(counts.sum(), 1)


def height_orders(blocks):
    """Shares of the 256 ways in which the neighbours of a canopy cell can be higher than it or not."""
    counts = np.zeros(256)
    for block in blocks:
        middle = block[1:-1, 1:-1]
        code = sum((cells > middle).astype(int) << bit for bit, cells in enumerate(_neighbours(block)))
        counts += np.bincount(code[canopy(middle)], minlength=256)
    return counts / max(counts.sum(), 1)


def divergence(p, q):
    """Jensen–Shannon divergence of two distributions, in nats: 0 alike, ln 2 disjoint."""
    middle = (p + q) / 2
    part = lambda a: np.sum(a[a > 0] * np.log(a[a > 0] / middle[a > 0]))
    return float((part(p) + part(q)) / 2)


def _neighbours(values):
    """The eight neighbours of the inner cells: (8, rows − 2, cols − 2)."""
    rows, cols = values.shape
    return np.stack([values[1 + r : rows - 1 + r, 1 + c : cols - 1 + c] for r, c in NEIGHBOURS])


# Sets of canopies.


def likeness(a_m, b_m):
    """Overlap of two footprints (intersection over union) and r of two height maps: how far two seeds differ."""
    a, b = canopy(a_m), canopy(b_m)
    return {"iou": ratio(np.sum(a & b), np.sum(a | b)), "height_r": correlation(a_m, b_m)}


def nearest_patch_distance(blocks, training_m, side=16):
    """Root mean squared distance of squares of blocks to the likeliest square of the training canopy, averaged: in sqrt(h / 36 m).

    Every place of the training canopy is tried, as it lies and mirrored east to west. Far below a real held-out
    block's would mean copying.
    """
    queries = np.concatenate([_squares(encode_height(b), side, side) for b in blocks])
    length = np.sum(queries**2, axis=1)
    best = np.full(len(queries), np.inf)
    for source in (encode_height(training_m), encode_height(training_m)[:, ::-1]):
        for top in range(0, source.shape[0] - side + 1, 32):
            squares = _squares(source[top : top + 32 + side - 1], side, 1)
            near = np.sum(squares**2, axis=1)[None] - 2 * queries @ squares.T
            best = np.minimum(best, near.min(axis=1))
    # the encoding is twice the root
    return float(np.mean(np.sqrt(np.maximum(best + length, 0) / side**2)) / 2)


def _squares(values, side, step):
    view = np.lib.stride_tricks.sliding_window_view(values, (side, side))[::step, ::step]
    return np.ascontiguousarray(view.reshape(-1, side * side))


def cover_against(height_m, factors, sketch, side=8):
    """r of the cover of 8×8 cells with each factor, over all blocks: as it is, and within painted classes.

    Within classes means that from cover and factor the part is taken that the shares of the classes explain linearly.
    """
    cover = np.concatenate([block_means(canopy(b).astype(float), side).ravel() for b in height_m])
    shares = np.stack([np.concatenate([block_means((s == k).astype(float), side).ravel() for s in sketch]) for k in range(SKETCH_CLASSES)], 1)
    rest = lambda v: v - shares @ np.linalg.lstsq(shares, v, rcond=None)[0]
    found = {}
    for name, maps in factors.items():
        factor = np.concatenate([block_means(m, side).ravel() for m in maps])
        found[name] = {"r": correlation(cover, factor), "r_within_class": correlation(rest(cover), rest(factor))}
    return found
