"""The work of a cluster's worker: plain values and bytes in, plain values and bytes out.

Poses are pickled, like everything that Dask sends: the scheduler and its workers are trusted.
"""

from __future__ import annotations

import json
import pickle
import platform
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import numpy as np

from ....core.errors import DefsenseError
from ....core.mesh import TetMesh
from ....core.version import __version__
from ....mechanics.elements.material import Material
from ....mechanics.elements.tet10 import QuadraticMesh
from ....mechanics.solver.batch import Job, solve_all
from ....mechanics.solver.load_stepping import Equilibrium
from ...build import stages
from .batch import Batch, run_batch
from .run_log import encode_record


def installed_versions() -> dict[str, str]:
    """Return the versions of all software that influences the result of a run, by name.

    They are those of the package, of its results, and of the libraries of all stages that runs use
    ("none" if one is not installed). All machines of a study must have the same.
    """
    python = ".".join(platform.python_version_tuple()[:2])
    versions = {
        "defsense-fab": __version__,
        "its results": str(stages.CODE_VERSION),
        "Python": python,
    }
    for stage, libraries in stages.installed_versions().items():
        if stage != "report":
            versions |= {name: version or "none" for name, version in libraries}
    return versions


def find_difference(expected: Mapping[str, str], actual: Mapping[str, str]) -> str | None:
    """Return the first version that differs, as a phrase; None if there is none."""
    for name, version in expected.items():
        if actual.get(name) != version:
            return f"{name} {actual.get(name, 'none')} instead of {version}"
    return None


def work_off(what: str, expected: Mapping[str, str], *arguments: Any) -> dict[str, Any]:
    """Do a piece of work.

    Args:
        what: `batch` for a batch of runs, `pose` for the solution of a pose.
        expected: Versions of the software (see `installed_versions`).
        arguments: Arguments of the work.

    Returns:
        The `result`: records of runs as lines, or equilibria as bytes; or `refused` if the software
        differs, or `failed` if the work fails, with the reason in words.
    """
    difference = find_difference(expected, installed_versions())
    if difference:
        return {"refused": f"has {difference}"}
    try:
        result = solve_packed_job(*arguments) if what == "pose" else _run_packed_batch(*arguments)
        return {"result": result}
    except (DefsenseError, OSError, MemoryError) as error:
        return {"failed": str(error) or "its memory does not suffice"}


def _run_packed_batch(batch: str, files: bytes) -> list[str]:
    records = run_batch(msgspec.json.decode(batch, type=Batch), files)
    return [encode_record(r) for r in records]


def sendable_functions() -> tuple[Callable[..., dict[str, Any]], Callable[[], dict[str, str]]]:
    """Return `work_off` and `installed_versions` as functions that are sent whole.

    Neither the scheduler nor a worker needs this package to receive them; a worker without it
    reports that.
    """

    def work(what: str, expected: dict[str, str], *arguments: Any) -> dict[str, Any]:
        try:
            from defsense_fab.workflow.study.runs.worker import work_off
        except ImportError as error:
            return {"refused": f"has no defsense-fab that works for others ({error})"}
        return work_off(what, expected, *arguments)

    def versions() -> dict[str, str]:
        try:
            from defsense_fab.workflow.study.runs.worker import installed_versions
        except ImportError:
            return {}
        return installed_versions()

    return work, versions


def encode_batch(batch: Batch) -> str:
    """Return a batch as text that is sent."""
    return json.dumps(msgspec.to_builtins(batch))


def pack_job(mesh: QuadraticMesh, material: Material, job: Job) -> bytes:
    """Return all that a worker needs to solve a job.

    The corners and the tets of the mesh are sent, from which the same quadratic mesh is made.
    """
    tets = mesh.cells[:, :4]
    corners = mesh.nodes[: int(tets.max()) + 1]
    compact = tets.astype(np.int32), tets.dtype.str
    return zlib.compress(pickle.dumps((corners, *compact, material, job), protocol=5), 1)


def solve_packed_job(data: bytes) -> bytes:
    """Solve the job of `pack_job`; return the packed equilibria.

    Raises:
        DefsenseError: The solver fails.
    """
    corners, tets, dtype, material, job = pickle.loads(zlib.decompress(data))  # noqa: S301
    mesh = QuadraticMesh.from_linear(TetMesh(corners, tets.astype(dtype)))
    return zlib.compress(pickle.dumps(solve_all(mesh, material, [job])[0], protocol=5), 1)


def unpack_equilibria(data: bytes) -> list[Equilibrium]:
    """Return the equilibria of `solve_packed_job`."""
    equilibria: list[Equilibrium] = pickle.loads(zlib.decompress(data))  # noqa: S301
    return equilibria
