"""Markers on a body: where their tags are glued (`markers.json`), and their positions over time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .arrays import Bool, Float, Int
from .errors import CaptureError
from .storage.files import load_json, storage_errors, write_json

SCHEMA = 1
FILE = "markers.json"
#: Corners in the order of detectors: clockwise from the top left of the tag's picture.
_CORNERS = np.array([[-1.0, 1], [1, 1], [1, -1], [-1, -1]])
_WRITE_ACTION = "Write it with 'defsense capture markers DEVICE'"


@dataclass(frozen=True)
class Markers:
    """Tags of one dictionary on a body, in its rest frame.

    Attributes:
        device: Name of the device.
        dictionary: Name of the tag dictionary.
        size: Width of the tags' black squares, mm.
        ids: Numbers of the tags (m,).
        centers: Centers of the tags (m, 3), mm.
        axes: Axes of the tags (m, 3, 3): the columns are x (right in its picture), y (up in its
            picture) and the normal out of the body.
        anchor: Whether each tag is on the anchor (m,).

    Raises:
        CaptureError: A shape or a value is invalid.
    """

    device: str
    dictionary: str
    size: float
    ids: Int
    centers: Float
    axes: Float
    anchor: Bool

    def __post_init__(self) -> None:
        m = len(self.ids)
        shapes = (self.ids.shape, self.centers.shape, self.axes.shape, self.anchor.shape)
        if m == 0 or shapes != ((m,), (m, 3), (m, 3, 3), (m,)):
            raise CaptureError(
                f"{m} numbers do not fit centers {self.centers.shape}, axes {self.axes.shape} and"
                f" anchor {self.anchor.shape}",
                code="wrong-shape",
                where="markers",
            )
        if not (np.isfinite(self.centers).all() and np.isfinite(self.axes).all()):
            raise CaptureError(
                "a center or an axis is not finite", code="not-finite", where="markers"
            )
        if not 0 < self.size < 1000:
            raise CaptureError(
                f"a size of {self.size:g} mm is not possible",
                code="marker-size-invalid",
                where="markers",
                action="Give the width of the black squares in mm",
                size=self.size,
            )
        if len(np.unique(self.ids)) < m:
            raise CaptureError(
                "two tags have the same number", code="marker-repeated", where="markers"
            )
        if self.ids.min() < 0:
            raise CaptureError(
                "a tag has a negative number", code="marker-id-invalid", where="markers"
            )
        for number, a in zip(self.ids, self.axes, strict=True):
            if np.abs(a.T @ a - np.eye(3)).max() > 1e-6 or np.linalg.det(a) < 0:
                raise CaptureError(
                    "its axes are not orthonormal and right-handed",
                    code="marker-axes-invalid",
                    where=f"markers: tag {number}",
                    marker=int(number),
                )

    @property
    def corners(self) -> Float:
        """Corners of the black squares (m, 4, 3), mm, clockwise from the picture's top left."""
        across = np.einsum("ck,mjk->mcj", _CORNERS, self.axes[:, :, :2])
        return np.asarray(self.centers[:, None] + self.size / 2 * across)


@dataclass(frozen=True)
class Tracks:
    """Positions of m markers in t frames.

    Attributes:
        time: Times of the frames (t,), s, increasing.
        ids: Numbers of the markers (m,).
        points: Positions (t, m, 3), mm; NaN where a marker is not visible.
        sigma: Standard deviations (t, m, 3) along the axes, mm; NaN where a marker is not visible,
            all NaN where they are not known.
        frame: Numbers of the frames (t,), which may have gaps.

    Raises:
        CaptureError: A shape or a value is invalid.
    """

    time: Float
    ids: Int
    points: Float
    sigma: Float
    frame: Int

    def __post_init__(self) -> None:
        t, m = len(self.time), len(self.ids)
        shapes = (self.time.shape, self.frame.shape, self.points.shape, self.sigma.shape)
        if shapes != ((t,), (t,), (t, m, 3), (t, m, 3)):
            raise CaptureError(
                f"{t} frames of {m} markers do not fit points {self.points.shape}, sigma"
                f" {self.sigma.shape} and frames {self.frame.shape}",
                code="wrong-shape",
                where="tracks",
            )
        if (np.diff(self.time) <= 0).any() or not np.isfinite(self.time).all():
            raise CaptureError(
                "times do not increase from frame to frame",
                code="times-not-increasing",
                where="tracks",
            )
        if len(np.unique(self.ids)) < m:
            raise CaptureError(
                "two markers have the same number", code="marker-repeated", where="tracks"
            )
        if (np.isnan(self.points).any(-1) != np.isnan(self.points).all(-1)).any():
            raise CaptureError(
                "a position has some, but not all, coordinates NaN",
                code="point-partly-nan",
                where="tracks",
                action="Give three numbers or three NaN",
            )

    def select(self, frames: slice | Bool) -> Tracks:
        """Return some of the frames, selected by a mask (t,) or a slice."""
        return Tracks(
            self.time[frames], self.ids, self.points[frames], self.sigma[frames], self.frame[frames]
        )

    @property
    def visible(self) -> Bool:
        """Whether each marker is visible in each frame (t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))


def write_markers_file(markers: Markers, path: Path) -> None:
    """Write `markers.json`.

    Args:
        markers: The markers of a device.
        path: File to write.

    Raises:
        StorageError: The file cannot be written.
    """
    m = markers
    tags = [
        {"id": int(i), "center": c.tolist(), "axes": a.tolist(), "anchor": bool(f)}
        for i, c, a, f in zip(m.ids, m.centers, m.axes, m.anchor, strict=True)
    ]
    with storage_errors(path):
        write_json(
            path,
            {
                "schema": SCHEMA,
                "device": m.device,
                "dictionary": m.dictionary,
                "size": m.size,
                "tags": tags,
            },
        )


def read_markers(path: Path) -> Markers:
    """Read `markers.json`.

    Args:
        path: The file, or the folder that holds it.

    Returns:
        The markers of a device.

    Raises:
        CaptureError: The file cannot be read or is invalid.
    """
    path = path / FILE if path.is_dir() else path
    data = load_json(path, CaptureError, _WRITE_ACTION)
    try:
        if data["schema"] != SCHEMA:
            raise CaptureError(
                f"has the schema {data['schema']!r}; this version reads {SCHEMA}",
                code="wrong-schema",
                action=_WRITE_ACTION,
            )
        tags = list(data["tags"])
        for tag in tags:
            _check_tag(tag)
        return Markers(
            str(data["device"]),
            str(data["dictionary"]),
            float(data["size"]),
            np.array([t["id"] for t in tags], np.int64),
            np.array([t["center"] for t in tags], float),
            np.array([t["axes"] for t in tags], float),
            np.array([t["anchor"] for t in tags], bool),
        )
    except CaptureError as error:
        where = f"{path}: {error.where}" if error.where else path
        raise CaptureError(
            error.problem, code=error.code, where=where, action=error.action, **error.data
        ) from None
    except KeyError as error:
        raise CaptureError(
            f"{error.args[0]!r} is missing",
            code="key-missing",
            where=path,
            action=_WRITE_ACTION,
            key=error.args[0],
        ) from None
    except (TypeError, ValueError, OverflowError) as error:
        raise CaptureError(
            f"is not a file of markers ({error})",
            code="marker-file-invalid",
            where=path,
            action=_WRITE_ACTION,
        ) from None


def _check_tag(tag: dict[str, object]) -> None:
    number = tag["id"]
    if not isinstance(number, int) or isinstance(number, bool):
        raise CaptureError(
            "its id is not an integer", code="marker-id-invalid", where=f"tag {number!r}"
        )
    for key, shape in (("center", (3,)), ("axes", (3, 3))):
        if np.shape(np.asarray(tag[key], float)) != shape:
            raise CaptureError(
                f"{key} does not have {' x '.join(map(str, shape))} numbers",
                code="wrong-shape",
                where=f"tag {number}",
                marker=number,
                key=key,
            )
    if not isinstance(tag["anchor"], bool):
        raise CaptureError(
            "anchor is not true or false",
            code="not-a-bool",
            where=f"tag {number}",
            marker=number,
        )
