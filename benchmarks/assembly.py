"""The cords of a built layout bonded and held: signals, strains and errors of the same paths.

    python -m benchmarks.assembly fixtures/devices/bar
    python -m benchmarks.assembly my-device --compression half none rising

Each device folder is built up to its layout. Its cords are then taken to be held, stretched by as
much as they need, held as they lie, and bonded, with each answer to compression; the decoder is
fitted to the signals of each (trained), and that of the layout as it was designed is used on them
as it is (untrained). Errors are those on the unseen states, with noise.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from defsense_fab.store.build import Build
from defsense_fab.core.device.device import COMPRESSION_FACTORS
from defsense_fab.core.device.device_file import load_device
from defsense_fab.optimize.prediction.design_task import DesignTask, load_task
from defsense_fab.optimize.prediction.predict import Scored, predict
from defsense_fab.sensing.built_cord import BuiltCord, required_prestretch
from defsense_fab.store.layout import load_layout
from defsense_fab.sensing.response import mean_strain
from defsense_fab.workflow.build.build import build


def untrained(task: DesignTask, designed: Scored, found: Scored) -> float:
    """RMSE (mm) on the unseen states of the design's own decoder on other signals."""
    tested, weights = task.unseen.tested, task.everything.marker_weights
    markers, signals = task.everything.markers[tested], found.signals[tested]
    off = designed.decoder(signals).reshape(markers.shape) - markers
    noise = designed.decoder.noise_variance(signals, np.array(found.prediction.noise))
    square = (off**2).sum(2) + noise.reshape(markers.shape).sum(2)
    return float(np.sqrt((square @ weights).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument("--compression", nargs="*", choices=COMPRESSION_FACTORS, default=list(COMPRESSION_FACTORS))
    options = parser.parse_args()
    print("device           assembly              largest signal  least strain"
          "  trained  untrained")  # fmt: skip
    for path in options.folder:
        device = load_device(path)
        folder = build(device, "optimize").folder
        layout = load_layout(folder)
        task = load_task(device, Build(folder)).with_decoder(layout.prediction.decoder)
        paths = [s.built for s in layout.sensors]
        designed = predict(task, paths)
        strains = [mean_strain(c.path, task.everything.deform(c.path)) for c in paths]

        def held(prestretch: float | None, strains: list = strains, paths: list = paths) -> list:
            return [
                replace(
                    c, prestretch=required_prestretch(s.min()) if prestretch is None else prestretch
                )
                for c, s in zip(paths, strains, strict=True)
            ]

        cases: list[tuple[str, DesignTask, list[BuiltCord]]] = [
            ("held, stretched", task, held(None)), ("held as it lies", task, held(0.0)),
        ]  # fmt: skip
        for name in options.compression:
            other = replace(task, reading=task.reading.scale_gauge_factor(1.0, COMPRESSION_FACTORS[name]))
            cases.append((f"bonded, {name}", other, [replace(c, prestretch=None) for c in paths]))
        for name, case, cords in cases:
            found = predict(case, cords)
            least = min(
                (1 + (c.prestretch or 0.0)) * (1 + min(float(s.min()), 0.0)) - 1
                for c, s in zip(cords, strains, strict=True)
            )
            print(f"{device.name:<16} {name:<20} {np.abs(found.signals).max():15.3f}"
                  f" {100 * least:12.1f}%"
                  f" {found.prediction.unseen:8.3f} {untrained(task, designed, found):10.3f}",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
