"""Keep solved jobs in the cache, so that an interrupted solve resumes, and an edit solves less."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from platformdirs import user_cache_path

from ...core.errors import StorageError
from ...core.storage.files import DIGEST_PATTERN, digest, replace_file
from ...core.storage.kept_files import delete_oldest
from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State
from .batch import Job, Solve
from .linear_solver import solver_name
from .load_stepping import Equilibrium, SolveStatistics, Status

#: Raised when the files change.
_FILE_VERSION = 1
#: Size of all files; the oldest are deleted.
MAX_KEPT_BYTES = 500_000_000
_UNREADABLE = (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile)


def kept_folder() -> Path:
    """Return the folder of the machine's cache in which solved jobs are kept."""
    folder = os.environ.get("DEFSENSE_CACHE")
    return (Path(folder) if folder else user_cache_path("defsense-fab")) / "solved"


def kept_jobs() -> list[Path]:
    """Return the files of the solved jobs that are kept."""
    return list(kept_folder().glob(f"{DIGEST_PATTERN}.npz"))


@contextlib.contextmanager
def keep_solved_jobs(
    version: object, report: Callable[[str], None] | None = None
) -> Iterator[SolvedJobs]:
    """Keep the jobs that are solved in a block, and delete them at its end.

    If the block is interrupted or fails, they stay, and the next block solves only the others.

    Args:
        version: Version of the caller's results; jobs of another one are solved again.
        report: Called with a message if jobs were solved before.
    """
    kept = SolvedJobs(version, report)
    yield kept
    kept.discard()


class SolvedJobs:
    """Solved jobs in the cache of the machine, by everything that they depend on.

    Args:
        version: Version of the caller's results.
        report: Called with a message if jobs were solved before.
    """

    def __init__(self, version: object, report: Callable[[str], None] | None = None) -> None:
        self._version, self._report = version, report
        self._folder = kept_folder()
        self._paths: set[Path] = set()

    def solve(
        self,
        solve: Solve,
        mesh: QuadraticMesh,
        material: Material,
        jobs: Sequence[Job],
        on_step: Callable[[int, float], None] | None = None,
    ) -> list[list[Equilibrium]]:
        """Solve jobs as `solve` does, except those that were solved before.

        Args:
            solve: `solve_all`, or a function that does the same elsewhere.
            mesh: Mesh of the body.
            material: Its material.
            jobs: Poses to solve.
            on_step: Called with the number of a job and the fraction it has reached.

        Returns:
            The equilibria of each job, bit for bit those of `solve`.
        """
        body = digest(
            _FILE_VERSION, self._version, solver_name(), *map(_plain, (mesh.nodes, mesh.cells))
        )
        paths = [self._path(body, material, job) for job in jobs]
        self._paths.update(paths)
        results = [_load(path, job.conditions) for path, job in zip(paths, jobs, strict=True)]
        remaining = [i for i, result in enumerate(results) if not result]
        solved = len(jobs) - len(remaining)
        if solved and self._report is not None:
            self._report(f"{solved} of {len(jobs)} paths were solved before")
        if on_step is not None:
            for i in set(range(len(jobs))) - set(remaining):
                on_step(i, 1.0)
        if not remaining:
            return results
        new = solve(
            mesh,
            material,
            [jobs[i] for i in remaining],
            (lambda k, fraction: on_step(remaining[k], fraction)) if on_step else None,
            on_solved=lambda k, equilibria: self._save(paths[remaining[k]], equilibria),
        )
        for i, equilibria in zip(remaining, new, strict=True):
            results[i] = equilibria
        return results

    def discard(self) -> None:
        """Delete the jobs that were loaded or solved."""
        for path in self._paths:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)

    def _path(self, body: str, material: Material, job: Job) -> Path:
        key = digest(body, _plain(material), _plain(job.conditions), job.fractions, job.budget)
        return self._folder / f"{key}.npz"

    def _save(self, path: Path, equilibria: Sequence[Equilibrium]) -> None:
        """Keep a job if possible: an unwritable cache must not stop the solve."""
        if any(e.status is Status.CANCELLED for e in equilibria):
            return
        with contextlib.suppress(OSError, StorageError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with replace_file(path) as temporary:
                np.savez(temporary, **_to_arrays(equilibria))  # type: ignore[arg-type]
            delete_oldest(kept_jobs(), MAX_KEPT_BYTES)


def _plain(value: Any) -> Any:
    """Return a value with a stable `repr`: records as lists, arrays with their bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return [(f.name, _plain(getattr(value, f.name))) for f in fields(value)]
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value


def _to_arrays(equilibria: Sequence[Equilibrium]) -> dict[str, np.ndarray]:
    """Return the states of equilibria by number, and all other fields as JSON."""
    arrays: dict[str, np.ndarray] = {}
    records = []
    for k, e in enumerate(equilibria):
        states = {"state": e.state, "last_state": e.last_state}
        for name, state in states.items():
            if state is not None:
                arrays |= {f"{k}/{name}/{n}": a for n, a in _state_arrays(state).items()}
        records.append(
            {
                "status": str(e.status),
                "amplitude": e.amplitude,
                "statistics": asdict(e.statistics),
                "problem": e.problem,
                "states": [name for name, state in states.items() if state is not None],
            }
        )
    return arrays | {"record": np.array(json.dumps(records))}


def _load(path: Path, conditions: BoundaryConditions) -> list[Equilibrium]:
    """Return the equilibria of a job with these conditions; none if the file cannot be read."""
    try:
        with path.open("rb") as file, np.load(file) as data:
            with contextlib.suppress(OSError):
                os.utime(path)  # the oldest are deleted first
            return [
                Equilibrium(
                    Status(record["status"]),
                    amplitude=record["amplitude"],
                    statistics=SolveStatistics(**record["statistics"]),
                    problem=record["problem"],
                    **{"state": None}
                    | {n: _load_state(data, f"{k}/{n}/", conditions) for n in record["states"]},
                )
                for k, record in enumerate(json.loads(str(data["record"])))
            ]
    except _UNREADABLE:
        return []


def _state_arrays(state: State) -> dict[str, np.ndarray]:
    """Return a state as arrays; of its conditions those values that change on the way."""
    c = state.conditions
    motions = [[h.rotation, h.translation, h.further_translation] for h in c.handles]
    return {
        "u": state.u,
        "rotations": state.rotations,
        "translations": state.translations,
        "motions": np.array(motions).reshape(-1, 3, 3),
        "drags": np.array([d.by for d in c.drags]).reshape(-1, 3),
        "pressures": np.array([p.value for p in c.pressures]),
        "gravity": c.gravity,
    }


def _load_state(data: Any, prefix: str, conditions: BoundaryConditions) -> State:
    motions, drags, pressures = (data[prefix + n] for n in ("motions", "drags", "pressures"))
    reached = replace(
        conditions,
        handles=tuple(
            replace(h, rotation=m[0], translation=m[1], further_translation=m[2])
            for h, m in zip(conditions.handles, motions, strict=True)
        ),
        drags=tuple(replace(d, by=by) for d, by in zip(conditions.drags, drags, strict=True)),
        pressures=tuple(
            replace(p, value=float(v)) for p, v in zip(conditions.pressures, pressures, strict=True)
        ),
        gravity=data[prefix + "gravity"],
    )
    u, rotations, translations = (data[prefix + n] for n in ("u", "rotations", "translations"))
    return State(u, rotations, translations, reached)
