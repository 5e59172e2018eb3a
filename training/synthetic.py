"""Forests that the project plants itself: terrain, painted strokes, and stands that follow the terrain within each stroke.

Real pairs at hand hold almost no sign of terrain beyond the sketch. These squares teach what a forester expects: riparian
strips in hollows, thinner and lower canopy on crests and steep sunny slopes, bare cliffs, edges and gaps.
"""

import numpy as np
from scipy import ndimage
from skimage.morphology import reconstruction

from dataset import CELL_M, DENSE, EMPTY, SPARSE, Site

COVER_OF_CLASS = {EMPTY: (0.0, 0.0), SPARSE: (0.11, 0.33), DENSE: (0.40, 0.97)}
"""Cover on the worst and on the best ground of each painted class (share of cells; chosen within the sketch's intervals)."""


def noise(shape, rng, exponent, longest=None):
    """Smooth random field, mean 0, deviation 1, power falling with frequency to the given exponent."""
    rows, cols = (np.fft.fftfreq(n)[:, None] if i == 0 else np.fft.rfftfreq(n)[None] for i, n in enumerate(shape))
    frequency = np.hypot(rows, cols)
    frequency[0, 0] = 1.0
    amplitude = frequency ** (-exponent / 2)
    amplitude[0, 0] = 0.0
    if longest:
        amplitude = np.where(frequency < 1 / longest, 0.0, amplitude)
    field = np.fft.irfft2(amplitude * np.exp(2j * np.pi * rng.random(amplitude.shape)), s=shape)
    return field / field.std()


def terrain(shape, rng):
    """Hills with carved valleys, metres. From gently rolling to mountain ground."""
    relief_m = np.exp(rng.uniform(np.log(6), np.log(90)))
    hills = noise(shape, rng, rng.uniform(3.0, 3.8))
    ridges = -np.abs(noise(shape, rng, 3.4))
    height = relief_m * (hills + rng.uniform(0, 0.8) * ridges)
    # valleys: ground sinks with the logarithm of the water that gathers
    for _ in range(2):
        water = drained_cells(height)
        height = height - 0.07 * relief_m * ndimage.gaussian_filter(np.log(water), 2.0) * rng.uniform(0.3, 1.0)
    height += 0.3 * noise(shape, rng, 2.2)
    if rng.random() < 0.5:
        rows, cols = np.mgrid[: shape[0], : shape[1]]
        direction = rng.uniform(0, 2 * np.pi)
        height += rng.uniform(0, 0.35) * CELL_M * (np.cos(direction) * rows + np.sin(direction) * cols)
    return height


def drained_cells(height):
    """Cells whose water passes each cell, by steepest descent on the filled surface."""
    seed = height.copy()
    seed[1:-1, 1:-1] = height.max()
    filled = reconstruction(seed, height, method="erosion") + 1e-4 * ndimage.gaussian_filter(height, 3)
    rows, cols = filled.shape
    padded = np.pad(filled, 1, constant_values=np.inf)
    steps = [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]
    drops = np.stack([(filled - padded[1 + r : 1 + r + rows, 1 + c : 1 + c + cols]) / np.hypot(r, c) for r, c in steps])
    best = drops.argmax(0)
    offsets = np.array([r * cols + c for r, c in steps])
    target = (np.arange(rows * cols) + offsets[best.ravel()]).tolist()
    falls = (drops.max(0) > 0).ravel().tolist()
    water = [1.0] * (rows * cols)
    for cell in np.argsort(-filled, axis=None).tolist():
        if falls[cell]:
            water[target[cell]] += water[cell]
    return np.array(water).reshape(rows, cols)


def site_quality(height):
    """How well ground suits trees, about −2 to 2: moist hollows and shaded slopes above, crests, steep and sunny ground below."""
    north, east = np.gradient(height, CELL_M)
    slope = np.hypot(north, east)
    wetness = np.log(ndimage.gaussian_filter(drained_cells(height), 1.0) / (slope + 0.03))
    wetness = (wetness - np.median(wetness)) / 2.5
    # rows run south, so that ground falling northward has a positive gradient
    shade = north / np.sqrt(1 + slope**2)
    crest = (height - ndimage.gaussian_filter(height, 12)) / 8.0
    cliff = np.clip((slope - 0.9) / 0.3, 0, 3)
    return np.clip(1.0 * np.clip(wetness, -1, 2) + 2.0 * shade - np.clip(crest, -1, 2.5) - cliff, -3, 3)


def sketch(shape, rng):
    """Strokes with soft borders: a smooth field cut at two levels."""
    field = ndimage.gaussian_filter(noise(shape, rng, 3.0, longest=rng.uniform(60, 200)), rng.uniform(2, 7))
    low, high = np.quantile(field, np.sort(rng.uniform(0, 1, 2)))
    return np.where(field < low, EMPTY, np.where(field > high, DENSE, SPARSE)).astype(np.uint8)


def plant(painted, quality, stand_m, rng):
    """Canopy height of a planted forest, metres at 4 m cells: crowns thrown at random against the cover each place is to have."""
    fine = 2
    shape = tuple(n * fine for n in painted.shape)
    upscale = lambda a: a.repeat(fine, 0).repeat(fine, 1)
    good = 1 / (1 + np.exp(-1.6 * quality + rng.normal(0, 0.5) + 0.6 * noise(painted.shape, rng, 1.5)))
    cover = np.zeros(painted.shape)
    for kind, (worst, best) in COVER_OF_CLASS.items():
        cover = np.where(painted == kind, worst + (best - worst) * good, cover)
    cover = ndimage.gaussian_filter(cover, 1.0)
    radius_per_height = rng.uniform(0.16, 0.30)
    spread = rng.uniform(0.15, 0.35)
    radius_m = np.clip(radius_per_height * stand_m, 1.2, 7.0)
    # of discs thrown at random, exp(−density·area) of the ground stays bare
    expected = -np.log1p(-np.clip(cover, 0, 0.985)) / (np.pi * radius_m**2) * CELL_M**2
    rows, cols = np.divmod(np.repeat(np.arange(painted.size), rng.poisson(expected).ravel()), painted.shape[1])
    height = stand_m[rows, cols] * np.exp(rng.normal(-spread**2 / 2, spread, rows.size))
    radius = np.clip(radius_per_height * height, 0.9, 8.0) / (CELL_M / fine)
    row, col = (rows + rng.random(rows.size)) * fine, (cols + rng.random(rows.size)) * fine
    surface = ndimage.gaussian_filter(np.abs(rng.normal(0, 0.25, shape)), 1.0)
    reach = int(np.ceil(radius.max())) if rows.size else 0
    for d_row in range(-reach, reach + 1):
        for d_col in range(-reach, reach + 1):
            at_row, at_col = np.floor(row).astype(int) + d_row, np.floor(col).astype(int) + d_col
            away = np.hypot(at_row + 0.5 - row, at_col + 0.5 - col) / radius
            hit = (away < 1) & (at_row >= 0) & (at_row < shape[0]) & (at_col >= 0) & (at_col < shape[1])
            np.maximum.at(surface, (at_row[hit], at_col[hit]), height[hit] * (1 - 0.45 * away[hit] ** 2))
    return surface.reshape(painted.shape[0], fine, painted.shape[1], fine).mean((1, 3))


def site(size, seed):
    """One planted square as a site whose sketch was painted before the forest grew."""
    rng = np.random.default_rng([seed, 77])
    shape = (size, size)
    height = terrain(shape, rng)
    quality = site_quality(height)
    painted = sketch(shape, rng)
    typical = np.exp(rng.uniform(np.log(4.5), np.log(30)))
    stand_m = typical * np.exp(0.2 * noise(shape, rng, 2.5) + 0.12 * quality)
    chm = plant(painted, quality, np.clip(stand_m, 3.5, 33), rng)
    return Site(f"planted {seed}", CELL_M, height, chm, np.ones(shape, bool), np.zeros(shape, bool), painted)


def sites(count, size=192, first_seed=0):
    return [site(size, first_seed + i) for i in range(count)]
