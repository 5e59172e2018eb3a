"""Held-out figures and sheets: `python evaluate.py --footprint runs/footprint --height runs/height --out figures`.

Several runs of each network count as training seeds, paired in order. Figures are means over them and over noise seeds.
What is written: figures.json (all of it, with spreads), figures.md (tables beside the bars), sheet.png.
"""

import argparse
import dataclasses
import json
import pathlib
import time
import zlib

import numpy as np
from scipy import ndimage

import measures
import synthetic
from dataset import CANOPY_M, EMPTY, SKETCH_CLASSES, TRAINED_M, at_stand_height, brush_sketch, derive_sketch, encode_height, one_hot, read_pair, read_pairs
from networks import GENERATORS, HALO, STRIDE, decode_height
from quilting import Quilter

BLOCK_CELLS = 96

BARS = {
    "agreement": ((0.93, None), (0.95, None)),
    "balanced": ((0.90, None), (0.88, None)),
    "cover_error": ((None, 0.03), (None, 0.03)),
    "maxima": ((0.9, 1.15), (0.9, 1.15)),
    "rumple": ((0.9, 1.1), (0.9, 1.1)),
    "variogram": ((None, 0.13), (None, 0.31)),
    "lag4": ((0.9, 1.1), (0.9, 1.1)),
    "gap_ks": ((None, 0.25), (None, 0.25)),
    "emd_m": ((None, 0.3), (None, 1.8)),
    "spectrum": ((None, 1.3), (None, 1.3)),
}
"""Least and most for the first and for the second site (issue 4, section 3)."""

BARS_GIVEN_STAND = BARS | {"emd_m": ((None, 0.3), (None, 0.5))}
NOTES_ORDER_JSD = (0.59, 0.46)
BARS_FOREIGN = {"agreement": ((0.94, None), (0.92, None))}

COLUMNS = {
    "cover_r": "cover r (8×8)",
    "agreement": "sketch agreement",
    "balanced": "balanced, pooled",
    "balanced_by_block": "balanced, by block",
    "cover_difference": "cover difference",
    "emd_m": "EMD >3 m, m",
    "maxima": "maxima ratio",
    "variogram": "variogram error",
    "lag4": "lag-4 m γ ratio",
    "gap_ks": "gap KS",
    "rumple": "rumple ratio",
    "spectrum": "spectrum peak / real",
    "pattern_jsd": "3×3 footprint JSD",
    "order_jsd": "3×3 height-order JSD",
}

SHIPPED, SHIPPED_TRUE_STAND = "two nets, generated stand height", "two nets, true stand height"


CARD_ROWS = {
    SHIPPED: "with a generated stand height",
    SHIPPED_TRUE_STAND: "with the true one",
    "quilting 16": "quilting",
    "real–real, any block": "real against real",
}


# Networks.


class Network:
    """A trained generator, from a run's folder, a checkpoint or an ONNX file, that takes maps of any size."""

    def __init__(self, path):
        path = pathlib.Path(path)
        path = path / "checkpoint.pt" if path.is_dir() else path
        self.path, self.step = str(path), None
        if path.suffix == ".onnx":
            import onnxruntime

            session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
            names = [i.name for i in session.get_inputs()]
            self.metres = lambda conditions, noise: session.run(None, dict(zip(names, (conditions[None], noise[None]))))[0][0, 0]
        else:
            import torch

            state = torch.load(path, map_location="cpu", weights_only=False)
            generator = GENERATORS[state["config"]["stage"]](state["config"]["features"])
            generator.load_state_dict(state["average"])
            generator.eval()
            self.step = state["step"]

            def metres(conditions, noise):
                with torch.no_grad():
                    return decode_height(generator(torch.from_numpy(conditions)[None], torch.from_numpy(noise)[None], HALO))[0, 0].numpy()

            self.metres = metres

    def __call__(self, conditions, seed):
        """Canopy height, metres, from conditions (channels, rows, cols). Borders are repeated as far as the network sees."""
        rows, cols = conditions.shape[1:]
        pad = [(0, 0)] + [(HALO, HALO + -(n + 2 * HALO) % STRIDE) for n in (rows, cols)]
        padded = np.ascontiguousarray(np.pad(conditions, pad, mode="edge"), np.float32)
        rng = np.random.default_rng(seed)
        noise = rng.uniform(-(3**0.5), 3**0.5, (1, *padded.shape[1:])).astype(np.float32)
        made_m = self.metres(padded, noise)
        if made_m.shape != tuple(n - 2 * HALO for n in padded.shape[1:]):
            raise SystemExit(f"{self.path}: does not leave its halo out: export it anew")
        return made_m[:rows, :cols].astype(np.float64)


@dataclasses.dataclass
class Chain:
    """The two networks as they are shipped, with the rule that empty ground stays empty."""

    footprint_net: Network
    height_net: Network | None

    def canopy(self, sketch, terrain, stand_m, seed):
        """Height by the first network alone, metres, nothing on empty ground; and the share of its canopy that the rule took."""
        made_m = self.footprint_net(np.concatenate([one_hot(sketch), terrain, encode_height(np.clip(stand_m, *TRAINED_M))[None]]), [seed, 1])
        out = (made_m > CANOPY_M) & ~may_grow(sketch)
        return np.where(out, 0.0, made_m), float(out.sum() / max((made_m > CANOPY_M).sum(), 1))

    def heights(self, footprint, terrain, stand_m, seed):
        """Height by the second network, metres, from a footprint."""
        stand = encode_height(np.clip(stand_m, *TRAINED_M))
        made_m = self.height_net(np.concatenate([footprint[None].astype(np.float32), terrain, stand[None]]), [seed, 2])
        return at_stand_height(made_m, footprint, stand_m)


def may_grow(sketch):
    """Cells that are painted sparse or dense, and a fringe of one cell."""
    return ndimage.binary_dilation(sketch != EMPTY, np.ones((3, 3)))


class StandField:
    """Stand heights for a place that nobody has measured: the mean of a site's training part, and its spectrum in another order."""

    def __init__(self, stand_m):
        self.logarithm = np.log(stand_m)
        self.mean, self.deviation = self.logarithm.mean(), self.logarithm.std()
        # mirrored, so that the spectrum holds no jump from border to border
        tiled = np.concatenate([self.logarithm, self.logarithm[::-1]]) - self.mean
        tiled = np.concatenate([tiled, tiled[:, ::-1]], axis=1)
        self.shape, self.amplitude = tiled.shape, np.abs(np.fft.rfft2(tiled))

    @property
    def mean_m(self):
        return float(np.exp(self.mean))

    def draw(self, shape, seed):
        """Stand height, metres, with phases drawn anew."""
        rng = np.random.default_rng([seed, 3])
        field = np.fft.irfft2(self.amplitude * np.exp(2j * np.pi * rng.random(self.amplitude.shape)), s=self.shape)
        # a field that is too small is repeated: its borders meet
        field = np.tile(field, [-(-n // m) for n, m in zip(shape, field.shape)])[: shape[0], : shape[1]]
        # the mean that is asked for is that of the map, as with a slider
        field = (field - field.mean()) * self.deviation / field.std()
        return np.exp(self.mean + field).astype(np.float32)


# Places.


def rectangle(mask):
    rows, cols = np.nonzero(mask)
    return np.s_[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]


def blocks_of(shape, along=0.25, across=0.5):
    """Adjacent blocks of 96² that fit: in the middle across the longer side, and a quarter of what is left over before them along it.

    The notes do not say where theirs lay; these give real blocks against real blocks nearly as there.
    """
    shares = (along, across) if shape[0] > shape[1] else (across, along)
    at = [int((n % BLOCK_CELLS) * share) for n, share in zip(shape, shares)]
    count = [n // BLOCK_CELLS for n in shape]
    starts = [[a + BLOCK_CELLS * i for i in range(n)] for a, n in zip(at, count)]
    return [np.s_[r : r + BLOCK_CELLS, c : c + BLOCK_CELLS] for r in starts[0] for c in starts[1]]


class Place:
    """The held-out part of a site as a user would meet it: terrain and a sketch, and what stands there to compare with."""

    def __init__(self, site):
        self.name, self.site = site.name, site
        self.inside = rectangle(site.held_out)
        self.training = site.part(*rectangle(~site.held_out))
        self.chm_m, self.stand_m = site.chm_m[self.inside], site.stand_m[self.inside]
        self.dtm_m, self.terrain = site.dtm_m[self.inside], site.terrain[(slice(None), *self.inside)]
        self.footprint = site.footprint[self.inside]
        self.sketch = derive_sketch(self.footprint)
        self.blocks = blocks_of(self.chm_m.shape)
        self.field = StandField(self.training.stand_m)

    def cut(self, values):
        return [values[block] for block in self.blocks]

    def score(self, made_m):
        """All figures of a canopy over the whole place."""
        return self.score_blocks(self.cut(made_m), self.cut(derive_sketch(measures.canopy(made_m))))

    def score_blocks(self, made, sketches_made):
        return score(made, self.cut(self.chm_m), sketches_made, self.cut(self.sketch))


def score(made, real, sketches_made, sketches):
    each = [measures.figures(*four) for four in zip(made, real, sketches_made, sketches)]
    found = {name: float(np.nanmean([e[name] for e in each])) for name in each[0]}
    found |= measures.pooled_figures(made, real, sketches_made, sketches)
    found["cover_error"] = abs(found["cover_difference"])
    return found


def real_against_real(place):
    """Figures of real training blocks in the place of held-out ones: any, and the two likest by their shares of classes."""
    training = place.training
    rows, cols = (range(0, n - BLOCK_CELLS + 1, BLOCK_CELLS) for n in training.chm_m.shape)
    cells = [np.s_[r : r + BLOCK_CELLS, c : c + BLOCK_CELLS] for r in rows for c in cols]
    blocks = [training.chm_m[c] for c in cells]
    sketches = [derive_sketch(measures.canopy(b)) for b in blocks]
    take = lambda chosen: place.score_blocks([blocks[i] for i in chosen], [sketches[i] for i in chosen])
    count = len(place.blocks)
    # every training block once in every place
    any_block = [take([(i + k * max(1, len(blocks) // count)) % len(blocks) for k in range(count)]) for i in range(len(blocks))]
    shares = lambda sketch: np.bincount(sketch.ravel(), minlength=SKETCH_CLASSES) / sketch.size
    near = [np.argsort([np.abs(shares(s) - shares(wanted)).sum() for s in sketches], kind="stable")[:2] for wanted in place.cut(place.sketch)]
    pairs = [measures.likeness(a, b) for a, chosen in zip(place.cut(place.chm_m), near) for b in (blocks[i] for i in chosen)]
    alike = {name: float(np.mean([p[name] for p in pairs])) for name in pairs[0]}
    return any_block, [take([n[i] for n in near]) for i in range(2)], alike


# Summaries.


def summary(by_training_seed):
    """Mean of every figure, its spread over noise seeds and over training seeds, from [training seed][noise seed] of figures."""
    found = {}
    for name in by_training_seed[0][0]:
        values = [[run[name] for run in runs] for runs in by_training_seed]
        means = [float(np.nanmean(v)) for v in values]
        found[name] = {
            "mean": float(np.mean(means)),
            "noise_spread": float(np.mean([np.std(v) for v in values])),
            "training_spread": float(np.std(means)) if len(means) > 1 else None,
        }
    return found


def mean_of(found):
    return {name: float(np.nanmean([f[name] for f in found])) for name in found[0]}


# What is asked besides likeness.


def foreign(place, chains, seeds):
    """Strokes of no real forest over held-out terrain: agreement, balanced agreement and cover of each class."""
    found = []
    for chain in chains:
        runs = []
        for seed in range(seeds):
            rng = np.random.default_rng([seed, 4, zlib.crc32(place.name.encode())])
            sketches, made, taken = [], [], []
            for block in place.blocks:
                sketch = brush_sketch((BLOCK_CELLS, BLOCK_CELLS), rng)
                stand = np.full(sketch.shape, place.field.mean_m, np.float32)
                height, share = chain.canopy(sketch, place.terrain[(slice(None), *block)], stand, seed)
                sketches.append(sketch), made.append(measures.canopy(height)), taken.append(share)
            again = [derive_sketch(m) for m in made]
            all_sketches, all_made = np.stack(sketches), np.stack(made)
            cover = {f"cover_{name}": float(all_made[all_sketches == k].mean()) for k, name in enumerate(("empty", "sparse", "dense"))}
            agreement, balanced = measures.agreement(np.stack(again), all_sketches), measures.balanced_agreement(np.stack(again), all_sketches)
            runs.append({"agreement": agreement, "balanced": balanced, **cover, "taken_by_rule": float(np.mean(taken))})
        found.append(runs)
    return summary(found)


def terrain_response(chains, count, stand_m, noise_seeds):
    """Does ground decide where trees stand within a painted class? On planted forests that no training has seen.

    Cover is blurred by 2 cells. `r` is with the quality of the ground, `contrast` is cover on the best third less that on
    the worst. `moved` is how far the cover of one sketch moves where terrain is exchanged, `moved_by_noise` where only the
    seed is; `moved_r` is how that move goes with the difference of quality.
    """
    sites = synthetic.sites(count, size=192, first_seed=900000)
    grounds = [synthetic.site_quality(s.dtm_m) for s in sites]
    blur = lambda footprint: ndimage.gaussian_filter(footprint.astype(float), 2.0, mode="nearest")

    def within(cover, quality, sketch):
        rs, contrasts = [], []
        for k in range(1, SKETCH_CLASSES):
            inside = ndimage.binary_erosion(sketch == k, iterations=3)
            if inside.sum() >= 1500:
                rs.append(measures.correlation(cover[inside], quality[inside]))
                low, high = np.quantile(quality[inside], (1 / 3, 2 / 3))
                contrasts.append(cover[inside & (quality >= high)].mean() - cover[inside & (quality <= low)].mean())
        return {"r": float(np.nanmean(rs)), "contrast": float(np.mean(contrasts))} if rs else None

    found = {"planted": [], "generated": [], "generated, other terrain": [], "exchange": []}
    for i, (site, quality) in enumerate(zip(sites, grounds)):
        painted = site.sketch != EMPTY
        truth = within(blur(site.footprint), quality, site.sketch)
        if truth is None:
            continue
        found["planted"].append(truth)
        other = (i + 1) % count
        stand = np.full(site.sketch.shape, stand_m, np.float32)
        for chain in chains:
            made = lambda terrain, seed: blur(measures.canopy(chain.canopy(site.sketch, terrain, stand, seed)[0]))
            here, there = [made(site.terrain, n) for n in range(max(2, noise_seeds))], made(sites[other].terrain, 0)
            found["generated"] += [within(h, quality, site.sketch) for h in here]
            found["generated, other terrain"].append(within(there, quality, site.sketch))
            moved = (there - here[0])[painted]
            found["exchange"].append({
                "moved": float(np.abs(moved).mean()),
                "moved_by_noise": float(np.abs(here[1] - here[0])[painted].mean()),
                "moved_r": measures.correlation(moved, (grounds[other] - quality)[painted]),
            })
    return {name: mean_of(values) for name, values in found.items() if values}


def terrain_factors(site, inside):
    """Slope, aspect and moisture of the ground: slope_rad, northness and eastness of the fall, logarithm of the cells drained."""
    south, east = np.gradient(site.dtm_m, site.cell_m)
    steep = np.hypot(south, east)
    return {
        "slope": np.arctan(steep)[inside],
        "northness": (south / (steep + 1e-6))[inside],
        "eastness": (-east / (steep + 1e-6))[inside],
        "moisture": np.log(synthetic.drained_cells(site.dtm_m))[inside],
    }


def unseen(specification, chains, noise_seeds):
    """Figures of a site that no training has seen, as one block: with its mean stand height as a user would set it, and with the true map."""
    name, dtm, chm = specification.split(":")
    site = read_pair(dtm, chm, name)
    found = {"cells": list(site.chm_m.shape), "cover": float(site.footprint.mean()), "stand_height_m": float(np.mean(site.chm_m[site.footprint]))}
    shares = np.bincount(site.sketch.ravel(), minlength=SKETCH_CLASSES) / site.sketch.size
    found["class_shares"] = [float(s) for s in shares]
    hidden = lambda height: np.where(site.valid, height, 0.0)
    constant = np.full(site.chm_m.shape, found["stand_height_m"], np.float32)
    for label, stand in (("constant stand height", constant), ("true stand height", site.stand_m)):
        runs = []
        for chain in chains:
            runs.append([])
            for seed in range(noise_seeds):
                first, _ = chain.canopy(site.sketch, site.terrain, stand, seed)
                made = hidden(chain.heights(measures.canopy(first), site.terrain, stand, seed))
                runs[-1].append(score([made], [hidden(site.chm_m)], [derive_sketch(measures.canopy(made))], [site.sketch]))
        found[label] = summary(runs)
    return name, found


# Output.


def text_table(heads, rows):
    line = lambda cells: "| " + " | ".join(cells) + " |"
    return "\n".join([line(heads), line(["---"] * len(heads)), *map(line, rows)])


def number(value, digits=2):
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}"
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def by_site(found, name):
    return " / ".join(number(site[name]["mean"]) for site in found)


def judged(found, bars, sites):
    rows = []
    for name, limits in bars.items():
        values = [site[name]["mean"] for site in found]
        word = lambda value, least, most: "met" if (least is None or value >= least) and (most is None or value <= most) else "missed"
        interval = lambda least, most: f"≥ {least}" if most is None else f"≤ {most}" if least is None else f"{least}–{most}"
        cells = [f"{number(v, 3)} ({interval(*b)}: **{word(v, *b)}**)" for v, b in zip(values, limits)]
        rows.append([COLUMNS.get(name, "cover error"), *cells])
    return text_table(["figure", *sites], rows)


def order_bars(found):
    """Twice the height-order divergence of real blocks against real ones: as measured here or in the notes, whichever is less."""
    measured = [f["rows"]["real–real, any block"]["order_jsd"]["mean"] for f in found]
    return tuple((None, round(2 * min(m, n), 2)) for m, n in zip(measured, NOTES_ORDER_JSD))


def card_lines(found):
    """The shipped chain's figures beside those of its references, short enough for a model card: text by name."""
    if SHIPPED not in found[0]["rows"]:
        return {}
    lines = {}
    for name, title in COLUMNS.items():
        parts = [f"{by_site([f['rows'][row] for f in found], name)} {label}" for row, label in CARD_ROWS.items()]
        lines[title] = "; ".join(parts)
    lines["foreign sketch agreement"] = by_site([f["foreign"] for f in found], "agreement")
    return lines


def relief(dtm_m, cell_m):
    """Light from the north-west, 0 to 1."""
    south, east = np.gradient(dtm_m, cell_m)
    steep = 3.0 * np.stack([east, south])
    return np.clip((0.7 + 0.5 * (steep[0] + steep[1])) / np.sqrt(1 + np.sum(steep**2, 0)), 0, 1)


def sheet(pictures, path):
    """Columns of pictures, one for each block: lists of (row's title, picture, scale)."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap

    maps = {
        "relief": dict(cmap="gray", vmin=0, vmax=1),
        "sketch": dict(cmap=ListedColormap(["#efe6cf", "#a8c686", "#2f6b3a"]), vmin=0, vmax=2),
        "footprint": dict(cmap=ListedColormap(["#efe6cf", "#1d4d2b"]), vmin=0, vmax=1),
    }
    rows = len(pictures[0][1])
    figure, axes = plt.subplots(rows, len(pictures), figsize=(2.3 * len(pictures), 2.3 * rows + 0.3), squeeze=False)
    for number_of_block, (column, (title, parts, top_m)) in enumerate(zip(axes.T, pictures)):
        for i, (axis, (label, picture, kind)) in enumerate(zip(column, parts)):
            axis.imshow(picture, interpolation="nearest", **maps.get(kind, dict(cmap="viridis", vmin=0, vmax=top_m)))
            axis.set_xticks([]), axis.set_yticks([])
            if i == 0:
                axis.set_title(f"{title}, 0–{top_m:.0f} m", fontsize=9)
            if number_of_block == 0:
                axis.set_ylabel(label, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


# The whole.


def evaluate_place(place, chains, noise_seeds, quilting_seeds):
    """Everything that is measured on a held-out part: rows of figures, further findings, pictures."""
    rows, canopies = {}, {}
    any_block, alike, real_likeness = real_against_real(place)
    rows["real–real, any block"], rows["real–real, same sketch mix"] = summary([any_block]), summary([alike])
    for patch, weight in ((24, 1.0), (16, 4.0)):
        quilter = Quilter(place.training.chm_m, place.training.sketch, patch, weight)
        canopies[f"quilting {patch}"] = [[quilter.sew(place.sketch, seed) for seed in range(quilting_seeds)]]

    stands = {
        "generated": lambda seed: place.field.draw(place.chm_m.shape, seed),
        "constant": lambda seed: np.full(place.chm_m.shape, place.field.mean_m, np.float32),
        "true": lambda seed: place.stand_m,
    }
    first_by = lambda chain, stand: [chain.canopy(place.sketch, place.terrain, stand(seed), seed) for seed in range(noise_seeds)]
    first = {name: [first_by(chain, stand) for chain in chains] for name, stand in stands.items()}
    for name in ("generated", "true"):
        canopies[f"one net, {name} stand height"] = [[m for m, _ in runs] for runs in first[name]]
    if all(chain.height_net for chain in chains):
        for name, stand in stands.items():
            canopies[f"two nets, {name} stand height"] = [
                [chain.heights(measures.canopy(m), place.terrain, stand(seed), seed) for seed, (m, _) in enumerate(runs)] for chain, runs in zip(chains, first[name])
            ]
        canopies["height net, true footprint and stand height"] = [
            [chain.heights(place.footprint, place.terrain, place.stand_m, seed) for seed in range(noise_seeds)] for chain in chains
        ]
    for name, runs in canopies.items():
        rows[name] = summary([[place.score(m) for m in seeds] for seeds in runs])

    # diversity, memory, terrain
    shown = canopies.get(SHIPPED, canopies["one net, generated stand height"])
    two_seeds = lambda runs: mean_of([measures.likeness(a, b) for seeds in runs for a, b in zip(place.cut(seeds[0]), place.cut(seeds[1]))])
    real_blocks = place.cut(place.chm_m)
    more = {
        "taken_by_rule": float(np.mean([share for runs in first["generated"] for _, share in runs])),
        "diversity": {
            "generated, two seeds": two_seeds(shown) if noise_seeds > 1 else None,
            "quilting 16, two seeds": two_seeds(canopies["quilting 16"]),
            "real blocks of like sketch": real_likeness,
        },
        "nearest_training_patch": {
            "held-out real": measures.nearest_patch_distance(real_blocks, place.training.chm_m),
            "generated": float(np.mean([measures.nearest_patch_distance(place.cut(seeds[0]), place.training.chm_m) for seeds in shown])),
            "quilting 24": measures.nearest_patch_distance(place.cut(canopies["quilting 24"][0][0]), place.training.chm_m),
        },
    }
    factors = {name: place.cut(values) for name, values in terrain_factors(place.site, place.inside).items()}
    sketches = place.cut(place.sketch)
    runs = [measures.cover_against(place.cut(m), factors, sketches) for seeds in shown for m in seeds]
    more["cover_against"] = {
        "real": measures.cover_against(real_blocks, factors, sketches),
        "generated": {name: mean_of([r[name] for r in runs]) for name in factors},
    }

    pictures = []
    two = [*shown[0], shown[0][0]][:2]
    shade = relief(place.site.dtm_m, place.site.cell_m)[place.inside]
    for i, block in enumerate(place.blocks):
        parts = [
            ("terrain", shade[block], "relief"),
            ("sketch", place.sketch[block], "sketch"),
            ("true footprint", place.footprint[block], "footprint"),
            ("footprint", measures.canopy(two[0])[block], "footprint"),
            ("true height", place.chm_m[block], None),
            ("height, seed 0", two[0][block], None),
            ("height, seed 1", two[1][block], None),
            ("one net", canopies["one net, generated stand height"][0][0][block], None),
            ("quilting 16", canopies["quilting 16"][0][0][block], None),
        ]
        pictures.append((f"{place.name} {i}", parts, max(8.0, float(np.quantile(place.chm_m[block], 0.999)))))
    return rows, more, pictures


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--footprint", nargs="+", required=True, help="runs, checkpoints or ONNX files of the first network, one for each training seed")
    parser.add_argument("--height", nargs="*", default=[], help="the same of the second network, in the same order")
    parser.add_argument("--pairs", default="pairs.csv", help="table of pairs, with the hold-out rules that training had")
    parser.add_argument("--out", required=True, help="folder for figures and sheet")
    parser.add_argument("--noise-seeds", type=int, default=3)
    parser.add_argument("--foreign-seeds", type=int, default=3, help="brush sketches for each held-out block")
    parser.add_argument("--synthetic-sites", type=int, default=12, help="planted forests for the response to terrain")
    parser.add_argument("--unseen", nargs="*", default=[], metavar="NAME:DTM:CHM", help="sites that no training has seen")
    parser.add_argument("--threads", type=int, default=None)
    return parser.parse_args()


def main():
    args = parse()
    if args.height and len(args.height) != len(args.footprint):
        raise SystemExit("as many --height as --footprint are needed: they are paired in order")
    if args.threads:
        import torch

        torch.set_num_threads(args.threads)
    out = pathlib.Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    heights = [Network(p) for p in args.height] or [None] * len(args.footprint)
    chains = [Chain(Network(f), h) for f, h in zip(args.footprint, heights)]
    sites, _ = read_pairs(args.pairs)
    places = [Place(site) for site in sites if site.held_out.any()]
    if not places:
        raise SystemExit(f"{args.pairs} holds nothing out: add a holdout column, such as south:0.25")

    begin = time.time()
    tell = lambda what: print(f"{time.time() - begin:.0f} s: {what}", flush=True)
    results = {"networks": [{"footprint": [c.footprint_net.path, c.footprint_net.step], "height": c.height_net and [c.height_net.path, c.height_net.step]} for c in chains]}
    results["noise_seeds"], pictures = args.noise_seeds, []
    results["sites"] = {}
    for place in places:
        rows, more, columns = evaluate_place(place, chains, args.noise_seeds, max(2, args.noise_seeds))
        more["foreign"] = foreign(place, chains, args.foreign_seeds)
        results["sites"][place.name] = {"rows": rows, **more}
        pictures += columns
        tell(f"{place.name} measured")
    if args.synthetic_sites:
        results["terrain_response"] = terrain_response(chains, args.synthetic_sites, float(np.mean([p.field.mean_m for p in places])), min(2, args.noise_seeds))
        tell("planted forests measured")
    results["unseen"] = dict(unseen(u, chains, args.noise_seeds) for u in args.unseen) if args.height else {}
    results["summary"] = card_lines(list(results["sites"].values()))
    (out / "figures.json").write_text(json.dumps(results, indent=1) + "\n")
    (out / "figures.md").write_text(report(results))
    sheet(pictures, out / "sheet.png")
    tell(f"written to {out}")


def report(results):
    """The figures as a page to read."""
    sites = results["sites"]
    names, found = list(sites), list(sites.values())
    rows = [[row, *(by_site([f["rows"][row] for f in found], c) for c in COLUMNS)] for row in found[0]["rows"]]
    steps = ", ".join(f"footprint {n['footprint'][1]}" + (f" and height {n['height'][1]}" if n["height"] else "") for n in results["networks"])
    parts = [
        f"# Held-out figures\n\n{len(results['networks'])} training seed(s) (steps: {steps}), {results['noise_seeds']} noise seeds. Each cell: {' / '.join(names)}. JSD ×100.\n",
        text_table(["row", *COLUMNS.values()], rows),
    ]
    if len(found) == 2:
        shipped = SHIPPED if SHIPPED in found[0]["rows"] else "one net, generated stand height"
        for title, row, bars in ((shipped, shipped, BARS), ("true stand height", SHIPPED_TRUE_STAND, BARS_GIVEN_STAND)):
            if row in found[0]["rows"]:
                own = bars | {"order_jsd": order_bars(found)}
                parts += [f"\n## Against the bars: {title}\n", judged([f["rows"][row] for f in found], own, names)]
        parts += ["\n## Foreign brush sketches\n", judged([f["foreign"] for f in found], BARS_FOREIGN, names)]
    else:
        parts += ["\n## Foreign brush sketches\n"]
    keys = list(found[0]["foreign"])
    parts += ["", text_table(["site", *keys], [[n, *(number(f["foreign"][k]["mean"], 3) for k in keys)] for n, f in zip(names, found)])]
    parts += ["\nShare of the canopy that the rule 'nothing on empty ground, bar one cell' takes away: " + ", ".join(f"{n} {number(f['taken_by_rule'], 4)}" for n, f in zip(names, found)) + "."]
    parts += ["\n## Diversity and memory\n"]
    lines = []
    for name, f in zip(names, found):
        for what, values in f["diversity"].items():
            if values:
                lines.append([name, what, number(values["iou"]), number(values["height_r"])])
    parts += [text_table(["site", "two canopies", "overlap of footprints", "r of heights"], lines), ""]
    kinds = list(found[0]["nearest_training_patch"])
    parts += [text_table(["site: RMS to the nearest training patch", *kinds], [[n, *(number(f["nearest_training_patch"][k], 3) for k in kinds)] for n, f in zip(names, found)])]
    parts += ["\n## Cover against terrain (r over 8×8 cells; within painted classes in brackets)\n"]
    lines = []
    for name, f in zip(names, found):
        for who, values in f["cover_against"].items():
            lines.append([name, who, *(f"{number(v['r'])} ({number(v['r_within_class'])})" for v in values.values())])
    parts += [text_table(["site", "canopy", *found[0]["cover_against"]["real"]], lines)]
    if "terrain_response" in results:
        parts += ["\n## Planted held-out forests: cover against the quality of the ground, within painted classes\n"]
        response = results["terrain_response"]
        parts += [text_table(["canopy", "r", "best third less worst"], [[k, number(v["r"]), number(v["contrast"])] for k, v in response.items() if k != "exchange"])]
        moved = response["exchange"]
        parts += [f"\nTerrain exchanged under one sketch moves the cover by {number(moved['moved'], 3)} (another seed: {number(moved['moved_by_noise'], 3)}); r with the difference of quality {number(moved['moved_r'])}."]
    for name, f in results["unseen"].items():
        parts += [f"\n## Unseen: {name} ({f['cells'][0]}×{f['cells'][1]} cells, cover {number(f['cover'])}, canopy {f['stand_height_m']:.1f} m, classes {' / '.join(number(s) for s in f['class_shares'])})\n"]
        kinds = [k for k in f if k.endswith("stand height")]
        parts += [text_table(["row", *COLUMNS.values()], [[k, *(number(f[k][c]["mean"]) for c in COLUMNS)] for k in kinds])]
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    main()
