"""Solve poses by CalculiX: C3D10 elements, one step per increment, cut-backs within a step."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.problem import fractions

THREADS = 2
PROGRAM = "ccx"


def solve(
    nodes: np.ndarray,
    cells: np.ndarray,
    mu: float,
    kappa: float,
    fixed: np.ndarray,
    moved: np.ndarray,
    positions: Callable[[float], np.ndarray],
    increments: int | Sequence[float],
    folder: Path | None = None,
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return displacements (n, 3) mm at full load, and statistics.

    `substeps` are the increments into which CalculiX divides ours; `iterations` include those of
    cut-back attempts.

    Args:
        nodes: Nodes (n, 3) mm.
        cells: Quadratic tetrahedra (m, 10) in VTK's order.
        mu: Shear modulus, MPa.
        kappa: Bulk modulus, MPa.
        fixed: Indices of the fixed nodes.
        moved: Indices (k,) of the moved nodes.
        positions: Function of the load fraction t: displacements (k, 3) mm of the moved nodes.
        folder: Keeps input and output, if given.

    Raises:
        RuntimeError: The solver does not converge.
    """
    steps = fractions(increments)
    with tempfile.TemporaryDirectory() as scratch:
        work = folder or Path(scratch)
        job = work / "job"
        deck = _deck(nodes, cells, mu, kappa, fixed, moved, [positions(t) for t in steps])
        job.with_suffix(".inp").write_text(deck)
        for stale in (".dat", ".sta", ".cvg"):
            job.with_suffix(stale).unlink(missing_ok=True)
        start = time.perf_counter()
        ended = subprocess.run(
            [PROGRAM, "job"],
            cwd=work,
            env={**os.environ, "OMP_NUM_THREADS": str(THREADS)},
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - start
        errors = re.findall(r"\*ERROR[^\n]*(?:\n +[^\n]+)?", ended.stdout)
        substeps = _rows(job.with_suffix(".sta"), 7)
        process = len({row[0] for row in substeps})
        if ended.returncode != 0 or errors or process < len(steps):
            why = " ".join(errors[0].split()) if errors else f"ended with {ended.returncode}"
            raise RuntimeError(f"CalculiX in step {process + 1} of {len(steps)}: {why}")
        table = np.array(_rows(job.with_suffix(".dat"), 4))[-len(nodes) :]
        iterations = len(_rows(job.with_suffix(".cvg"), 4, exact=False))
    u = np.full(nodes.shape, np.nan)
    u[table[:, 0].astype(int) - 1] = table[:, 1:]
    if not np.isfinite(u).all():
        raise RuntimeError("CalculiX: the displacements are not finite")
    stats = {
        "seconds": seconds,
        "iterations": iterations,
        "increments": len(steps),
        "substeps": len(substeps),
        "version": _version(),
    }
    return u, stats


def _deck(
    nodes: np.ndarray,
    cells: np.ndarray,
    mu: float,
    kappa: float,
    fixed: np.ndarray,
    moved: np.ndarray,
    targets: list[np.ndarray],
) -> str:
    """Return the input; `targets` (k, 3) mm are displacements at the ends of steps."""
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(nodes, 1)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=BODY")
    lines += [", ".join(map(str, [i, *(c + 1)])) for i, c in enumerate(cells, 1)]
    lines += ["*NSET, NSET=FIXED", *(f"{n + 1}," for n in fixed)]
    lines += ["*MATERIAL, NAME=SOFT", "*HYPERELASTIC, NEO HOOKE"]
    lines += [f"{mu / 2:.12g}, {2 / kappa:.12g}", "*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT"]
    lines += ["*BOUNDARY", "FIXED, 1, 3, 0."]
    for step, target in enumerate(targets):
        # All of the step at once; CalculiX cuts back by itself where that fails.
        lines += ["*STEP, NLGEOM, INC=1000", "*STATIC", "1., 1.", "*BOUNDARY"]
        lines += [
            f"{n + 1}, {d + 1}, {d + 1}, {target[i, d]:.12g}"
            for i, n in enumerate(moved)
            for d in range(3)
        ]
        if step == len(targets) - 1:
            # A frequency above the number of increments prints the step's end only.
            lines += ["*NODE PRINT, NSET=ALL, FREQUENCY=1000000", "U"]
        lines.append("*END STEP")
    return "\n".join([*lines, ""])


def _rows(path: Path, columns: int, exact: bool = True) -> list[list[float]]:
    """Return the lines of a file with that many numbers (or more, if not `exact`)."""
    out = []
    for line in path.read_text().splitlines() if path.exists() else []:
        words = line.split()
        if len(words) == columns or (not exact and len(words) > columns):
            try:
                out.append([float(w) for w in words])
            except ValueError:  # a heading
                continue
    return out


def _version() -> str:
    output = subprocess.run([PROGRAM, "-v"], capture_output=True, text=True).stdout
    values = re.search(r"Version (\S+)", output)
    return f"CalculiX {values[1] if values else 'of an unknown version'}"
