"""Fit the response to tables and sessions, and write `response.json` with its report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration.calibrate import Calibration, calibrate
from ...calibration.protocol import Creep
from ...calibration.readings import (
    Geometry,
    Readings,
    hysteresis_half_width,
    join_readings,
)
from ...calibration.readings_table import read_table
from ...calibration.session import FRAMES
from ...calibration.session_readings import read_session
from ...core.errors import CalibrationError
from ...core.progress import Notice, Progress, silent
from ...core.response import SCHEMA
from ...core.storage.files import digest, storage_errors, write_json, write_text
from ...core.storage.session_manifest import FILE
from ...core.version import __version__
from .options import FitOptions, TableOptions

_DEFAULT_TABLES, _DEFAULT_FIT = TableOptions(), FitOptions()


@dataclass(frozen=True)
class FittedResponse:
    """A fitted response.

    Attributes:
        calibration: The calibration.
        data: Content of `response.json`.
        file: `response.json`; None if it was not written. The report is next to it.
    """

    calibration: Calibration
    data: dict[str, Any]
    file: Path | None

    @property
    def page(self) -> Path | None:
        """File of the report; None if it was not written."""
        return None if self.file is None else self.file.with_suffix(".html")


def fit_response(
    sources: Sequence[Path],
    out: Path | None = None,
    *,
    tables: TableOptions = _DEFAULT_TABLES,
    options: FitOptions = _DEFAULT_FIT,
    seed: int = 1,
    progress: Progress = silent,
) -> FittedResponse:
    """Fit the response to all sources.

    Args:
        sources: Tables and session folders.
        out: File to write, `response.json`; its report is written next to it.
        tables: Specimens and jigs of tables.
        options: Options of the fit.
        seed: Seed of the bootstrap.
        progress: Called with the progress.

    Returns:
        The response.

    Raises:
        CalibrationError: A source cannot be read or used; nothing is written then.
        StorageError: A file cannot be written.
    """
    _check_different(sources)
    if out is not None:
        _check_out(out, sources)
    readings, creeps, notices = _read_sources(sources, tables, progress)
    progress("fit", 0.0, "models")
    calibration = calibrate(readings, options, rng=np.random.default_rng(seed))
    progress("fit", 1.0, "done")
    data = {
        **_describe(calibration, options, creeps),
        "sources": [str(s) for s in sources],
        "raw_hash": digest(*(file for s in sources for file in _files(s))),
        "version": __version__,
        "warnings": [*map(str, notices), *map(str, calibration.warnings)],
        "seed": seed,
    }
    if out is not None:
        from ...report.calibration_page import page

        text = page(calibration, data)
        with storage_errors(out):
            write_text(out.with_suffix(".html"), text)
            write_json(out, data)
    return FittedResponse(calibration, data, out)


def _read_sources(
    sources: Sequence[Path], tables: TableOptions, progress: Progress
) -> tuple[Readings, list[Creep], list[Notice]]:
    """Return the readings of all sources, the creep in the sessions' holds, and notices."""
    readings: list[Readings] = []
    creeps: list[Creep] = []
    notices: list[Notice] = []
    for n, source in enumerate(sources):
        progress("read", n / len(sources), source.name)
        if source.is_dir():
            session = read_session(source)
            readings.append(session.readings)
            creeps += session.creeps
            if session.unsettled:
                text = f"{source.name}: {session.unsettled} readings had not settled"
                notices.append(Notice("readings-unsettled", text))
        else:
            geometry = Geometry(tables.thickness, tables.offset)
            table, table_notices = read_table(source, geometry, tables.radii)
            readings.append(table)
            notices += table_notices
    return join_readings(readings), creeps, notices


def _files(source: Path) -> tuple[Path, ...]:
    """Return the files of a table or a session."""
    return (source / FILE, source / FRAMES) if source.is_dir() else (source,)


def _check_different(sources: Sequence[Path]) -> None:
    resolved = [s.resolve() for s in sources]
    for source, path in zip(sources, resolved, strict=True):
        if resolved.count(path) > 1:
            raise CalibrationError(
                "is given twice, and would count twice",
                code="source-repeated",
                where=source,
                action="Give each source once",
            )


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


def _describe(
    calibration: Calibration, options: FitOptions, creeps: Sequence[Creep]
) -> dict[str, Any]:
    """Return the content of `response.json`, without its origin."""
    uncertainty = calibration.uncertainty
    significant = [c for c in creeps if np.isfinite(c.time)]
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
            "spread_assumed": options.spread / 100,
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
            for p, g in zip(calibration.pieces, calibration.gains, strict=True)
            if np.isfinite(g)
        ],
        "radii": calibration.readings.radii.tolist(),
        "readings": len(calibration.readings.where),
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
