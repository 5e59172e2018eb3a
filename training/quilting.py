"""Guided image quilting: canopy sewn together from patches of a real one. The reference for texture.

After Efros and Freeman 2001, "Image Quilting for Texture Synthesis and Transfer", https://doi.org/10.1145/383259.383296.
"""

import numpy as np
from scipy import fft

from dataset import MAX_HEIGHT_M, encode_height, one_hot

OVERLAP_CELLS = 6
TOLERANCE = 0.1
"""Patches within this share of the least error are drawn from (Efros and Freeman 2001)."""


class Quilter:
    """A real canopy with its sketch, ready to be cut into patches."""

    def __init__(self, height_m, sketch, patch, weight, overlap=OVERLAP_CELLS):
        self.patch, self.overlap, self.weight = patch, overlap, weight
        self.source = encode_height(height_m)
        self.shape = tuple(fft.next_fast_len(n, real=True) for n in self.source.shape)
        transform = lambda a: fft.rfft2(a.astype(np.float32), self.shape)
        self.of_height, self.of_square = transform(self.source), transform(self.source**2)
        self.of_sketch = [transform(k) for k in one_hot(sketch)]
        self.rows, self.cols = (n - patch + 1 for n in self.source.shape)

    def sew(self, sketch, seed):
        """Canopy height, metres, over a sketch, in the sketch's shape. The seed alone decides which of like patches is taken."""
        rng = np.random.default_rng([seed, 24])
        step, patch = self.patch - self.overlap, self.patch
        size = tuple(patch + step * max(0, -(-(n - patch) // step)) for n in sketch.shape)
        wanted = np.pad(sketch, [(0, m - n) for n, m in zip(sketch.shape, size)], mode="edge")
        sewn = np.zeros(size, np.float32)
        for row in range(0, size[0] - patch + 1, step):
            for col in range(0, size[1] - patch + 1, step):
                at = np.s_[row : row + patch, col : col + patch]
                old = sewn[at]
                known = np.zeros((patch, patch), np.float32)
                known[: self.overlap if row else 0] = 1.0
                known[:, : self.overlap if col else 0] = 1.0
                new = self._patch(old, known, wanted[at], rng)
                sewn[at] = np.where(self._kept(old, new, row > 0, col > 0), old, new)
        return (MAX_HEIGHT_M * ((sewn[: sketch.shape[0], : sketch.shape[1]] + 1.0) / 2.0) ** 2).astype(np.float32)

    def _patch(self, old, known, sketch, rng):
        """One patch that suits what is sewn already and what is painted: error of both, at every place of the source at once."""
        overlapping = max(float(known.sum()), 1.0)
        term = lambda kernel: np.conj(fft.rfft2(kernel.astype(np.float32), self.shape))
        kernels = [known / overlapping, -2.0 * known * old / overlapping]
        kernels += [-self.weight * k / self.patch**2 for k in one_hot(sketch)]
        sources = [self.of_square, self.of_height, *self.of_sketch]
        total = sum(term(k) * s for k, s in zip(kernels, sources) if np.any(k))
        error = fft.irfft2(total, self.shape)[: self.rows, : self.cols]
        # constant parts of both errors, so that the least possible is 0
        error = np.maximum(error + float(np.sum(known * old**2)) / overlapping + self.weight, 0.0)
        likely = np.flatnonzero(error <= error.min() * (1 + TOLERANCE) + 1e-5)
        row, col = divmod(int(rng.choice(likely)), self.cols)
        return self.source[row : row + self.patch, col : col + self.patch]

    def _kept(self, old, new, above, beside):
        """Cells of the patch that stay as they were: those before the seam of least difference."""
        kept = np.zeros(old.shape, bool)
        difference = (old - new) ** 2
        columns = np.arange(self.overlap)
        if beside:
            kept[:, : self.overlap] |= columns[None] < _seam(difference[:, : self.overlap])[:, None]
        if above:
            kept[: self.overlap] |= columns[:, None] < _seam(difference[: self.overlap].T)[None]
        return kept


def _seam(cost):
    """Column of the cheapest way from the first row to the last, a step to the side at most."""
    total = cost.astype(np.float64)
    for i in range(1, len(total)):
        padded = np.pad(total[i - 1], 1, constant_values=np.inf)
        total[i] += np.minimum(np.minimum(padded[:-2], padded[2:]), padded[1:-1])
    path = np.empty(len(total), int)
    path[-1] = np.argmin(total[-1])
    for i in range(len(total) - 2, -1, -1):
        low = max(path[i + 1] - 1, 0)
        path[i] = low + np.argmin(total[i, low : path[i + 1] + 2])
    return path
