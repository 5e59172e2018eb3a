"""Writes trained generators as ONNX with their cards: `python export.py --footprint runs/footprint --height runs/height --out ../models`.

The graph holds everything from conditions to metres, so that the program needs no constants of the training beyond the card.
"""

import argparse
import datetime
import hashlib
import json
import pathlib

import numpy as np
import onnx
import onnxruntime
import torch
from torch import nn

import dataset
from dataset import pairs_table
from networks import GENERATORS, HALO, STRIDE, cut, decode_height, receptive_field

OPSET = 17

CHANNELS = {
    "footprint": [
        ("sketch_empty", "1 where painted empty, else 0"),
        ("sketch_sparse", "1 where painted sparse, else 0"),
        ("sketch_dense", "1 where painted dense, else 0"),
        ("relief", "asinh((elevation - mean around it) / 15 m); the mean is three passes of a box of 101 x 101 cells over land"),
        ("gradient_east", "asinh(rise eastward per metre / 0.3)"),
        ("gradient_north", "asinh(rise northward per metre / 0.3)"),
        ("stand_height", "2 sqrt(s / 36 m) - 1, where s is the mean height of canopy cells around"),
    ],
    "height": [
        ("footprint", "1 where canopy is higher than 3 m, else 0"),
        ("relief", "as in the footprint network"),
        ("gradient_east", "as in the footprint network"),
        ("gradient_north", "as in the footprint network"),
        ("stand_height", "as in the footprint network"),
    ],
}

OUTPUT = {
    "footprint": "height in metres inside the halo; cells above 3 m are the footprint",
    "height": "canopy height in metres inside the halo, above 3 m in the footprint and below outside",
}


class Exported(nn.Module):
    """A generator with metres as output, for the map inside the halo."""

    def __init__(self, generator):
        super().__init__()
        self.generator = generator

    def forward(self, conditions, noise):
        return decode_height(self.generator(conditions, noise, HALO))


def load(path):
    """The averaged generator of a run's folder or checkpoint, and the checkpoint."""
    path = pathlib.Path(path)
    state = torch.load(path / "checkpoint.pt" if path.is_dir() else path, map_location="cpu", weights_only=False)
    generator = GENERATORS[state["config"]["stage"]](state["config"]["features"])
    generator.load_state_dict(state["average"])
    return generator.eval(), state


def write_onnx(generator, path):
    """The network as ONNX with free height and width; fails where onnxruntime disagrees with torch."""
    model = Exported(generator)
    example = (torch.rand(1, generator.CONDITIONS, 192, 208), torch.rand(1, 1, 192, 208))
    free, inside = {2: "rows", 3: "cols"}, {2: "rows_inside", 3: "cols_inside"}
    torch.onnx.export(
        model,
        example,
        path,
        dynamo=False,
        opset_version=OPSET,
        input_names=["conditions", "noise"],
        output_names=["height_m"],
        dynamic_axes={"conditions": free, "noise": free, "height_m": inside},
    )
    onnx.checker.check_model(str(path))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    conditions, noise = torch.rand(1, generator.CONDITIONS, 256, 224), torch.rand(1, 1, 256, 224)
    with torch.no_grad():
        expected = cut(decode_height(generator(conditions, noise)), HALO).numpy()
    got = session.run(None, {"conditions": conditions.numpy(), "noise": noise.numpy()})[0]
    worst = float(np.abs(got - expected).max())
    if worst > 1e-3:
        raise SystemExit(f"{path}: onnxruntime and torch differ by {worst} m")


def write_card(stage, state, onnx_path, figures, data, card_path):
    """The model card: what goes in, what comes out, where it comes from, how good it is."""
    text = lambda value: json.dumps(value, ensure_ascii=False)  # a TOML basic string is a JSON string
    generator = GENERATORS[stage](state["config"]["features"])
    reach = receptive_field(generator)
    if reach > HALO:
        raise SystemExit(f"{stage}: inputs reach {reach} cells, more than the halo of {HALO}")
    lines = [
        f"# Card of {onnx_path.name}, written by training/export.py.",
        "format = 2",
        f"name = {text(stage)}",
        f"file = {text(onnx_path.name)}",
        f"sha256 = {text(hashlib.sha256(onnx_path.read_bytes()).hexdigest())}",
        f"cell_m = {dataset.CELL_M}",
        f"stride_cells = {STRIDE}",
        f"halo_cells = {HALO}",
        f"receptive_field_radius_cells = {reach}",
        f"opset = {OPSET}",
        f"weights = {sum(p.numel() for p in generator.parameters())}",
        f"output = {text(OUTPUT[stage])}",
        'noise = "one channel of uniform noise, mean 0 and deviation 1, drawn per cell"',
        f"date = {datetime.date.today().isoformat()}",
        'licence = "MIT OR Apache-2.0"',
        "",
    ]
    for name, meaning in CHANNELS[stage]:
        lines += ["[[channels]]", f"name = {text(name)}", f"meaning = {text(meaning)}", ""]
    for row in data:
        lines += ["[[data]]", f"name = {text(row.get('source') or row['name'])}"]
        lines += [f"licence = {text(row.get('licence') or 'not told')}", f"held_out = {text(row.get('holdout') or 'none')}", ""]
    lines += [
        "[[data]]",
        'name = "forests planted by training/synthetic.py"',
        'licence = "the project\'s own"',
        "",
        "[training]",
        f"steps_done = {state['step']}",
    ]
    config = dict(state["config"])
    # names, not where they lay
    config["pairs"] = pathlib.Path(config["pairs"]).name
    if config.get("begin_with"):
        config["begin_with"] = pathlib.Path(config["begin_with"]).parent.name
    lines += [f"{key} = {text(value)}" for key, value in config.items()]
    if figures:
        lines += ["", "# Held-out figures by training/evaluate.py, means over the training seeds; SJER and HARV. models/figures.md has all of them."]
        lines += ["[figures]"] + [f"{text(key)} = {text(value)}" for key, value in figures.items()]
    card_path.write_text("\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--footprint", required=True, help="run folder or checkpoint")
    parser.add_argument("--height", required=True, help="run folder or checkpoint")
    parser.add_argument("--pairs", help="table or folder of pairs that were trained on, for the cards (default: the run's)")
    parser.add_argument("--figures", help="JSON of evaluate.py, whose summary goes on the cards")
    parser.add_argument("--out", default="../models")
    args = parser.parse_args()
    out = pathlib.Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    summary = json.loads(pathlib.Path(args.figures).read_text()).get("summary", {}) if args.figures else {}
    for stage in ("footprint", "height"):
        generator, state = load(getattr(args, stage))
        if state["config"]["stage"] != stage:
            raise SystemExit(f"{getattr(args, stage)} holds a {state['config']['stage']} network")
        path = out / f"{stage}.onnx"
        write_onnx(generator, path)
        data = pairs_table(args.pairs or state["config"]["pairs"])[1]
        write_card(stage, state, path, summary, data, out / f"{stage}.toml")
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, {state['step']} steps")


if __name__ == "__main__":
    main()
