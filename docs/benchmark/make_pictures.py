"""Draw the picture of the results on real sensors, from the table of errors on its page.

python docs/benchmark/make_pictures.py
"""

from pathlib import Path

import matplotlib as mpl
from PIL import Image

mpl.use("Agg")
from matplotlib import pyplot as plt  # after the choice of the backend

HERE = Path(__file__).parent
PAGE = HERE.parent / "contributing" / "benchmark-real.md"
HEAD = "| recording | unit | mean |"
OURS = "ours"
MARKS = {
    "ridge": "v",
    "kernel ridge": "s",
    "extra trees": "^",
    "boosting": "D",
    "recurrent network": "P",
}


def read_errors():
    """Return for each recording the error of each method in the test, and that of the mean."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith(HEAD))
    names = [cell.strip() for cell in lines[at].strip("|").split("|")]
    errors = {}
    for line in lines[at + 2 :]:
        if not line.startswith("|"):
            return errors
        row = dict(zip(names, (cell.strip() for cell in line.strip("|").split("|")), strict=True))
        tests = {name: row[name].split("/")[1].strip(" *") for name in (OURS, *MARKS)}
        errors[row["recording"]] = {n: float(e) / float(row["mean"]) for n, e in tests.items()}
    return errors


def main():
    """Write `errors.png`."""
    errors = read_errors()
    figure, axes = plt.subplots(figsize=(7.4, 3.4), dpi=120)
    places = range(len(errors))
    for name, mark in MARKS.items():
        shares = [100 * row[name] for row in errors.values()]
        axes.plot(shares, places, mark, color="#8fa3b0", ms=7, label=name, linestyle="none")
    shares = [100 * row[OURS] for row in errors.values()]
    axes.plot(shares, places, "o", color="#d1495b", ms=10, label="defsense", linestyle="none")
    axes.set_yticks(places, list(errors))
    axes.set_ylim(len(errors) - 0.6, -0.6)
    axes.set_xlim(0, 100)
    axes.set_xlabel("error in the test, % of the error of the mean")
    axes.grid(axis="x", color="#d5dce0")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.legend(loc="upper right", fontsize=9)
    figure.tight_layout()
    file = HERE / "errors.png"
    figure.savefig(file)
    with Image.open(file) as image:
        reduced = image.convert("RGB").quantize(64, dither=Image.Dither.NONE)
    reduced.save(file, optimize=True)


if __name__ == "__main__":
    main()
