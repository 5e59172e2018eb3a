"""The generators and the critics."""

import torch
from torch import nn
from torch.nn import functional

from dataset import CANOPY_M, MAX_HEIGHT_M

DEPTH = 4
STRIDE = 2**DEPTH
"""Maps handed to a generator have sides that are multiples of this."""

HALO = 48
"""Cells beside a map that can change a cell of it; `receptive_field` measures 46, export checks it."""

MARGINS = (4, 8, 16, 32)
"""Cells beside a map that each level of the decoder, the finest first, is worked out on where a halo is left out: what the
next finer level needs, and a ring that the convolution's border spoils."""


def cut(x, cells):
    """A map without so many cells at each side."""
    return x[:, :, cells:-cells, cells:-cells] if cells else x


def unit_features(x):
    """Each cell's features brought to unit mean square: no statistics of the map enter, so tiles know nothing of each other."""
    return x * torch.rsqrt((x * x).mean(1, keepdim=True) + 1e-6)


ENCODED_CANOPY = 2.0 * (CANOPY_M / MAX_HEIGHT_M) ** 0.5 - 1.0
"""The threshold of canopy, encoded."""


class UNet(nn.Module):
    """U-Net of four halvings. Noise enters at every level, averaged down with its deviation kept."""

    def __init__(self, channels, features=24):
        super().__init__()
        self.bfloat16 = False
        widths = [features, 2 * features, 3 * features, 3 * features]
        self.down = nn.ModuleList()
        inward = channels + 1
        for width in widths:
            self.down.append(nn.Conv2d(inward, width, 4, 2, 1))
            inward = width + 1
        self.up = nn.ModuleList()
        inward = widths[-1] + 1
        for level in reversed(range(DEPTH)):
            skip = widths[level - 1] if level else channels
            width = widths[level - 1] if level else features
            self.up.append(nn.Conv2d(inward + skip + (1 if level == 0 else 0), width, 3, 1, 1))
            inward = width
        self.last = nn.Conv2d(features, 1, 3, 1, 1)

    def forward(self, x, noise, halo=0):
        """One channel: (batch, 1, rows, cols), without the halo where there is one, 0 or HALO."""
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self.bfloat16):
            x = self.features(x, noise, halo)
        return cut(self.last(x.float()), MARGINS[0] if halo else 0)

    def features(self, x, noise, halo):
        skips, noises = [x], [noise]
        for layer in self.down:
            x = functional.leaky_relu(unit_features(layer(torch.cat([x, noise], 1))), 0.2)
            noise = 2.0 * functional.avg_pool2d(noise, 2)
            skips.append(x)
            noises.append(noise)
        x = torch.cat([x, noise], 1)
        for i, layer in enumerate(self.up):
            level = DEPTH - 1 - i
            skip = [skips[level]] + ([noises[0]] if level == 0 else [])
            if halo:
                # finer levels see less far: they are worked out where they count
                margin, before = MARGINS[level], MARGINS[level + 1] if level + 1 < DEPTH else halo
                x = cut(x, (before - margin) // 2 ** (level + 1))
                skip = [cut(s, (halo - margin) // 2**level) for s in skip]
            x = functional.interpolate(x, scale_factor=2, mode="nearest")
            x = torch.cat([x, *skip], 1)
            x = functional.leaky_relu(unit_features(layer(x)), 0.2)
        return x


class FootprintGenerator(nn.Module):
    """Sketch (3), terrain (3), stand height (1) and noise become a canopy; where it is above 3 m is the footprint.

    Trained on heights, not on a mask: a critic tells any mask with soft edges from a real one, and heights teach where
    crowns end.
    """

    CONDITIONS = 7

    def __init__(self, features=24):
        super().__init__()
        self.net = UNet(self.CONDITIONS, features)

    def forward(self, conditions, noise, halo=0):
        """Encoded height, −1 to 1: (batch, 1, rows, cols), without the halo."""
        return kept_empty(torch.tanh(self.net(conditions, noise, halo)), conditions[:, :1], halo)


class HeightGenerator(nn.Module):
    """Footprint (1), terrain (3), stand height (1) and noise become canopy height: above 3 m in the footprint, below outside."""

    CONDITIONS = 5

    def __init__(self, features=24):
        super().__init__()
        self.net = UNet(self.CONDITIONS, features)

    def forward(self, conditions, noise, halo=0):
        """Encoded height, −1 to 1: (batch, 1, rows, cols), without the halo."""
        x = self.net(conditions, noise, halo)
        # the slope is that of the encoding from the threshold up, so that low canopy is learnt as well as high
        inside = ENCODED_CANOPY + 0.002 + functional.softplus(20.0 * x) / 20.0
        outside = -1.0 + (ENCODED_CANOPY + 0.998) * torch.sigmoid(4.0 * x)
        return torch.where(cut(conditions[:, :1], halo) > 0.5, inside.clamp(max=1.0), outside)


def kept_empty(encoded, painted_empty, halo=0):
    """Encoded heights without canopy where painted empty, but for a fringe of one cell beside other paint."""
    may_grow = cut(functional.max_pool2d(1.0 - painted_empty, 3, 1, 1), halo)
    return torch.where(may_grow > 0.5, encoded, encoded.clamp(max=ENCODED_CANOPY - 0.02))


def decode_height(encoded):
    """Encoded height to metres."""
    return MAX_HEIGHT_M * ((encoded + 1.0) / 2.0) ** 2


GENERATORS = {"footprint": FootprintGenerator, "height": HeightGenerator}


class Critic(nn.Module):
    """PatchGAN that looks at squares of 24 cells, or, after averaging, 96.

    The first layer keeps every cell: critics that halve at once stay blind to the texture for thousands of steps.
    """

    def __init__(self, channels, features=32, averaged=1):
        super().__init__()
        self.averaged = averaged
        self.bfloat16 = False
        self.layers = nn.Sequential(
            nn.Conv2d(channels, features // 2, 3, 1, 1),
            nn.LeakyReLU(0.2),
            nn.Conv2d(features // 2, 3 * features // 2, 4, 2, 1),
            nn.LeakyReLU(0.2),
            nn.Conv2d(3 * features // 2, 2 * features, 3, 1, 1),
            nn.LeakyReLU(0.2),
            nn.Conv2d(2 * features, 3 * features, 4, 2, 1),
            nn.LeakyReLU(0.2),
            nn.Conv2d(3 * features, 1, 3, 1, 1),
        )
        for layer in self.layers[::2]:
            nn.init.kaiming_normal_(layer.weight, a=0.2)
            nn.init.zeros_(layer.bias)

    def forward(self, x):
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self.bfloat16):
            return self.layers(functional.avg_pool2d(x, self.averaged) if self.averaged > 1 else x).float()


class Critics(nn.Module):
    """Two critics, of texture and of stands."""

    def __init__(self, conditions, features=32):
        super().__init__()
        self.critics = nn.ModuleList([Critic(conditions + 2, features), Critic(conditions + 2, features, averaged=4)])

    def forward(self, conditions, encoded):
        edge = torch.sigmoid((decode_height(encoded) - CANOPY_M) / 0.6)
        seen = torch.cat([conditions, encoded, edge], 1)
        return [critic(seen) for critic in self.critics]


def receptive_field(generator):
    """Farthest distance, in cells, from which an input can change an output, over all alignments to the stride."""
    size, middle = 20 * STRIDE, 10 * STRIDE
    conditions = torch.rand(1, generator.CONDITIONS, size, size, requires_grad=True)
    noise = torch.rand(1, 1, size, size, requires_grad=True)
    reach = 0
    for offset in (0, STRIDE // 2, STRIDE - 1):
        at = middle + offset
        grads = torch.autograd.grad(generator(conditions, noise)[0, 0, at, at], [conditions, noise])
        for grad in grads:
            rows = grad.abs().sum((0, 1, 3)).nonzero().ravel()
            reach = max(reach, at - int(rows.min()), int(rows.max()) - at)
    return reach
