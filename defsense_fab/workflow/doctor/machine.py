"""Processor, memory, disk and cache."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

from .finding import Finding, judged
from .isolated import call

_GB = 1e9
_LEAST_DISK, _LEAST_MEMORY = 1.0, 2.0  # GB


def check_machine(seconds: float) -> list[Finding]:
    """Cores, memory, disk, and the cache of meshes."""
    return [_cores(), *_memory(), _disk(), _cache(seconds)]


def _cores() -> Finding:
    if sys.platform == "linux":
        count = len(os.sched_getaffinity(0))
    else:
        count = os.cpu_count() or 1
    return judged("machine", "cores", True, str(count))


def _memory() -> list[Finding]:
    """None where the system does not tell."""
    if sys.platform == "win32":
        return []
    size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / _GB
    told = f"{size:.1f} GB ({_LEAST_MEMORY:g} GB are asked for)"
    return [judged("machine", "memory", size >= _LEAST_MEMORY, told)]


def _disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / _GB
    told = f"{free:.1f} GB free in {Path.cwd()} ({_LEAST_DISK:g} GB are asked for)"
    return judged("machine", "disk", free >= _LEAST_DISK, told)


def _cache(seconds: float) -> Finding:
    """A cache that cannot be written costs time, and stops no build."""
    answer = call(__name__, "cache_folder", seconds=seconds)
    needed_for = "meshing a body only once"
    if answer.trouble:
        return judged("machine", "cache", False, answer.trouble, needed_for=needed_for)
    folder = Path(answer.value)
    try:
        there = next(p for p in (folder, *folder.parents) if p.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
        size = sum(p.stat().st_size for p in folder.glob("*.npz")) / _GB
    except OSError as error:
        return judged(
            "machine", "cache", False,
            f"{folder}: {error.strerror}; DEFSENSE_CACHE names a folder that may be written to",
            command=_set_cache(), needed_for=needed_for,
        )  # fmt: skip
    told = f"{folder} ({size:.2f} GB)"
    return judged("machine", "cache", True, told, needed_for=needed_for)


def _set_cache() -> str:
    folder = Path(tempfile.gettempdir()) / "defsense-cache"
    return f"set DEFSENSE_CACHE={folder}" if os.name == "nt" else f"export DEFSENSE_CACHE={folder}"


def cache_folder() -> str:
    """Where meshes are kept."""
    from ...geometry.bodies.meshing.mesh_store import folder

    return str(folder().resolve())
