"""What the generators are asked for besides fooling the critics."""

import math

import numpy as np
import torch
from torch.nn import functional

from dataset import CANOPY_M, PLAIN_STYLE
from networks import decode_height

LAGS_CELLS = (1, 2, 3, 4, 8)
SKETCH_MARGIN = 0.03


def soft_footprint(height_m):
    """Canopy or not, 0 to 1, with a slope to learn from: (batch, 1, rows, cols)."""
    return torch.sigmoid((height_m - CANOPY_M) / 0.6)


def gaussian_blur(x, cells):
    """Gaussian blur with the border repeated; x is (batch, 1, rows, cols)."""
    reach = math.ceil(3 * cells)
    kernel = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, device=x.device) / cells) ** 2)
    kernel = kernel / kernel.sum()
    x = functional.pad(x, (reach, reach, reach, reach), mode="replicate")
    x = functional.conv2d(x, kernel[None, None, None])
    return functional.conv2d(x, kernel[None, None, :, None])


def sketch_hinge(height_m, sketch, limits):
    """How far the local cover lies outside the interval of the painted class.

    `sketch` is one-hot; `limits` holds each sample's cover below which is empty and above which is dense: (batch, 2).
    """
    cover = gaussian_blur(soft_footprint(height_m), PLAIN_STYLE.blur_cells)
    empty, sparse, dense = sketch[:, :1], sketch[:, 1:2], sketch[:, 2:]
    empty_below, dense_above = limits[:, 0, None, None, None], limits[:, 1, None, None, None]
    low = sparse * (empty_below + SKETCH_MARGIN) + dense * (dense_above + SKETCH_MARGIN)
    high = empty * empty_below + sparse * dense_above + dense * 2.0 - SKETCH_MARGIN
    violation = functional.relu(low - cover) + functional.relu(cover - high)
    # each class weighs alike, however little of it there is
    shares = sketch.mean((2, 3), keepdim=True)
    weight = (sketch / (shares + 0.05)).sum(1, keepdim=True)
    return 4.0 * (violation * weight).mean() / weight.mean()


def block_means(height_m, target_m):
    """Differences of cover and of height/10 over blocks of 8 and 16 cells."""
    loss = 0.0
    for block in (8, 16):
        pool = lambda x: functional.avg_pool2d(x, block)
        loss = loss + (pool(soft_footprint(height_m)) - pool(soft_footprint(target_m))).abs().mean()
        loss = loss + (pool(height_m) - pool(target_m)).abs().mean() / 10.0
    return loss


def variogram(height_m, target_m, window=24):
    """Differences of half mean squared height steps at several lags, over windows of 24 cells."""
    loss = 0.0
    pool = lambda x: torch.sqrt(functional.avg_pool2d(x, window, window // 2) + 0.5)
    for lag in LAGS_CELLS:
        for axis in (2, 3):
            steps = []
            for h in (height_m, target_m):
                n = h.shape[axis]
                steps.append(0.5 * (h.narrow(axis, lag, n - lag) - h.narrow(axis, 0, n - lag)) ** 2)
            loss = loss + (pool(steps[0]) - pool(steps[1])).abs().mean() / 10.0
    return loss / 2.0


class Sorted(torch.autograd.Function):
    """Values in order along the last axis. numpy sorts several times faster than torch on a CPU."""

    @staticmethod
    def forward(context, values):
        if not context.needs_input_grad[0] and values.device.type == "cpu":
            return torch.from_numpy(np.sort(values.numpy(), axis=-1))
        if values.device.type == "cpu":
            order = torch.from_numpy(np.argsort(values.numpy(), axis=-1))
            ordered = values.gather(-1, order)
        else:
            ordered, order = values.sort(dim=-1)
        context.save_for_backward(order)
        return ordered

    @staticmethod
    def backward(context, grad):
        (order,) = context.saved_tensors
        return torch.empty_like(grad).scatter_(-1, order, grad)


class SlicedWasserstein:
    """Distance between the squares of two pictures as sets, whatever their order: by sorted responses to random filters.

    Each sample is compared with its own target, so that a savanna is held to savannas. Squares are of 3 and 5 cells,
    and of 3 cells two and four apart (after Heitz et al. 2021, who use features of a network in place of squares).
    """

    SQUARES = ((3, 1), (5, 1), (3, 2), (3, 4))

    def __init__(self, seed, filters=12, every=5):
        self.generator = torch.Generator().manual_seed(seed)
        self.filters, self.every = filters, every

    def __call__(self, encoded, target):
        loss = 0.0
        both = torch.cat([encoded, target])
        for size, dilation in self.SQUARES:
            kernels = torch.randn(self.filters, 1, size, size, generator=self.generator)
            # most filters ask for contrast within the square, a few for its level
            kernels[self.filters // 4 :] -= kernels[self.filters // 4 :].mean((2, 3), keepdim=True)
            kernels = kernels / kernels.flatten(1).norm(dim=1)[:, None, None, None]
            responses = functional.conv2d(both, kernels.to(both), dilation=dilation).flatten(2)
            first = int(torch.randint(self.every, (1,), generator=self.generator))
            made, real = responses[:, :, first :: self.every].chunk(2)
            loss = loss + (Sorted.apply(made) - Sorted.apply(real.detach())).abs().mean()
        return loss / len(self.SQUARES)


def levels(height_m, target_m):
    """Distance between the heights of each sample and its target as sets, in units of 10 m: the earth mover's."""
    return (Sorted.apply(height_m.flatten(1)) - Sorted.apply(target_m.flatten(1))).abs().mean() / 10.0


def adversarial(logits_of_made):
    """What a generator loses where the critics see through it (non-saturating)."""
    return sum(functional.softplus(-x).mean() for x in logits_of_made)


def critic_loss(logits_of_real, logits_of_made):
    return sum(functional.softplus(-r).mean() + functional.softplus(m).mean() for r, m in zip(logits_of_real, logits_of_made))


def gradient_penalty(logits_of_real, real):
    """R1: squared gradient of the critics at real samples (Mescheder et al. 2018)."""
    total = sum(x.sum() for x in logits_of_real)
    (grad,) = torch.autograd.grad(total, real, create_graph=True)
    return grad.square().sum((1, 2, 3)).mean()


