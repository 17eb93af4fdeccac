"""What takes long, as it is done in a process of its own; each does what a command does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...core.progress import Progress

#: Lengths of specimens that are simulated, mm, and how their sessions' folders begin.
SPECIMENS, SIMULATED = (150.0, 200.0), "specimen-twin"


def record_twin(
    folder: Path, minutes: float, unit: int, seed: int, progress: Progress
) -> list[str]:
    """`defsense twin`: the sessions' folders."""
    from ...core.device.device_file import load_device
    from ...twin.recordings.twin_recordings import simulate_runs
    from ...workflow.sessions.twin_sessions import check_free, session_folder, write_sessions

    device = load_device(folder)
    out = session_folder(device, unit, seed)
    check_free(out, 1)
    made = simulate_runs(device, seconds=60 * minutes, seed=seed, unit=unit, progress=progress)
    return [str(path) for path in write_sessions(out, device, made, progress)]


def process(sessions: Sequence[Path], progress: Progress) -> list[str]:
    """`defsense capture process`: lines on each session."""
    from ...capture.sessions.results import REPORT
    from ...workflow.sessions.processing import process_session

    out = []
    for folder in sessions:
        q = process_session(folder, progress=progress).quality
        out.append(
            f"`{folder.name}`: {q['frames']} frames, {q['aligned_frames']:.0%} aligned to rest by"
            f" {q['aligned_by']}; look at `{(folder / REPORT).resolve()}`"
        )
        out += [f"`{folder.name}`: {warning}" for warning in q["warnings"]]
    return out


def train(folder: Path, sessions: Sequence[Path], progress: Progress) -> dict[str, Any]:
    """`defsense train`: the model's file, what its training tells, and notes."""
    from ...core.device.device_file import load_device
    from ...training.fitting.train_model import TrainingOptions
    from ...training.models.train_device import train_files
    from ...training.recordings.datasets import DataFiles

    files = DataFiles(tuple(sessions))
    made = train_files(files, load_device(folder), TrainingOptions(), progress=progress)
    return {
        "path": str(made.path.resolve()),
        "told": made.training.model.metadata,
        "notes": list(made.notes),
    }


def simulate(folder: Path, progress: Progress) -> dict[str, Any]:
    """`defsense train` without a session: the same of a model of the simulation alone."""
    from ...core.device.device_file import load_device
    from ...training.models.model_file import write_model
    from ...training.models.train_device import choose_model_path, simulate_only

    device = load_device(folder)
    progress("train", 0.0, "the simulated states")
    path, model = choose_model_path(None, device, []), simulate_only(device)
    write_model(path, model)
    return {"path": str(path.resolve()), "told": model.metadata, "notes": []}


def evaluate(
    folder: Path, model: Path, sessions: Sequence[Path], progress: Progress
) -> dict[str, Any]:
    """`defsense evaluate`: the page, the errors in a few numbers, mm, and notes."""
    from ...core.device.device_file import load_device
    from ...report.evaluation.evaluation_report import PAGE, check_folder, write_evaluation
    from ...training.evaluation.evaluate_models import evaluate_files
    from ...training.recordings.datasets import DataFiles

    out = model.parent / "evaluation"
    check_folder(out)
    found = evaluate_files(
        [model], DataFiles(tuple(sessions)), load_device(folder), progress=progress
    )
    progress("report", 0.0, "figures and tables")
    write_evaluation(out, found)
    total = found.models[0].evaluation.total
    numbers = {
        "RMSE": total.rmse, "SD": total.deviation, "peak": total.peak,
        "average peak": total.average_peak, "frames": total.frames,
    }  # fmt: skip
    return {"page": str((out / PAGE).resolve()), "numbers": numbers, "notes": list(found.notes)}


def simulate_specimens(folder: Path, progress: Progress) -> list[str]:
    """`defsense calibrate twin`: sessions of two specimens of the device's own cord."""
    from ...core.device.device_file import load_device
    from ...sensing.response import build_response
    from ...twin.calibration_session import record_twin
    from ...twin.electronics.cords import CordTraits

    traits = CordTraits(build_response(load_device(folder).cord.response), spread=0.02)
    out = []
    for n, length in enumerate(SPECIMENS):
        progress("specimen", n / len(SPECIMENS), f"{length:g} mm long")
        session = folder / f"{SIMULATED}-{length:g}"
        record_twin(session, traits, seed=1000 + n, length=length)
        out.append(session.name)
    return out


def fit(sessions: Sequence[Path], out: Path, progress: Progress) -> dict[str, Any]:
    """`defsense calibrate fit`: what `response.json` holds, and where it is."""
    from ...workflow.calibrate.fit_response import fit_response

    found = fit_response(sessions, out=out, progress=progress)
    return {"path": str(out), "page": str(out.with_suffix(".html").resolve()), "data": found.data}
