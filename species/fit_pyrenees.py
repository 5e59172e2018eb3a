"""Fits the allometry of pyrenees.toml to the growth tables of Peytavie et al. 2024 (MIT, github.com/oargudo/deadwood).

    python3 species/fit_pyrenees.py FOLDER

FOLDER holds almc_1.txt … almc_7.txt (grown among others) and almo_1.txt … almo_7.txt (grown alone). After a first
number, the count of years, each row is one year: id, crown radius m, height m, stem diameter m, branch count, branch
length m. Printed are, for each species, the lines that pyrenees.toml holds. Needs numpy; nothing is trained.

Radius and diameter: ordinary least squares of ln y on ln h, from the fifth year on with h ≥ 1.3 m (the first
rows are seedlings of uneven size) and y > 0. "sd" is the residual's standard deviation in ln y: 0.10 means about 10 %.
Height: the limit H that fits h = H · (2 / (1 + e^(q t / max age)) − 1) best, with the printed q and max age; "rmse" in m.
"""

import sys
from pathlib import Path

import numpy as np

# key, max age (years), printed max height (m), printed q: Peytavie 2024, Table 5; files are numbered in this order
SPECIES = [
    ("boxwood", 300, 9, -5),
    ("snowy-mespilus", 50, 6, -4),
    ("mountain-pine", 400, 20, -4),
    ("silver-fir", 550, 50, -6),
    ("silver-birch", 120, 30, -4),
    ("sessile-oak", 600, 40, -7),
    ("european-beech", 400, 50, -4),
]
# where the dense plants come out no narrower than the isolated ones, one law is fitted to both tables
POOLED_RADIUS = {"boxwood", "mountain-pine"}
POOLED_DIAMETER = {"boxwood", "mountain-pine"}
FIRST_YEAR = 5
BREAST_HEIGHT_M = 1.3


def read(path):
    rows = [line.split() for line in path.read_text().splitlines() if line.strip()]
    table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    assert len(table) == int(float(rows[0][0])), f"{path}: row count"
    return np.arange(1, len(table) + 1), table[:, 1], table[:, 2], table[:, 3]


def height_limit(years, height, max_age, q):
    rise = 2 / (1 + np.exp(q * years / max_age)) - 1
    used = years >= FIRST_YEAR
    limit = (height[used] @ rise[used]) / (rise[used] @ rise[used])
    return limit, np.sqrt(np.mean((height[used] - limit * rise[used]) ** 2))


def power_law(pairs):
    x = np.concatenate([np.log(h) for h, _ in pairs])
    y = np.concatenate([np.log(v) for _, v in pairs])
    design = np.column_stack([np.ones_like(x), x])
    coefficients, *_ = np.linalg.lstsq(design, y, rcond=None)
    return coefficients, np.std(y - design @ coefficients)


def usable(years, height, value):
    used = (years >= FIRST_YEAR) & (height >= BREAST_HEIGHT_M) & (value > 0)
    return height[used], value[used]


def law(name, coefficients, note):
    return f"{name} = {{ log_m = {coefficients[0]:.4f}, exponent = {coefficients[1]:.4f} }} # {note}"


def laws(name, dense, isolated, pooled):
    if pooled:
        both, deviation = power_law([dense, isolated])
        note = f"fitted to both tables together, sd {deviation:.2f}"
        return [law(name + end, both, note) for end in ("", "_dense", "_isolated")]
    among, among_deviation = power_law([dense])
    alone, alone_deviation = power_law([isolated])
    return [
        law(name, (among + alone) / 2, "geometric mean of the two below"),
        law(name + "_dense", among, f"fitted to almc, sd {among_deviation:.2f}"),
        law(name + "_isolated", alone, f"fitted to almo, sd {alone_deviation:.2f}"),
    ]


def main(folder):
    for number, (key, max_age, max_height, q) in enumerate(SPECIES, start=1):
        dense = read(folder / f"almc_{number}.txt")
        isolated = read(folder / f"almo_{number}.txt")
        among, among_error = height_limit(dense[0], dense[2], max_age, q)
        alone, alone_error = height_limit(isolated[0], isolated[2], max_age, q)
        print(f"[{key}] {len(dense[0])} years, to {dense[2].max():.1f} m dense, {isolated[2].max():.1f} m isolated")
        print(
            f"  isolated_height_fraction = {alone / among:.2f} # height limits fitted: {among:.1f} m dense (rmse "
            f"{among_error:.2f}), {alone:.1f} m isolated (rmse {alone_error:.2f}); printed {max_height} m"
        )
        for name, column, pooled in (("radius", 1, POOLED_RADIUS), ("dbh", 3, POOLED_DIAMETER)):
            pairs = [usable(table[0], table[2], table[column]) for table in (dense, isolated)]
            for line in laws(name, *pairs, key in pooled):
                print("  " + line)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
