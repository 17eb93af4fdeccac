"""Write animations in USD, as a mesh whose points have a sample for each recorded frame.

Lengths are in millimeters with z up, as declared in the stage's metadata (metersPerUnit 0.001,
upAxis Z). Time codes are the frame numbers. Between samples USD interpolates linearly. Normals are
omitted, which USD allows for meshes that are not subdivided: readers compute them from the points.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from ...core.errors import LiveError, StorageError
from ...core.machine.optional_libraries import optional
from ...core.storage.files import replace_file
from .animation import Animation, AnimationFile, Float32

_SAVE_INTERVAL_BYTES = 64e6  # of samples after which they are written, to limit the memory
_MIN_FREE_BYTES = 64e6  # on the disk; with less, a failure is reported as a full disk


def write_usd(path: Path, animation: Animation) -> AnimationFile:
    """Write an animation to a .usda file (text), or a .usd or .usdc file (binary).

    Raises:
        StorageError: The file cannot be written.
        LiveError: The package usd-core is not installed, or a position is not finite.
    """
    require_usd(path)
    from pxr import Tf

    with replace_file(path) as temporary:
        temporary.touch()  # gives the system's reason if it fails; USD would create folders
        try:
            _write(temporary, animation)
        except Tf.ErrorException as error:
            is_full = shutil.disk_usage(temporary.parent).free < _MIN_FREE_BYTES
            why = "the disk is full; free some space" if is_full else _last_words(error)
            raise StorageError(
                f"USD could not write it: {why}",
                code="disk-full" if is_full else "usd-write-failed",
                where=path,
            ) from None
        size = temporary.stat().st_size
    frames, seconds = len(animation.steps), float(np.ptp(animation.times))
    return AnimationFile(path, size, frames, seconds, 0.0)


def require_usd(path: Path) -> None:
    """Raise LiveError if the package that writes USD is not installed."""
    with optional(LiveError, path, "animation", "usd-core", "or choose .glb"):
        import pxr.Usd  # noqa: F401


def _write(path: Path, animation: Animation) -> None:
    from pxr import Sdf, Tf, Usd, UsdGeom, Vt

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.LinearUnits.millimeters)
    stage.SetTimeCodesPerSecond(animation.fps)
    stage.SetFramesPerSecond(animation.fps)
    stage.SetStartTimeCode(int(animation.steps[0]))
    stage.SetEndTimeCode(int(animation.steps[-1]))
    root = UsdGeom.Xform.Define(stage, Sdf.Path("/" + Tf.MakeValidIdentifier(animation.name)))
    stage.SetDefaultPrim(root.GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, root.GetPath().AppendChild("surface"))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(animation.faces)))
    mesh.CreateFaceVertexIndicesAttr(
        Vt.IntArray.FromNumpy(animation.faces.ravel().astype(np.int32))
    )
    rest = animation.rest.astype(np.float32)
    points, extent = mesh.CreatePointsAttr(_points(rest)), mesh.CreateExtentAttr(_extent(rest))
    unsaved = 0
    for part, _ in animation.chunks():
        for step, row in zip(animation.steps[part], animation.positions[part], strict=True):
            at = Usd.TimeCode(float(step))
            points.Set(_points(row), at)
            extent.Set(_extent(row), at)
            unsaved += row.nbytes
        # A text file would be rewritten as a whole each time.
        if unsaved > _SAVE_INTERVAL_BYTES and path.suffix != ".usda":
            stage.GetRootLayer().Save()
            unsaved = 0
    stage.GetRootLayer().Save()


def _points(vertices: Float32) -> object:
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices))


def _extent(vertices: Float32) -> object:
    return _points(np.stack([vertices.min(axis=0), vertices.max(axis=0)]))


def _last_words(error: Exception) -> str:
    """Return the end of USD's message, which starts with a place in its source."""
    return " ".join(str(error).split())[-200:]
