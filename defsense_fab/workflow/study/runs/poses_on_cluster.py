"""A device's poses solved by the workers of a cluster, where one machine is too slow for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from ....core.errors import StudyError
from ....mechanics.elements.material import Material
from ....mechanics.elements.tet10 import QuadraticMesh
from ....mechanics.solver.batch import Job
from ....mechanics.solver.load_stepping import Equilibrium
from .cluster import Work, connected, work_on_cluster
from .pose_solves import packed, unpacked


def solve_on_cluster(
    address: str,
    note: Callable[[str], None],
    mesh: QuadraticMesh,
    material: Material,
    jobs: Sequence[Job],
    on_step: Callable[[int, float], None] | None = None,
) -> list[list[Equilibrium]]:
    """What `solve_all` gives, each job solved by a worker of the cluster at an `address`; `note` is
    told of workers that go.

    Raises StudyError where the cluster cannot be used, and where a job takes several workers with
    it.
    """
    results: list[list[Equilibrium]] = [[] for _ in jobs]

    def done(i: int, data: bytes) -> None:
        results[i] = unpacked(data)
        if on_step is not None:
            on_step(i, 1.0)

    def lost(i: int, workers: int) -> list[int]:
        raise StudyError(
            f"{workers} workers died on {jobs[i].name}, perhaps for want of memory; use a larger"
            " [mesh] edge_length, or workers with more memory"
        )

    work = Work("pose", lambda i: (packed(mesh, material, jobs[i]),), done, lost)
    with connected(address) as client:
        work_on_cluster(client, range(len(jobs)), work, note)
    return results


def cluster_solver(
    address: str, note: Callable[[str], None]
) -> Callable[..., list[list[Equilibrium]]]:
    """`solve_on_cluster` as a build takes it."""
    return partial(solve_on_cluster, address, note)
