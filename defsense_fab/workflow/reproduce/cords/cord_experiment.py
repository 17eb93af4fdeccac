"""Cords alone: their response found on bending specimens (DefSense, Fig. 3), and how far they
answer twice alike when stretched (Fig. 10)."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from ....core.progress import Progress
from ....core.response import ResponseSpec
from ....core.storage.files import digest, storage_errors
from ....report.calibration_page import response_figure
from ....sensing.response import Response, build_response
from ....twin.calibration_session import record_twin
from ....twin.electronics.cords import CordTraits
from ....twin.electronics.rubber_cords import CORD_KINDS
from ...calibrate.fit_response import FittedResponse, fit_response
from ..experiments.experiment import CordPlan
from ..results.kept import once
from ..results.picture_files import in_rows, write_pictures
from .cord_figures import stretch_figure
from .stretched_cord import Stretched, stretched

#: Specimens of other pieces that are measured and fitted anew.
SEEDS, QUICK_SEEDS = 20, 3
_WIDTH = 700.0  # pixels of a figure beside another
_BENDS = 0.15  # strain at which the twin's response has bent off its slope at rest


def cord_results(plan: CordPlan, quick: bool, out: Path, progress: Progress) -> dict[str, Any]:
    """By kind of cord its `hysteresis` and `repeatability`, of the ready-made one also `k_res` and
    whether the 95 % `interval` held the twin's slope (1 or 0), each of every seed; `pictures`.
    Kept in `out` until the plan changes. Raises CalibrationError, StorageError."""
    seeds = QUICK_SEEDS if quick else SEEDS

    def make() -> dict[str, Any]:
        return _made(plan, seeds, out, progress)

    found: dict[str, Any] = once(out / "cords.json", digest(repr(plan), seeds), make)
    return found


def _made(plan: CordPlan, seeds: int, out: Path, progress: Progress) -> dict[str, Any]:
    truth, fits = truth_of(plan.k_res), []
    for seed in range(1, seeds + 1):
        progress("calibrate", (seed - 1) / seeds, f"specimens {seed} of {seeds}")
        fits.append(_calibrated(plan, truth, seed, out / f"specimens-{seed}"))
    intervals = [tuple(f.data["interval"]) for f in fits]
    cords: dict[str, dict[str, Any]] = {}
    drawn: dict[str, Stretched] = {}
    for name in plan.kinds:
        progress("stretch", 0.0, name)
        runs = [stretched(plan, name, seed) for seed in range(1, seeds + 1)]
        drawn[name] = runs[0]
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
        "fit": response_figure(fits[0].calibration, truth),
        "stretch": stretch_figure(drawn),
    }
    row = in_rows([("", list(pictures.values()))], ["bent on jigs", "stretched twice"], _WIDTH)
    write_pictures(out / "pictures", {"all": row, **pictures})
    progress("cords", 1.0, "done")
    return {"cords": cords, "truth": {"k_res": plan.k_res, "bends": _BENDS}, "pictures": pictures}


def truth_of(k_res: float) -> Response:
    """The twin's response: k_res times the strain at rest, and bending off exponentially, which
    none of the models that are fitted does."""
    strains = np.linspace(-0.12, 0.12, 97)
    changes = k_res * _BENDS * (1 - np.exp(-strains / _BENDS))
    changes[48] = strains[48] = 0.0
    spec = ResponseSpec("piecewise", {"strains": strains.tolist(), "changes": changes.tolist()})
    return build_response(spec)


def _calibrated(plan: CordPlan, truth: Response, seed: int, folder: Path) -> FittedResponse:
    """Sessions on specimens of all lengths, recorded by a twin, and the response fitted to them as
    to any others."""
    traits = CordTraits(truth)
    sessions = []
    for k, length in enumerate(plan.lengths):
        session = folder / f"{length:g}-mm"
        with storage_errors(session):
            if session.exists():
                shutil.rmtree(session)
        record_twin(
            session, traits, seed=1000 * seed + k, length=length, radii=plan.radii,
            rounds=plan.rounds,
        )  # fmt: skip
        sessions.append(session)
    return fit_response(sessions, out=folder / "response.json", seed=seed)
