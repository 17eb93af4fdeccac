"""Cameras as OpenCV has them: pinhole, radial and tangential distortion, and where they stand.

A point X (mm, world) is at R X + t in the camera's frame (x to the right, y down, z ahead), at
x = X/Z, y = Y/Z on the plane at depth one, distorted by k1, k2, p1, p2, k3[, k4, k5, k6], and seen
at K (x, y, 1) in pixels, whose centres have whole numbers (Brown 1966; OpenCV's calib3d). A fisheye
shows what is at an angle a from its axis at a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8), in the same
direction (Kannala & Brandt 2006; OpenCV's fisheye); here up to 90 degrees.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .arrays import Float
from .errors import CaptureError
from .storage.file_names import FORBIDDEN, folded, is_reserved

# Rotations by vectors along the axis, as long as the angle in rad.


def cross_matrices(a: Float) -> Float:
    """Matrices (..., 3, 3) of the cross product with a (..., 3)."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return out - np.swapaxes(out, -1, -2)


def rotations(r: Float) -> Float:
    """Rotations (..., 3, 3) by vectors (..., 3) rad (Rodrigues)."""
    angle = np.linalg.norm(r, axis=-1)[..., None, None]
    K = cross_matrices(r)
    s = np.sinc(angle / np.pi)
    c = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + s * K + c * K @ K)


#: What a capture session calls its own files: no camera may.
_TAKEN = ("frames", "log", "session", "cameras", "markers")
_FORBIDDEN = FORBIDDEN + "%"  # of numbered images
_LONGEST = 60
_NAMING = (
    "a camera's name is part of file names: give it 1 to 60 characters, none of them a control"
    f" character or one of {' '.join(_FORBIDDEN)}, without a space or a full stop at either end"
)

_COEFFICIENTS = 8
_STEPS, _CLOSE = 20, 1e-12
_RADII = 1000


@dataclass(frozen=True)
class Camera:
    """A camera of this `name` (see `check_name`) with images of `size` (width, height) pixels;
    `matrix` (3, 3) without skew, pixels; `distortions` (4, 5 or 8,), of a `fisheye` (4,);
    `rotation` (3, 3) and `translation` (3,) mm from the world to the camera."""

    name: str
    size: tuple[int, int]
    matrix: Float
    distortions: Float
    rotation: Float
    translation: Float
    fisheye: bool = False

    def __post_init__(self) -> None:
        check_name(self.name)
        shapes = (self.matrix.shape, self.rotation.shape, self.translation.shape)
        if shapes != ((3, 3), (3, 3), (3,)):
            raise CaptureError(
                f"camera {self.name}: the matrix and the rotation must be 3 x 3,"
                " the translation must have 3 numbers",
                code="wrong-shape",
                camera=self.name,
            )
        if self.fisheye and self.distortions.shape != (4,):
            raise CaptureError(
                f"camera {self.name}: it has {self.distortions.size} distortion coefficients; a"
                " fisheye has 4",
                code="wrong-coefficient-count",
                camera=self.name,
                count=self.distortions.size,
            )
        if self.distortions.shape not in ((4,), (5,), (8,)):
            raise CaptureError(
                f"camera {self.name}: it has {self.distortions.size} distortion coefficients;"
                " there must be 4, 5 or 8 (thin prism and tilted lenses are not supported)",
                code="wrong-coefficient-count",
                camera=self.name,
                count=self.distortions.size,
            )
        arrays = (self.matrix, self.distortions, self.rotation, self.translation)
        if not all(np.isfinite(a).all() for a in arrays):
            raise CaptureError(
                f"camera {self.name}: its matrix, distortion and pose must be finite numbers",
                code="not-finite",
                camera=self.name,
            )
        if min(self.size) < 1:
            raise CaptureError(
                f"camera {self.name}: its size must be at least 1 pixel",
                code="image-too-small",
                camera=self.name,
            )
        if min(self.matrix[0, 0], self.matrix[1, 1]) <= 0:
            raise CaptureError(
                f"camera {self.name}: its focal lengths must be positive",
                code="not-positive",
                camera=self.name,
            )
        if self.matrix[0, 1] != 0:
            raise CaptureError(
                f"camera {self.name}: its skew must be 0", code="skew-not-zero", camera=self.name
            )
        if self.matrix[1, 0] != 0 or (self.matrix[2] != [0, 0, 1]).any():
            raise CaptureError(
                f"camera {self.name}: its matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]",
                code="not-a-camera-matrix",
                camera=self.name,
            )
        off = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if off > 1e-6 or np.linalg.det(self.rotation) < 0:
            raise CaptureError(
                f"camera {self.name}: its rotation is not a rotation matrix",
                code="not-a-rotation",
                camera=self.name,
            )

    @property
    def center(self) -> Float:
        """Of projection (3,) mm, in the world."""
        return np.asarray(-self.rotation.T @ self.translation)

    @property
    def focal(self) -> Float:
        """Focal lengths (2,) pixels."""
        return np.asarray(self.matrix[[0, 1], [0, 1]])

    def to_camera(self, points: Float) -> Float:
        """World (..., 3) mm to the camera's frame (..., 3) mm."""
        return np.asarray(points @ self.rotation.T + self.translation)

    def to_pixels(self, plane: Float) -> Float:
        """Undistorted points at depth one (..., 2) to pixels (..., 2)."""
        shown = distort(plane, self.distortions, fisheye=self.fisheye)[0]
        return np.asarray(shown * self.focal + self.matrix[:2, 2])

    def project(self, points: Float) -> Float:
        """World (..., 3) mm to pixels (..., 2); NaN for what is behind the camera."""
        at = self.to_camera(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            plane = np.where(at[..., 2:] > 0, at[..., :2] / at[..., 2:], np.nan)
        return self.to_pixels(plane)

    def to_plane(self, pixels: Float) -> Float:
        """Pixels (..., 2) to undistorted points at depth one (..., 2)."""
        seen = (pixels - self.matrix[:2, 2]) / self.focal
        return undistort(seen, self.distortions, fisheye=self.fisheye)


def check_name(name: str) -> None:
    """Raises CaptureError for what cannot be the name of a camera, by which its files are called:
    on no system they could be written, or would be a capture session's own."""
    odd = any(unicodedata.category(c).startswith("C") or c in _FORBIDDEN for c in name)
    if odd or not 1 <= len(name) <= _LONGEST or name != name.strip().strip("."):
        raise CaptureError(f"camera {name!r}: {_NAMING}", code="bad-camera-name", camera=name)
    if folded(name) in _TAKEN or is_reserved(name):
        raise CaptureError(
            f"camera {name!r}: this name belongs to a file of a capture session"
            f" ({', '.join(_TAKEN)}) or to a device of the operating system; choose another name",
            code="reserved-camera-name",
            camera=name,
        )


def check_names(names: Sequence[str]) -> None:
    """Raises CaptureError for names of cameras that cannot be, and for two of which one's files
    would be the other's, on any system: `<name>.csv` and `<name>-frames.csv`."""
    files: dict[str, str] = {}
    for name in names:
        check_name(name)
        for file in (folded(name), folded(name) + "-frames"):
            if file in files:
                raise _clash(files[file], name)
            files[file] = name


def _clash(one: str, other: str) -> CaptureError:
    if one == other:
        return CaptureError(
            f"two cameras are called {one!r}; give each a --name of its own",
            code="camera-names-clash",
            cameras=(one, other),
        )
    return CaptureError(
        f"cameras {one!r} and {other!r} would write the same files; give them names that differ by"
        " more than capital letters or an ending -frames",
        code="camera-names-clash",
        cameras=(one, other),
    )


def distort(plane: Float, coefficients: Float, *, fisheye: bool = False) -> tuple[Float, Float]:
    """Points at depth one (..., 2) as the lens shows them, and the derivatives (..., 2, 2)."""
    if fisheye:
        return _fisheye(plane, coefficients)
    k1, k2, p1, p2, k3, k4, k5, k6 = np.append(
        coefficients, np.zeros(_COEFFICIENTS - len(coefficients))
    )
    x, y = plane[..., 0], plane[..., 1]
    r = x * x + y * y
    above, below = 1 + r * (k1 + r * (k2 + r * k3)), 1 + r * (k4 + r * (k5 + r * k6))
    radial = above / below
    slope = (k1 + r * (2 * k2 + 3 * r * k3)) / below
    slope = slope - radial * (k4 + r * (2 * k5 + 3 * r * k6)) / below  # d radial / d r
    out = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
            y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    J = np.empty((*plane.shape, 2))
    J[..., 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    J[..., 0, 1] = J[..., 1, 0] = cross
    J[..., 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return out, J


def _fisheye(plane: Float, coefficients: Float) -> tuple[Float, Float]:
    """As `distort`."""
    r = np.sqrt((np.asarray(plane) ** 2).sum(-1))
    angle = np.arctan(r)
    shown, slope = _bent(angle, coefficients)
    small = r < 1e-9
    safe = np.where(small, 1.0, r)
    scale = np.where(small, 1.0, shown / safe)
    along = np.where(small, 0.0, (slope / (1 + r * r) - scale) / safe**2)
    J = along[..., None, None] * plane[..., :, None] * plane[..., None, :]
    J = J + scale[..., None, None] * np.eye(2)
    return np.asarray(plane * scale[..., None]), np.asarray(J)


def _bent(angle: Float, coefficients: Float) -> tuple[Float, Float]:
    """Where a fisheye shows what is at angles (...) from its axis, and the derivatives."""
    square = angle * angle
    powers = [square ** (k + 1) for k in range(4)]
    terms = [c * p for c, p in zip(coefficients, powers, strict=True)]
    more, slope = sum(terms), sum((2 * k + 3) * t for k, t in enumerate(terms))
    return np.asarray(angle * (1 + more)), np.asarray(1 + slope)


def _straight(seen: Float, coefficients: Float) -> Float:
    """As `undistort`, of a fisheye: the angles up to 90 degrees to where the model folds back."""
    angles = np.linspace(0, np.pi / 2, _RADII)
    back = np.flatnonzero(~(_bent(angles, coefficients)[1] > 0))
    end = angles[max(back[0] - 1, 1)] if len(back) else angles[-1]
    shown = np.sqrt((np.asarray(seen) ** 2).sum(-1))
    known = angles[angles <= end]
    angle = np.interp(shown, _bent(known, coefficients)[0], known)
    for _ in range(_STEPS):
        at, slope = _bent(angle, coefficients)
        angle = np.clip(angle - (at - shown) / np.where(slope > 0, slope, 1.0), 0, end)
    with np.errstate(divide="ignore", invalid="ignore"):
        good = (np.abs(_bent(angle, coefficients)[0] - shown) < 1e-9) & (angle < np.pi / 2 - 1e-6)
        scale = np.where(shown < 1e-9, 1.0, np.tan(angle) / shown)
    return np.asarray(np.where(good, scale, np.nan)[..., None] * seen)


def undistort(seen: Float, coefficients: Float, *, fisheye: bool = False) -> Float:
    """The inverse of `distort`, by Newton's method: NaN where there is none, and beyond the radius
    at which the model of the lens folds back."""
    if fisheye:
        return _straight(seen, coefficients)
    if not np.any(coefficients):
        return np.asarray(seen, float)
    plane = np.array(seen, float)
    for _ in range(_STEPS):
        at, J = distort(plane, coefficients)
        miss = at - seen
        det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            plane[..., 0] -= (J[..., 1, 1] * miss[..., 0] - J[..., 0, 1] * miss[..., 1]) / det
            plane[..., 1] -= (J[..., 0, 0] * miss[..., 1] - J[..., 1, 0] * miss[..., 0]) / det
        if not np.nanmax(np.abs(miss), initial=0.0) > _CLOSE:
            break
    with np.errstate(invalid="ignore", over="ignore"):
        found = np.abs(distort(plane, coefficients)[0] - seen).max(-1) < 1e-7
        radius = np.hypot(plane[..., 0], plane[..., 1])
    found &= radius < _fold(coefficients, float(radius[found].max(initial=0.0)))
    plane[~found] = np.nan
    return plane


def _fold(coefficients: Float, most: float) -> float:
    """Radius at depth one, of at most so much, beyond which the image no longer grows with it."""
    radius = np.linspace(0, most, _RADII)
    radial = np.array(coefficients, float)
    radial[2:4] = 0
    seen = distort(np.stack([radius, 0 * radius], axis=-1), radial)[0][:, 0]
    back = np.flatnonzero(~(np.diff(seen) > 0))
    return float(radius[back[0]]) if len(back) and most > 0 else float("inf")
