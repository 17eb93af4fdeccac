"""Experiments with cords alone: their response on bending specimens (DefSense, Fig. 3), and the
repeatability of stretching them (Fig. 10)."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.progress import Progress
from ...core.response import ResponseSpec
from ...core.storage.files import digest, storage_errors
from ...report.calibration_page import response_figure
from ...report.html import as_image
from ...sensing.response import build_response
from ...twin.electronics.rubber_cords import CORD_KINDS, RubberPieces, RubberState
from ..calibrate.fit_response import FittedResponse, fit_response
from ..calibrate.options import SimulatedSpecimenOptions
from ..calibrate.simulated_specimens import simulate_specimens
from .experiment import CordPlan
from .result_files import compute_once, write_pictures

#: Number of sets of specimens, each of other pieces, that are measured and fitted.
SEEDS, QUICK_SEEDS = 20, 3
BENDING_STRAIN = 0.15  # at which the response of the twin has left its slope at rest
OHM_PER_MM = 14.5
RATE_HZ = 50.0
# The pattern of the stretched cords: levels, relative to the largest strain; times up or down, s;
# pause at both ends, s.
LEVELS, STROKE_S, HOLD_S = (1 / 3, 2 / 3, 1.0), (8.0, 2.0), 4.0
PASS_COLORS = ("#1f5fa8", "#e08a1e")


def run_cord_experiment(
    plan: CordPlan, quick: bool, out: Path, progress: Progress
) -> dict[str, Any]:
    """Calibrate and stretch cords. Results are kept in `out` until the plan changes.

    Args:
        plan: The specimens and the kinds of cords.
        quick: Whether fewer sets of specimens are measured.
        out: Folder of the results.
        progress: Called with the progress.

    Returns:
        Plain values. `cords` has by kind of cord the `hysteresis` and `repeatability` of each
        seed; for the first kind also `k_res` and whether the 95 % `interval` contains the slope of
        the twin (1 or 0). `truth` has the response of the twin, `pictures` the figures.

    Raises:
        CalibrationError: A response cannot be fitted.
        StorageError: Files cannot be written.
    """
    seeds = QUICK_SEEDS if quick else SEEDS

    def make() -> dict[str, Any]:
        return _run(plan, seeds, out, progress)

    results: dict[str, Any] = compute_once(out / "cords.json", digest(repr(plan), seeds), make)
    return results


def _run(plan: CordPlan, seeds: int, out: Path, progress: Progress) -> dict[str, Any]:
    truth, fits = make_true_response(plan.k_res), []
    for seed in range(1, seeds + 1):
        progress("calibrate", (seed - 1) / seeds, f"specimens {seed} of {seeds}")
        fits.append(_calibrate(plan, truth, seed, out / f"specimens-{seed}"))
    intervals = [tuple(f.data["interval"]) for f in fits]
    cords: dict[str, dict[str, Any]] = {}
    first_runs: dict[str, StretchedCord] = {}
    for name in plan.kinds:
        progress("stretch", 0.0, name)
        runs = [stretch_cord(plan, name, seed) for seed in range(1, seeds + 1)]
        first_runs[name] = runs[0]
        cords[name] = {
            "title": CORD_KINDS[name].title,
            "assumed": CORD_KINDS[name].assumed,
            "hysteresis": [r.hysteresis for r in runs],
            "repeatability": [r.repeatability for r in runs],
        }
    if fits and plan.kinds:
        cords[plan.kinds[0]] |= {
            "k_res": [float(f.data["k_res"]) for f in fits],
            "interval": [float(low <= plan.k_res <= high) for low, high in intervals],
            "intervals": intervals,
            "models": [f.calibration.response.model for f in fits],
            "neutral_drift": [float(f.data["neutral_drift"]) for f in fits],
        }
    pictures = {
        "fit": response_figure(fits[0].calibration, build_response(truth)),
        "stretch": _stretch_figure(first_runs),
    }
    write_pictures(out / "pictures", pictures)
    progress("cords", 1.0, "done")
    return {
        "cords": cords,
        "truth": {"k_res": plan.k_res, "bends": BENDING_STRAIN},
        "pictures": pictures,
    }


def make_true_response(k_res: float) -> ResponseSpec:
    """Return the response of the twin's cord.

    Its slope at rest is `k_res`; it bends off exponentially, unlike the models that are fitted.
    """
    strains = np.linspace(-0.12, 0.12, 97)
    changes = k_res * BENDING_STRAIN * (1 - np.exp(-strains / BENDING_STRAIN))
    changes[48] = strains[48] = 0.0
    return ResponseSpec("piecewise", {"strains": strains.tolist(), "changes": changes.tolist()})


def _calibrate(plan: CordPlan, truth: ResponseSpec, seed: int, folder: Path) -> FittedResponse:
    """Record sessions of a twin on specimens of all lengths, and fit the response to them."""
    with storage_errors(folder):
        if folder.exists():
            shutil.rmtree(folder)
    options = SimulatedSpecimenOptions(lengths=plan.lengths, rounds=plan.rounds, seed=seed)
    sessions = simulate_specimens(folder, options, response=truth, radii=plan.radii)
    return fit_response(sessions, folder / "response.json", seed=seed)


@dataclass(frozen=True)
class StretchedCord:
    """A piece of cord that was stretched twice by one pattern.

    Attributes:
        time: Times of a pass (n,) s.
        strain: Strains (n,).
        signals: Signals (R - R0)/R0 of both passes (2, n).
    """

    time: Float
    strain: Float
    signals: Float

    @property
    def hysteresis(self) -> float:
        """Half of the mean difference between stretching and releasing at equal strains, relative
        to the largest signal."""
        is_out = np.gradient(self.strain, self.time) > 1e-9
        is_back = np.gradient(self.strain, self.time) < -1e-9
        levels = np.linspace(0.1, 0.9, 17) * self.strain.max()
        differences = [
            _mean_near(levels, self.strain[is_back], s[is_back])
            - _mean_near(levels, self.strain[is_out], s[is_out])
            for s in self.signals
        ]
        return float(np.abs(differences).mean() / 2 / np.abs(self.signals).max())

    @property
    def repeatability(self) -> float:
        """RMS difference of the passes at equal times, relative to the largest signal."""
        first, second = self.signals
        return float(np.sqrt(((second - first) ** 2).mean()) / np.abs(self.signals).max())


def stretch_cord(plan: CordPlan, kind: str, seed: int) -> StretchedCord:
    """Stretch a new piece of cord twice by the plan's strain, in steps, slowly and fast.

    Args:
        plan: Strain and length of the piece.
        kind: Kind of cord, a key of `CORD_KINDS`.
        seed: Seed of the piece and its noise.
    """
    traits = CORD_KINDS[kind].traits
    rng = np.random.default_rng([seed, 10])
    time, strain = _stretch_pattern(plan.strain)
    both_times = np.concatenate([time, time[-1] + 1 / RATE_HZ + time])
    ideal = plan.k_res * np.concatenate([strain, strain])[:, None]
    pieces = RubberPieces.draw(traits, np.array([OHM_PER_MM * plan.sample]), rng)
    ohm, _ = pieces.simulate(both_times, ideal, RubberState.new(traits, 1), rng)
    signals = (ohm[:, 0] / ohm[0, 0] - 1).reshape(2, -1)
    return StretchedCord(time, strain, signals)


def _stretch_pattern(max_strain: float) -> tuple[Float, Float]:
    """Return times (n,) s and strains (n,): to each level and back, with pauses at both ends."""
    times, strains = [0.0], [0.0]
    for stroke in STROKE_S:
        for level in LEVELS:
            for target in (level * max_strain, 0.0):
                times += [times[-1] + stroke, times[-1] + stroke + HOLD_S]
                strains += [target, target]
    time = np.arange(0, times[-1], 1 / RATE_HZ)
    return time, np.interp(time, times, strains)


def _mean_near(levels: Float, strain: Float, signal: Float) -> Float:
    """Return the mean signal (k,) near strains (k,)."""
    is_near = np.abs(strain - levels[:, None]) < 0.5 * (levels[1] - levels[0])
    return np.asarray((is_near * signal).sum(1) / np.maximum(is_near.sum(1), 1))


def _stretch_figure(runs: Mapping[str, StretchedCord]) -> str:
    """Draw Fig. 10: the signals of each kind of cord in both passes, and the pattern below.

    Returns:
        PNG as a data URI.
    """
    from matplotlib.figure import Figure

    figure = Figure((9.0, 2.2 * len(runs) + 1.6), dpi=110, layout="constrained")
    axes = figure.subplots(len(runs) + 1, 1, sharex=True)
    labels = ("first time", "second time")
    for ax, (name, run) in zip(axes, runs.items(), strict=False):
        for signal, color, label in zip(run.signals, PASS_COLORS, labels, strict=False):
            ax.plot(run.time, signal, color=color, lw=1.2, label=label)
        ax.set_ylabel("(R - R0)/R0")
        ax.set_title(name, loc="left", fontsize=10)
    axes[0].legend(fontsize=8, frameon=False, ncols=2, loc="upper left")
    run = next(iter(runs.values()))
    axes[-1].plot(run.time, 100 * run.strain, color="#111111", lw=1.2)
    axes[-1].set_ylabel("strain, %")
    axes[-1].set_xlabel("time, s")
    return as_image(figure)
