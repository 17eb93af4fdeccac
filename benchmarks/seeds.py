"""Whether the searches that a build makes come near the best that many more would find.

    python -m benchmarks.seeds fixtures/devices/bar fixtures/devices/twist-bar --count 25

A build searches from 5 random seeds, or more where it has fewer than three cords. Here each device
folder is built up to its fields, and searched from `--count` seeds with the decoder that its layout
has. Told are the designed RMSE (mm, on the states designed for) of the best of the build's seeds
and of all, and the same of the errors on held-out states; then, of choices of as many seeds as a
build has, the share whose best is within 2 % of the best of all.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from defsense_fab.store.build import Build
from defsense_fab.core.device.device import DECODERS
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimize.prediction.as_built import assumed_cords
from defsense_fab.optimize.prediction.design_task import SEED, load_task
from defsense_fab.optimize.prediction.predict import predict
from defsense_fab.optimize.refinement.refine import optimize_layout
from defsense_fab.store.layout import load_layout
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.stage_optimize import searches

_SETS = 10_000  # of seeds, drawn at random


def searched(folder: Path, count: int) -> tuple[str, int, np.ndarray]:
    """The decoder, how many cords there are, and RMSE (mm) on designed and on unseen states by seed
    (count, 2)."""
    device = load_device(folder)
    made = build(device, "optimize").folder
    layout = load_layout(made)
    decoder = layout.prediction.decoder
    task = load_task(device, Build(made)).with_decoder(decoder)
    out = []
    for seed in range(count):
        try:
            found = optimize_layout(
                task.design, device.sensors, np.random.default_rng((SEED, seed)),
                lambda *_: None, extra=device.propose, planes=device.planes,
            )  # fmt: skip
        except LayoutError:
            out.append((np.inf, np.inf))
            continue
        cords = assumed_cords(task, found.sensors)
        out.append((found.rmse, predict(task, cords).prediction.unseen))
    return decoder, len(layout.sensors), np.array(out)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument("--count", type=int, default=25)
    options = parser.parse_args()
    for folder in options.folder:
        begun = time.process_time()
        decoder, cords, errors = searched(folder, options.count)
        assert decoder in DECODERS
        tried = min(searches(cords), options.count)
        sys.stdout.write(f"{folder.name}, {cords} cords, {decoder}, {options.count} seeds,")
        sys.stdout.write(f" {time.process_time() - begun:.0f} CPU s\n")
        rng = np.random.default_rng(0)
        sets = np.array([rng.permutation(options.count)[:tried] for _ in range(_SETS)])
        for title, of in zip(("designed", "unseen"), errors.T, strict=True):
            share = (of[sets].min(axis=1) <= 1.02 * of.min()).mean()
            sys.stdout.write(
                f"  {title:9} build's {tried}: {of[:tried].min():.3f}, all: {of.min():.3f}, median"
                f" {np.median(of):.3f} mm; sets of {tried} within 2 %: {share:.0%}\n"
            )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
