"""From tables and sessions to `response.json` and its report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration import session as sessions
from ...calibration.calibrate import SPREAD, Calibration, calibrate
from ...calibration.protocol import Creep
from ...calibration.reading_checks import Policy
from ...calibration.readings import Geometry, Readings, half_width, joined
from ...calibration.readings_table import read_table
from ...core.errors import CalibrationError
from ...core.progress import Progress, silent
from ...core.storage.files import digest, storage_errors, write_json, write_text
from ...core.storage.session_manifest import FILE
from ...core.version import __version__


@dataclass(frozen=True)
class FittedResponse:
    """The calibration, what it was made of, creep in the sessions' holds by cord, and what
    `response.json` holds."""

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
    spread: float = SPREAD,
    seed: int = 1,
    progress: Progress = silent,
) -> FittedResponse:
    """Fit the response to all `sources`, tables or session folders; write `out` and, beside it, its
    report. `geometry` and `radii` (mm) are those of the specimens in tables.

    Raises CalibrationError for what cannot be read or used, before anything is written.
    """
    whole = [s.resolve() for s in sources]
    twice = next((s for s, w in zip(sources, whole, strict=True) if whole.count(w) > 1), None)
    if twice is not None:
        raise CalibrationError(f"{twice}: is given twice, and would count twice; give it once")
    if out is not None:
        _check_out(out, sources)
    parts: list[Readings] = []
    hashed: list[Path] = []
    creeps: list[tuple[str, Creep]] = []
    warnings: list[str] = []
    for n, source in enumerate(sources):
        progress("read", n / len(sources), source.name)
        if source.is_dir():
            measured = sessions.measure(source)
            parts.append(measured.readings)
            creeps += measured.creeps
            hashed += [source / FILE, source / sessions.FRAMES]
            if measured.unsettled:
                warnings.append(
                    f"{source.name}: {measured.unsettled} readings were taken before they settled"
                )
        else:
            readings, notes = read_table(source, geometry or Geometry(), radii)
            parts.append(readings)
            warnings += map(str, notes)
            hashed.append(source)
    progress("fit", 0.0, "models")
    rng = np.random.default_rng(seed)
    found = calibrate(joined(parts), policy=policy, model=model, spread=spread, rng=rng)
    progress("fit", 1.0, "done")
    data = describe(
        found, sources, creeps, digest(*hashed), (*warnings, *map(str, found.warnings)), spread
    )
    data["seed"] = seed
    fitted = FittedResponse(found, tuple(sources), tuple(creeps), data)
    if out is not None:
        from ...report.calibration_page import page

        text = page(found, data)
        with storage_errors(out):
            write_text(out.with_suffix(".html"), text)
            write_json(out, data)
    return fitted


def _check_out(out: Path, sources: Sequence[Path]) -> None:
    """Raises CalibrationError for a place that the result must not go to."""
    if out.suffix != ".json" or out.is_dir():
        raise CalibrationError(f"--out {out}: give the name of a file that ends with .json")
    report = out.with_suffix(".html")
    for source in sources:
        if source.resolve() in (out.resolve(), report.resolve()):
            raise CalibrationError(f"--out {out}: would overwrite {source}; choose another name")
    if report.is_dir():
        raise CalibrationError(f"{report}: is a folder, and the report would go there; rename it")
    with storage_errors(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        if not os.access(out.parent, os.W_OK):
            raise CalibrationError(f"--out {out}: {out.parent} may not be written to")


def describe(
    found: Calibration,
    sources: Sequence[Path],
    creeps: Sequence[tuple[str, Creep]],
    raw: str,
    warnings: Sequence[str],
    spread: float,
) -> dict[str, Any]:
    """`response.json`: what `core/response.py` reads, and where it comes from."""
    d = found.doubt
    outer = [p for p, gain in zip(found.pieces, found.gains, strict=True) if np.isfinite(gain)]
    lasting = [c for _, c in creeps if np.isfinite(c.time)]
    chosen = found.tried[found.response.model].fitted
    return {
        "schema": 1,
        **found.response.to_json(),
        "k_res": found.k_res,
        "interval": list(d.interval),
        "doubt": {"readings": d.within, "pieces": d.pieces, "assumed": d.assumed, "model": d.model,
                  "spread_assumed": spread},
        "standard_errors": d.errors.tolist(),
        "noise": found.noise,
        "reason": found.reason,
        "models": {
            name: {
                "left_out_error": t.left_out,
                "deviance": t.deviance,
                "coefficients": t.fitted.model.spec(
                    t.fitted.theta, found.response.strain_range
                ).to_json()["coefficients"],
            }
            for name, t in found.tried.items()
        },
        "neutral_drift": found.drift.largest,
        "neutral_at": found.drift.at,
        "hysteresis": half_width(chosen.memory) if found.data.memory.any() else None,
        "creep": {
            "time": float(np.median([c.time for c in lasting])),
            "part": float(np.median([c.start / c.end for c in lasting])),
            "holds": len(lasting),
        }
        if lasting
        else None,
        "pieces": [
            {"specimen": p.specimen, "cord": p.place, "gain": float(g)}
            for p, g in zip(outer, found.gains[np.isfinite(found.gains)], strict=True)
        ],
        "radii": found.readings.radii.tolist(),
        "readings": len(found.readings.where),
        "sources": [str(s) for s in sources],
        "raw_hash": raw,
        "version": __version__,
        "warnings": list(warnings),
    }  # fmt: skip
