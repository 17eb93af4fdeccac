"""Cameras in the convention of OpenCV: pinhole or fisheye lenses with distortion, and their poses.

A world point X (mm) is at R X + t in the camera's frame (x to the right, y down, z forward) and at
x = X/Z, y = Y/Z on the plane at depth one. The lens distorts (x, y) with the coefficients k1, k2,
p1, p2, k3[, k4, k5, k6]; the matrix K maps the result to pixels, whose centers have integer
coordinates. A fisheye lens maps the angle a from its axis to a (1 + k1 a^2 + k2 a^4 + k3 a^6 +
k4 a^8) in the same direction; here up to 90 degrees.

References:
    Brown 1966; OpenCV, module calib3d (pinhole).
    Kannala & Brandt 2006; OpenCV, module fisheye.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from .arrays import Float
from .errors import CaptureError
from .storage.file_names import FORBIDDEN_CHARACTERS, fold_name, is_reserved

#: Names of a capture session's own files, which no camera may have.
_SESSION_FILE_NAMES = ("frames", "log", "session", "cameras", "markers")
_FORBIDDEN_IN_NAMES = FORBIDDEN_CHARACTERS + "%"  # "%" is used for numbered images
_MAX_NAME_LENGTH = 60

_MAX_COEFFICIENTS = 8
_MAX_NEWTON_STEPS = 20
_NEWTON_TOLERANCE = 1e-12  # at depth one
_RADIUS_SAMPLES = 1000  # radii or angles at which a lens model is checked for folding


@dataclass(frozen=True)
class Camera:
    """A calibrated camera and its pose.

    Attributes:
        name: Name of the camera; see `check_name`.
        size: Width and height of its images, pixels.
        matrix: Camera matrix (3, 3) without skew, pixels.
        distortions: Distortion coefficients, (4,), (5,) or (8,); (4,) for a fisheye lens.
        rotation: Rotation matrix (3, 3) from the world to the camera.
        translation: Translation (3,) from the world to the camera, mm.
        fisheye: Whether the lens follows the fisheye model.

    Raises:
        CaptureError: The name, a shape or a value is invalid.
    """

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
            self._fail(
                f"matrix, rotation and translation have the shapes {shapes}",
                "wrong-shape",
                "Give a 3 x 3 matrix, a 3 x 3 rotation and 3 numbers for the translation",
            )
        count = self.distortions.size
        if self.fisheye and self.distortions.shape != (4,):
            self._fail(
                f"has {count} distortion coefficients",
                "wrong-coefficient-count",
                "Give 4 coefficients for a fisheye lens",
                count=count,
            )
        if self.distortions.shape not in ((4,), (5,), (8,)):
            self._fail(
                f"has {count} distortion coefficients",
                "wrong-coefficient-count",
                "Give 4, 5 or 8 coefficients; thin prism and tilted lenses are not supported",
                count=count,
            )
        self._check_finite()
        self._check_matrix()
        deviation = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if deviation > 1e-6 or np.linalg.det(self.rotation) < 0:
            self._fail(
                "has a rotation that is not a rotation matrix",
                "not-a-rotation",
                "Give orthonormal, right-handed rows",
            )

    def _check_finite(self) -> None:
        arrays = (self.matrix, self.distortions, self.rotation, self.translation)
        if not all(np.isfinite(a).all() for a in arrays):
            self._fail(
                "has a matrix, distortion or pose that is not finite",
                "not-finite",
                "Calibrate the camera again",
            )
        if min(self.size) < 1:
            self._fail(
                f"has an image size of {self.size[0]} x {self.size[1]} pixels",
                "image-too-small",
                "Give at least 1 pixel for the width and the height",
            )

    def _check_matrix(self) -> None:
        if min(self.matrix[0, 0], self.matrix[1, 1]) <= 0:
            self._fail(
                "has a focal length that is not positive",
                "not-positive",
                "Check the first two diagonal entries of its matrix",
            )
        if self.matrix[0, 1] != 0:
            self._fail(
                f"has a skew of {self.matrix[0, 1]:g}",
                "skew-not-zero",
                "Calibrate the camera without skew",
            )
        if self.matrix[1, 0] != 0 or (self.matrix[2] != [0, 0, 1]).any():
            self._fail(
                "has a matrix of another form",
                "not-a-camera-matrix",
                "Give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]",
            )

    def _fail(self, problem: str, code: str, action: str, **data: object) -> NoReturn:
        raise CaptureError(
            problem,
            code=code,
            where=f"camera {self.name}",
            action=action,
            camera=self.name,
            **data,
        )

    @property
    def center(self) -> Float:
        """Center of projection (3,) in the world, mm."""
        return np.asarray(-self.rotation.T @ self.translation)

    @property
    def focal(self) -> Float:
        """Focal lengths (2,), pixels."""
        return np.asarray(self.matrix[[0, 1], [0, 1]])

    def to_camera(self, points: Float) -> Float:
        """Transform world points (..., 3) to the camera's frame (..., 3), mm."""
        return np.asarray(points @ self.rotation.T + self.translation)

    def to_pixels(self, plane: Float) -> Float:
        """Map undistorted points at depth one (..., 2) to pixels (..., 2)."""
        distorted = distort(plane, self.distortions, fisheye=self.fisheye)[0]
        return np.asarray(distorted * self.focal + self.matrix[:2, 2])

    def project(self, points: Float) -> Float:
        """Project world points (..., 3) in mm to pixels (..., 2); NaN behind the camera."""
        inside = self.to_camera(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            plane = np.where(inside[..., 2:] > 0, inside[..., :2] / inside[..., 2:], np.nan)
        return self.to_pixels(plane)

    def to_plane(self, pixels: Float) -> Float:
        """Map pixels (..., 2) to undistorted points at depth one (..., 2)."""
        distorted = (pixels - self.matrix[:2, 2]) / self.focal
        return undistort(distorted, self.distortions, fisheye=self.fisheye)


def check_name(name: str) -> None:
    """Check that files can be named after a camera on every operating system.

    Args:
        name: Name of the camera.

    Raises:
        CaptureError: A file system cannot have the name, or a capture session uses it for a file.
    """
    has_bad_character = any(
        unicodedata.category(c).startswith("C") or c in _FORBIDDEN_IN_NAMES for c in name
    )
    is_length_valid = 1 <= len(name) <= _MAX_NAME_LENGTH
    if has_bad_character or not is_length_valid or name != name.strip().strip("."):
        raise CaptureError(
            "cannot be part of a file name",
            code="camera-name-invalid",
            where=f"camera {name!r}",
            action=(
                f"Use 1 to {_MAX_NAME_LENGTH} characters, no control character, none of"
                f" {' '.join(_FORBIDDEN_IN_NAMES)}, and no space or full stop at either end"
            ),
            camera=name,
        )
    if fold_name(name) in _SESSION_FILE_NAMES or is_reserved(name):
        raise CaptureError(
            f"is the name of a file of a capture session ({', '.join(_SESSION_FILE_NAMES)}) or of"
            " a device of the operating system",
            code="reserved-camera-name",
            where=f"camera {name!r}",
            action="Choose another name",
            camera=name,
        )


def check_names(names: Sequence[str]) -> None:
    """Check the names of a session's cameras, and that no two would write the same files.

    Each camera writes `<name>.csv` and `<name>-frames.csv`.

    Args:
        names: Names of all cameras.

    Raises:
        CaptureError: A name is invalid, or two names clash on some file system.
    """
    files: dict[str, str] = {}
    for name in names:
        check_name(name)
        for file in (fold_name(name), fold_name(name) + "-frames"):
            if file in files:
                raise CaptureError(
                    f"{files[file]!r} and {name!r} would write the same files",
                    code="name-repeated",
                    where="camera names",
                    action="Choose names that differ by more than capitals or an ending -frames",
                    cameras=(files[file], name),
                )
            files[file] = name


def distort(plane: Float, coefficients: Float, *, fisheye: bool = False) -> tuple[Float, Float]:
    """Apply a lens's distortion to points at depth one.

    Args:
        plane: Undistorted points (..., 2).
        coefficients: Distortion coefficients, (4,), (5,) or (8,).
        fisheye: Whether the lens follows the fisheye model.

    Returns:
        The distorted points (..., 2) and their derivatives (..., 2, 2) by the undistorted ones.
    """
    if fisheye:
        return _distort_fisheye(plane, coefficients)
    k1, k2, p1, p2, k3, k4, k5, k6 = np.append(
        coefficients, np.zeros(_MAX_COEFFICIENTS - len(coefficients))
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


def _distort_fisheye(plane: Float, coefficients: Float) -> tuple[Float, Float]:
    r = np.sqrt((np.asarray(plane) ** 2).sum(-1))
    angle = np.arctan(r)
    radius, slope = _fisheye_radius(angle, coefficients)
    is_center = r < 1e-9
    safe = np.where(is_center, 1.0, r)
    scale = np.where(is_center, 1.0, radius / safe)
    along = np.where(is_center, 0.0, (slope / (1 + r * r) - scale) / safe**2)
    J = along[..., None, None] * plane[..., :, None] * plane[..., None, :]
    J = J + scale[..., None, None] * np.eye(2)
    return np.asarray(plane * scale[..., None]), np.asarray(J)


def _fisheye_radius(angle: Float, coefficients: Float) -> tuple[Float, Float]:
    """Return the image radii of angles (...) from a fisheye's axis, and their derivatives."""
    square = angle * angle
    powers = [square ** (k + 1) for k in range(4)]
    terms = [c * p for c, p in zip(coefficients, powers, strict=True)]
    more, slope = sum(terms), sum((2 * k + 3) * t for k, t in enumerate(terms))
    return np.asarray(angle * (1 + more)), np.asarray(1 + slope)


def undistort(distorted: Float, coefficients: Float, *, fisheye: bool = False) -> Float:
    """Invert `distort` by Newton's method.

    Args:
        distorted: Points (..., 2) at depth one as the lens shows them.
        coefficients: Distortion coefficients, (4,), (5,) or (8,).
        fisheye: Whether the lens follows the fisheye model.

    Returns:
        The undistorted points (..., 2). NaN where no point maps to the given one, and beyond the
        radius at which the lens model folds back.
    """
    if fisheye:
        return _undistort_fisheye(distorted, coefficients)
    if not np.any(coefficients):
        return np.asarray(distorted, float)
    plane = np.array(distorted, float)
    for _ in range(_MAX_NEWTON_STEPS):
        value, J = distort(plane, coefficients)
        miss = value - distorted
        det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            plane[..., 0] -= (J[..., 1, 1] * miss[..., 0] - J[..., 0, 1] * miss[..., 1]) / det
            plane[..., 1] -= (J[..., 0, 0] * miss[..., 1] - J[..., 1, 0] * miss[..., 0]) / det
        if not np.nanmax(np.abs(miss), initial=0.0) > _NEWTON_TOLERANCE:
            break
    with np.errstate(invalid="ignore", over="ignore"):
        is_valid = np.abs(distort(plane, coefficients)[0] - distorted).max(-1) < 1e-7
        radius = np.hypot(plane[..., 0], plane[..., 1])
    is_valid &= radius < _fold_radius(coefficients, float(radius[is_valid].max(initial=0.0)))
    plane[~is_valid] = np.nan
    return plane


def _fold_radius(coefficients: Float, limit: float) -> float:
    """Return the radius at depth one, up to `limit`, where the image radius stops growing."""
    radius = np.linspace(0, limit, _RADIUS_SAMPLES)
    radial = np.array(coefficients, float)
    radial[2:4] = 0
    image_radius = distort(np.stack([radius, 0 * radius], axis=-1), radial)[0][:, 0]
    falls = np.flatnonzero(~(np.diff(image_radius) > 0))
    return float(radius[falls[0]]) if len(falls) and limit > 0 else float("inf")


def _undistort_fisheye(distorted: Float, coefficients: Float) -> Float:
    """Undistort up to 90 degrees, or up to the angle at which the model folds back."""
    angles = np.linspace(0, np.pi / 2, _RADIUS_SAMPLES)
    falls = np.flatnonzero(~(_fisheye_radius(angles, coefficients)[1] > 0))
    end = angles[max(falls[0] - 1, 1)] if len(falls) else angles[-1]
    radius = np.sqrt((np.asarray(distorted) ** 2).sum(-1))
    rising = angles[angles <= end]
    angle = np.interp(radius, _fisheye_radius(rising, coefficients)[0], rising)
    for _ in range(_MAX_NEWTON_STEPS):
        value, slope = _fisheye_radius(angle, coefficients)
        angle = np.clip(angle - (value - radius) / np.where(slope > 0, slope, 1.0), 0, end)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_valid = np.abs(_fisheye_radius(angle, coefficients)[0] - radius) < 1e-9
        is_valid &= angle < np.pi / 2 - 1e-6
        scale = np.where(radius < 1e-9, 1.0, np.tan(angle) / radius)
    return np.asarray(np.where(is_valid, scale, np.nan)[..., None] * distorted)
