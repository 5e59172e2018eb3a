"""Trains one generator: `python train.py footprint --pairs pairs.csv --out runs/footprint`.

The run's folder holds its configuration, checkpoints (the same command goes on where it stopped), loss curves and sheets
of samples.
"""

import argparse
import copy
import csv
import dataclasses
import json
import pathlib
import time

import numpy as np
import torch

import losses
import synthetic
from dataset import CANOPY_M, MAX_HEIGHT_M, PLAIN_STYLE, Sampler, brush_sketch, encode_height, one_hot, read_pairs
from networks import GENERATORS, Critics, decode_height, kept_empty


@dataclasses.dataclass
class Config:
    """All that decides a run's result, saved beside it."""

    stage: str = "footprint"
    pairs: str = "pairs.csv"
    seed: int = 1
    steps: int = 9000
    batch: int = 4
    crop: int = 96
    features: int = 24
    critic_features: int = 32
    learning_rate: float = 2e-4
    critic_learning_rate: float = 5e-4
    synthetic_sites: int = 60
    synthetic_share_at_first: float = 0.75
    synthetic_share_later: float = 0.0
    pretraining_fraction: float = 0.12
    weight_adversarial: float = 1.5
    weight_l1: float = 0.5
    weight_sketch: float = 4.0
    weight_blocks: float = 0.3
    weight_variogram: float = 0.5
    weight_texture: float = 8.0
    weight_levels: float = 1.0
    weight_planted: float = 1.0
    weight_edges: float = 4.0
    gradient_penalty: float = 3e-6
    gradient_penalty_every: int = 8
    plain_share: float = 0.3
    precision: str = "f32"
    average_decay: float = 0.998
    begin_with: str = ""


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("stage", choices=sorted(GENERATORS))
    parser.add_argument("--out", required=True, help="folder of the run; one that holds a checkpoint is gone on with")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=None, help="CPU threads (default: all)")
    parser.add_argument("--save-every", type=int, default=500)
    parser.add_argument("--sheet-every", type=int, default=2000)
    for field in dataclasses.fields(Config):
        if field.name != "stage":
            parser.add_argument("--" + field.name.replace("_", "-"), type=type(field.default), default=field.default)
    return parser.parse_args()


class Batches:
    """Conditions and canopies as the networks see them, from real pairs and from planted forests."""

    def __init__(self, config, device):
        self.config, self.device = config, device
        sites, weights = read_pairs(config.pairs)
        self.real = Sampler(sites, weights, config.crop, [config.seed, 10], plain_share=config.plain_share)
        planted = synthetic.sites(config.synthetic_sites, size=max(192, config.crop), first_seed=1000 * config.seed) if config.synthetic_sites else []
        self.planted = Sampler(planted, np.full(len(planted), 1 / len(planted)), config.crop, [config.seed, 11], sketches_per_site=1) if planted else None
        self.rng = np.random.default_rng([config.seed, 12])

    def pairs(self, synthetic_share):
        """Conditions, heights (m) and limits of cover of a batch, part of it planted."""
        samples = [self._draw(self.planted if self.planted and self.rng.random() < synthetic_share else self.real) for _ in range(self.config.batch)]
        return self._stack(samples)

    def planted_pair(self):
        return self._stack([self._draw(self.planted)])

    def painted(self):
        """Conditions of real terrain under strokes of no real forest, with any stand height: (conditions, sketch, limits)."""
        sample = self.real.draw()
        sketch = one_hot(brush_sketch(sample.chm_m.shape[1:], self.rng))
        stand = np.full_like(sample.stand, encode_height(np.exp(self.rng.uniform(np.log(4.5), np.log(26)))))
        conditions = np.concatenate([sketch, sample.terrain, stand])
        return self._tensor(conditions)[None], self._tensor(sketch)[None], self._tensor(_limits(PLAIN_STYLE))[None]

    def _draw(self, sampler):
        sample = sampler.draw()
        if self.config.stage == "footprint":
            conditions = np.concatenate([sample.sketch, sample.terrain, sample.stand])
        else:
            conditions = np.concatenate([(sample.chm_m > CANOPY_M).astype(np.float32), sample.terrain, sample.stand])
        return conditions, sample.chm_m, _limits(sample.style)

    def _stack(self, samples):
        return tuple(self._tensor(np.stack(parts)) for parts in zip(*samples))

    def _tensor(self, array):
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self.device)


def _limits(style):
    return np.array([style.empty_below, style.dense_above], np.float32)


class Training:
    """Networks, optimisers and counters of a run: all that a checkpoint holds."""

    def __init__(self, config, device):
        torch.manual_seed(config.seed)
        self.config, self.device = config, device
        self.generator = GENERATORS[config.stage](config.features).to(device)
        self.average = copy.deepcopy(self.generator).requires_grad_(False)
        self.critics = Critics(self.generator.CONDITIONS, config.critic_features).to(device)
        if config.precision not in ("f32", "bf16"):
            raise SystemExit(f"--precision {config.precision}: f32 or bf16")
        for net in (self.generator.net, *self.critics.critics):
            net.bfloat16 = config.precision == "bf16"
        options = dict(lr=config.learning_rate, betas=(0.5, 0.99), fused=True)
        self.generator_optimiser = torch.optim.Adam(self.generator.parameters(), **options)
        options["lr"] = config.critic_learning_rate
        self.critic_optimiser = torch.optim.Adam(self.critics.parameters(), **options)
        self.texture = losses.SlicedWasserstein(config.seed)
        self.batches = Batches(config, device)
        self.step = 0

    def state(self):
        return {
            "config": dataclasses.asdict(self.config),
            "step": self.step,
            "generator": self.generator.state_dict(),
            "average": self.average.state_dict(),
            "critics": self.critics.state_dict(),
            "generator_optimiser": self.generator_optimiser.state_dict(),
            "critic_optimiser": self.critic_optimiser.state_dict(),
            "texture": self.texture.generator.get_state(),
            "torch": torch.get_rng_state(),
            "rngs": [r.bit_generator.state for r in self._rngs()],
        }

    def load(self, state):
        for name in ("generator", "average", "critics", "generator_optimiser", "critic_optimiser"):
            getattr(self, name).load_state_dict(state[name])
        self.texture.generator.set_state(state["texture"])
        torch.set_rng_state(state["torch"])
        for rng, saved in zip(self._rngs(), state["rngs"]):
            rng.bit_generator.state = saved
        self.step = state["step"]

    def _rngs(self):
        b = self.batches
        return [b.rng, b.real.rng] + ([b.planted.rng] if b.planted else [])

    def noise(self, like):
        """Uniform noise of deviation 1: (batch, 1, rows, cols)."""
        return (2 * torch.rand(like.shape[0], 1, *like.shape[2:]) - 1).mul_(3**0.5).to(self.device)

    def advance(self):
        """One step of both sides; gives the losses by name."""
        config = self.config
        pretraining = self.step < config.pretraining_fraction * config.steps
        # the rate falls to a tenth over the last third
        done = self.step / config.steps
        slower = 1.0 if done < 2 / 3 else 0.1 ** (3 * done - 2)
        self.generator_optimiser.param_groups[0]["lr"] = config.learning_rate * slower
        self.critic_optimiser.param_groups[0]["lr"] = config.critic_learning_rate * slower
        share = config.synthetic_share_at_first if pretraining else config.synthetic_share_later
        conditions, target_m, limits = self.batches.pairs(share)
        target = 2.0 * torch.sqrt(target_m.clamp(0, MAX_HEIGHT_M) / MAX_HEIGHT_M) - 1.0
        if config.stage == "footprint":
            # the critics are to judge texture, not that real canopy strays where somebody painted none
            target = kept_empty(target, conditions[:, :1])
            target_m = decode_height(target)

        # generator
        found = {}
        extra, extra_target, extra_limits = self._extra()
        seen = torch.cat([conditions, extra]) if extra is not None else conditions
        made_all = self.generator(seen, self.noise(seen))
        made = made_all[: len(conditions)]
        made_m = decode_height(made)
        self.critics.requires_grad_(False)
        found["adversarial"] = losses.adversarial(self.critics(conditions, made))
        self.critics.requires_grad_(True)
        found["l1"] = (made - target).abs().mean()
        found["texture"] = self.texture(made, target)
        found["variogram"] = losses.variogram(made_m, target_m)
        found["blocks"] = losses.block_means(made_m, target_m)
        found["levels"] = losses.levels(made_m, target_m)
        total = config.weight_adversarial * found["adversarial"] + config.weight_l1 * found["l1"]
        total = total + config.weight_texture * found["texture"] + config.weight_variogram * found["variogram"]
        total = total + config.weight_blocks * found["blocks"] + config.weight_levels * found["levels"]
        if config.stage == "footprint":
            found["edges"] = self.texture(losses.soft_footprint(made_m), losses.soft_footprint(target_m))
            total = total + config.weight_edges * found["edges"]
            found["sketch"] = losses.sketch_hinge(made_m, conditions[:, :3], limits)
            total = total + config.weight_sketch * found["sketch"]
        if extra is not None:
            extra_m = decode_height(made_all[len(conditions) :])
            if extra_limits is not None:
                found["paint"] = losses.sketch_hinge(extra_m, extra[:, :3], extra_limits)
                total = total + config.weight_sketch * found["paint"]
            else:
                found["planted"] = losses.block_means(extra_m, extra_target)
                total = total + config.weight_planted * found["planted"]
        self.generator_optimiser.zero_grad(set_to_none=True)
        total.backward()
        self.generator_optimiser.step()

        # critics
        real = target.requires_grad_(self.step % config.gradient_penalty_every == 0)
        of_real, of_made = self.critics(conditions, real), self.critics(conditions, made.detach())
        found["critics"] = losses.critic_loss(of_real, of_made)
        total = found["critics"]
        if real.requires_grad:
            total = total + config.gradient_penalty * losses.gradient_penalty(of_real, real)
        self.critic_optimiser.zero_grad(set_to_none=True)
        total.backward()
        self.critic_optimiser.step()

        # running average of the weights, the one that is shipped
        decay = min(config.average_decay, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for kept, new in zip(self.average.parameters(), self.generator.parameters()):
                kept.lerp_(new, 1 - decay)
        self.step += 1
        return {name: float(value.detach()) for name, value in found.items()}

    def _extra(self):
        """One more sample, alternately a planted forest (structure only) and, for footprints, strokes of no real forest."""
        if self.config.stage == "footprint" and (self.step % 2 == 0 or not self.batches.planted):
            conditions, _, limits = self.batches.painted()
            return conditions, None, limits
        if self.batches.planted:
            conditions, target, _ = self.batches.planted_pair()
            return conditions, target, None
        return None, None, None


def sheet(training, path):
    """Samples as a picture: conditions, the real canopy, two generated ones."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    batches = copy.deepcopy(training.batches)
    torch_state = torch.get_rng_state()
    torch.manual_seed(0)
    conditions, target, _ = batches.pairs(0.0)
    more = batches.pairs(1.0) if batches.planted else batches.pairs(0.0)
    conditions, target = torch.cat([conditions, more[0]]), torch.cat([target, more[1]])
    with torch.no_grad():
        made = [decode_height(training.average(conditions, training.noise(conditions))) for _ in range(2)]
    torch.set_rng_state(torch_state)
    figure, axes = plt.subplots(4, len(conditions), figsize=(2.2 * len(conditions), 9))
    for i, column in enumerate(np.atleast_2d(axes.T)):
        top = max(8.0, float(target[i].max()))
        first = conditions[i, :3].argmax(0) if training.config.stage == "footprint" else conditions[i, 0]
        for axis, picture, most in zip(column, [first, target[i, 0], made[0][i, 0], made[1][i, 0]], [2, top, top, top]):
            axis.imshow(picture.cpu(), vmin=0, vmax=most)
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def curves(log_path, path):
    """The losses over the steps, smoothed."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with open(log_path, newline="") as file:
        rows = list(csv.DictReader(file))
    names = [n for n in rows[0] if n not in ("step", "seconds")]
    figure, axes = plt.subplots(1, len(names), figsize=(3 * len(names), 2.6))
    for axis, name in zip(axes, names):
        points = [(int(r["step"]), float(r[name])) for r in rows if r[name]]
        axis.plot(*zip(*points), linewidth=0.8)
        axis.set_title(name, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main():
    args = parse()
    if args.threads:
        torch.set_num_threads(args.threads)
    config = Config(**{f.name: getattr(args, f.name) for f in dataclasses.fields(Config)})
    out = pathlib.Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    training = Training(config, args.device)
    checkpoint, log_path = out / "checkpoint.pt", out / "losses.csv"
    names = ["step", "seconds", "adversarial", "critics", "l1", "texture", "edges", "levels", "variogram", "blocks", "sketch", "paint", "planted"]
    seconds_before = 0.0
    if checkpoint.exists():
        state = torch.load(checkpoint, map_location=args.device, weights_only=False)
        changed = {k for k, v in dataclasses.asdict(config).items() if state["config"].get(k) != v}
        if changed:
            raise SystemExit(f"{out} holds a run with other settings ({', '.join(sorted(changed))}): give another --out, or delete it")
        training.load(state)
        with open(log_path, newline="") as file:
            kept = [r for r in csv.DictReader(file) if int(r["step"]) <= training.step]
        seconds_before = float(kept[-1]["seconds"]) if kept else 0.0
        print(f"going on at step {training.step}", flush=True)
    else:
        if config.begin_with:
            # the networks of another run, not its counters
            state = torch.load(config.begin_with, map_location=args.device, weights_only=False)
            training.generator.load_state_dict(state["average"])
            training.average.load_state_dict(state["average"])
            training.critics.load_state_dict(state["critics"])
        kept = []
        (out / "config.json").write_text(json.dumps(dataclasses.asdict(config), indent=1) + "\n")
    with open(log_path, "w", newline="") as file:
        log = csv.DictWriter(file, names)
        log.writeheader()
        log.writerows(kept)
        begin, sums, counts = time.time(), {}, {}
        while training.step < config.steps:
            for name, value in training.advance().items():
                sums[name] = sums.get(name, 0.0) + value
                counts[name] = counts.get(name, 0) + 1
            if training.step % 50 == 0 or training.step == config.steps:
                seconds = seconds_before + time.time() - begin
                means = {name: round(sums[name] / counts[name], 5) for name in sums}
                log.writerow({"step": training.step, "seconds": round(seconds, 1), **means})
                file.flush()
                print(f"step {training.step}/{config.steps}, {seconds:.0f} s: " + ", ".join(f"{k} {v:.3f}" for k, v in means.items()), flush=True)
                sums, counts = {}, {}
            if training.step % args.save_every == 0 or training.step == config.steps:
                torch.save(training.state(), out / "checkpoint.tmp")
                (out / "checkpoint.tmp").replace(checkpoint)
            if training.step % args.sheet_every == 0 or training.step == config.steps:
                sheet(training, out / f"samples_{training.step:06}.png")
                curves(log_path, out / "losses.png")


if __name__ == "__main__":
    main()
