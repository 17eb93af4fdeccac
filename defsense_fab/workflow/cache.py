"""Clear the caches of this machine: meshes, solved poses and machine code."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..core.machine.compiled import kept_code
from ..core.storage.kept_files import delete, size_of


@dataclass(frozen=True)
class ClearedCache:
    """The deleted files of one kind.

    Attributes:
        kind: "meshes", "solved poses" or "compiled code".
        folders: The folders that held it.
        count: Number of deleted files, or of modules with compiled code.
        bytes: Their size.
        left: Number of those that could not be deleted.
    """

    kind: str
    folders: tuple[str, ...]
    count: int
    bytes: int
    left: int


def clear_cache() -> list[ClearedCache]:
    """Delete everything that this package has cached on this machine.

    The next builds make it again. Files of devices, builds and recordings are not touched.

    Returns:
        The deleted files, by kind.
    """
    return [_clear(kind, paths()) for kind, paths in _kinds()]


def _kinds() -> Iterator[tuple[str, Callable[[], list[Path]]]]:
    from ..geometry.bodies.meshing.mesh_store import cached_meshes
    from ..mechanics.solver.solved_jobs import kept_jobs

    yield "meshes", cached_meshes
    yield "solved poses", kept_jobs
    yield "compiled code", kept_code


def _clear(kind: str, paths: list[Path]) -> ClearedCache:
    sizes = [size_of(path) for path in paths]
    gone = [delete(path) for path in paths]
    folders = tuple(sorted({str(path.parent) for path in paths}))
    freed = sum(size for size, is_gone in zip(sizes, gone, strict=True) if is_gone)
    return ClearedCache(kind, folders, sum(gone), freed, len(gone) - sum(gone))
