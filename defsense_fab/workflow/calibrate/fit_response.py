"""Fit the response to tables and sessions, and write `response.json` with its report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration.calibrate import ASSUMED_SPREAD, Calibration, calibrate
from ...calibration.protocol import Creep
from ...calibration.reading_checks import Policy
from ...calibration.readings import (
    Geometry,
    Notice,
    Readings,
    hysteresis_half_width,
    join_readings,
)
from ...calibration.readings_table import read_table
from ...calibration.session import FRAMES
from ...calibration.session_readings import read_session
from ...core.errors import CalibrationError
from ...core.progress import Progress, silent
from ...core.response import SCHEMA
from ...core.storage.files import digest, storage_errors, write_json, write_text
from ...core.storage.session_manifest import FILE
from ...core.version import __version__


@dataclass(frozen=True)
class FittedResponse:
    """A fitted response.

    Attributes:
        calibration: The calibration.
        sources: Tables and session folders.
        creeps: Creep in the sessions' holds, with the cord's position.
        data: Content of `response.json`.
    """

    calibration: Calibration
    sources: tuple[Path, ...]
    creeps: tuple[tuple[str, Creep], ...]
    data: dict[str, Any]


def fit_response(
    sources: Sequence[Path],
    *,
    out: Path | None = None,
    geometry: Geometry | None = None,
    radii: Sequence[float] | None = None,
    policy: Policy = "refuse",
    model: str | None = None,
    spread: float = ASSUMED_SPREAD,
    seed: int = 1,
    progress: Progress = silent,
) -> FittedResponse:
    """Fit the response to all sources.

    Args:
        sources: Tables and session folders.
        out: File to write, `response.json`; its report is written next to it.
        geometry: Geometry of the specimens in tables.
        radii: Radii of the jigs in tables, mm.
        policy: What to do about a significant drift of the neutral cord.
        model: Model to use instead of the chosen one.
        spread: Assumed standard deviation between specimens.
        seed: Seed of the bootstrap.
        progress: Called with the progress.

    Returns:
        The response.

    Raises:
        CalibrationError: A source cannot be read or used; nothing is written then.
        StorageError: A file cannot be written.
    """
    resolved = [s.resolve() for s in sources]
    for source, path in zip(sources, resolved, strict=True):
        if resolved.count(path) > 1:
            raise CalibrationError(
                "is given twice, and would count twice",
                code="duplicate-source",
                where=source,
                action="Give each source once",
            )
    if out is not None:
        _check_out(out, sources)
    parts: list[Readings] = []
    hashed: list[Path] = []
    creeps: list[tuple[str, Creep]] = []
    notices: list[Notice] = []
    for n, source in enumerate(sources):
        progress("read", n / len(sources), source.name)
        if source.is_dir():
            session = read_session(source)
            parts.append(session.readings)
            creeps += session.creeps
            hashed += [source / FILE, source / FRAMES]
            if session.unsettled:
                text = f"{source.name}: {session.unsettled} readings had not settled"
                notices.append(Notice("readings-unsettled", text))
        else:
            readings, table_notices = read_table(source, geometry or Geometry(), radii)
            parts.append(readings)
            notices += table_notices
            hashed.append(source)
    progress("fit", 0.0, "models")
    rng = np.random.default_rng(seed)
    calibration = calibrate(
        join_readings(parts), policy=policy, model=model, spread=spread, rng=rng
    )
    progress("fit", 1.0, "done")
    warnings = [*map(str, notices), *map(str, calibration.warnings)]
    data = describe(calibration, sources, creeps, digest(*hashed), warnings, spread)
    data["seed"] = seed
    fitted = FittedResponse(calibration, tuple(sources), tuple(creeps), data)
    if out is not None:
        from ...report.calibration_page import page

        text = page(calibration, data)
        with storage_errors(out):
            write_text(out.with_suffix(".html"), text)
            write_json(out, data)
    return fitted


def _check_out(out: Path, sources: Sequence[Path]) -> None:
    """Check that the result and its report can be written without overwriting a source."""
    if out.suffix != ".json" or out.is_dir():
        raise CalibrationError(
            "is not a name for the result",
            code="not-json-name",
            where=out,
            action="Give the name of a file that ends with .json",
        )
    report = out.with_suffix(".html")
    for source in sources:
        if source.resolve() in (out.resolve(), report.resolve()):
            raise CalibrationError(
                f"the result or its report would overwrite {source}",
                code="overwrites-source",
                where=out,
                action="Choose another name",
            )
    if report.is_dir():
        raise CalibrationError(
            "is a folder, where the report would be written",
            code="not-a-file",
            where=report,
            action="Rename the folder, or choose another name for the result",
        )
    with storage_errors(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        if not os.access(out.parent, os.W_OK):
            raise CalibrationError(
                "does not accept files",
                code="permission-denied",
                where=out.parent,
                action="Change its permissions, or choose another folder",
                path=out.parent,
            )


def describe(
    calibration: Calibration,
    sources: Sequence[Path],
    creeps: Sequence[tuple[str, Creep]],
    raw_hash: str,
    warnings: Sequence[str],
    spread: float,
) -> dict[str, Any]:
    """Return the content of `response.json`.

    Args:
        calibration: The calibration.
        sources: Tables and session folders.
        creeps: Creep in the sessions' holds, with the cord's position.
        raw_hash: Hash of the sources' content.
        warnings: Doubts about the readings and the fit.
        spread: Assumed standard deviation between specimens.

    Returns:
        The data that `core/response.py` reads, and their origin.
    """
    uncertainty = calibration.uncertainty
    is_known = np.isfinite(calibration.gains)
    outer = [p for p, known in zip(calibration.pieces, is_known, strict=True) if known]
    significant = [c for _, c in creeps if np.isfinite(c.time)]
    fit = calibration.trials[calibration.response.model].fit
    has_memory = bool(calibration.data.memory.any())
    creep = None
    if significant:
        creep = {
            "time": float(np.median([c.time for c in significant])),
            "part": float(np.median([c.start / c.end for c in significant])),
            "holds": len(significant),
        }
    return {
        "schema": SCHEMA,
        **calibration.response.to_json(),
        "k_res": calibration.k_res,
        "interval": list(uncertainty.interval),
        "doubt": {
            "readings": uncertainty.within,
            "pieces": uncertainty.pieces,
            "assumed": uncertainty.assumed,
            "model": uncertainty.model,
            "spread_assumed": spread,
        },
        "standard_errors": uncertainty.errors.tolist(),
        "noise": calibration.noise,
        "reason": calibration.reason,
        "models": _describe_models(calibration),
        "neutral_drift": calibration.drift.largest,
        "neutral_at": calibration.drift.at,
        "hysteresis": hysteresis_half_width(fit.memory) if has_memory else None,
        "creep": creep,
        "pieces": [
            {"specimen": p.specimen, "cord": p.place, "gain": float(g)}
            for p, g in zip(outer, calibration.gains[is_known], strict=True)
        ],
        "radii": calibration.readings.radii.tolist(),
        "readings": len(calibration.readings.where),
        "sources": [str(s) for s in sources],
        "raw_hash": raw_hash,
        "version": __version__,
        "warnings": list(warnings),
    }


def _describe_models(calibration: Calibration) -> dict[str, Any]:
    """Return the error, deviance and coefficients of every model."""
    strains = calibration.response.strain_range
    return {
        name: {
            "left_out_error": trial.left_out_rmse,
            "deviance": trial.deviance,
            "coefficients": trial.fit.model.spec(trial.fit.theta, strains).to_json()[
                "coefficients"
            ],
        }
        for name, trial in calibration.trials.items()
    }
