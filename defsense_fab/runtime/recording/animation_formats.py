"""Animation files by their suffix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.errors import LiveError
from ...core.storage.files import replacing
from .animation import Animation, AnimationFile
from .gltf_animation import write_gltf
from .usd_animation import require_usd, write_usd

_USD = (".usd", ".usda", ".usdc")
SUFFIXES = (".glb", *_USD, ".npz")


def check_suffix(path: Path) -> None:
    """Raises LiveError where a file of this name could not be written: of an unknown suffix, or
    one whose package is missing."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise LiveError(
            f"unknown animation format {suffix!r}",
            code="unknown-format",
            where=path,
            action=f"Use one of {', '.join(SUFFIXES)}",
            suffix=suffix,
        )
    if suffix in _USD:
        require_usd(path)


def write_animation(path: Path, animation: Animation) -> AnimationFile:
    """To the format of its suffix, whole or not at all. Raises StorageError, LiveError."""
    check_suffix(path)
    suffix = path.suffix.lower()
    if suffix == ".glb":
        return write_gltf(path, animation)
    return write_usd(path, animation) if suffix in _USD else _write_npz(path, animation)


def _write_npz(path: Path, animation: Animation) -> AnimationFile:
    """`rest` (v, 3) and `positions` (n, v, 3) mm, `faces` (f, 3), `times` (n,) s."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            rest=animation.rest,
            faces=animation.faces,
            positions=animation.positions,
            times=animation.times,
        )
        size = file.tell()
    frames, seconds = len(animation.steps), float(np.ptp(animation.times))
    return AnimationFile(path, size, frames, seconds, 0.0)
