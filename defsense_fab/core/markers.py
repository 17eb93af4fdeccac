"""Which tag is glued where on a body, and the file that says so, `markers.json`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .arrays import Bool, Float, Int
from .errors import CaptureError
from .storage.files import load_json, storage_errors, write_json

# Where markers were, by time.


@dataclass(frozen=True)
class Tracks:
    """t frames of m markers: `time` (t,) s, increasing; the markers' numbers `ids` (m,); `points`
    (t, m, 3) mm, NaN where a marker was not seen; `sigma` (t, m, 3) mm, standard deviations along
    the axes, NaN likewise (all NaN where they are not known); `frame` (t,), numbers of the frames,
    which may leave some out."""

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
                f"tracks of {t} frames and {m} markers cannot have points {self.points.shape},"
                f" sigma {self.sigma.shape} and frames {self.frame.shape}",
                code="wrong-shape",
            )
        if (np.diff(self.time) <= 0).any() or not np.isfinite(self.time).all():
            raise CaptureError(
                "tracks: times must increase from frame to frame", code="times-not-increasing"
            )
        if len(np.unique(self.ids)) < m:
            raise CaptureError("tracks: two markers of one number", code="duplicate-marker")
        if (np.isnan(self.points).any(-1) != np.isnan(self.points).all(-1)).any():
            raise CaptureError(
                "tracks: of a marker a part of its place is NaN; write three numbers or three NaN",
                code="point-partly-nan",
            )

    def part(self, frames: slice | Bool) -> Tracks:
        """Some of the frames, a mask (t,) or a slice."""
        return Tracks(
            self.time[frames], self.ids, self.points[frames], self.sigma[frames], self.frame[frames]
        )

    @property
    def seen(self) -> Bool:
        """Which markers were seen (t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))


SCHEMA = 1
FILE = "markers.json"
#: Corners in the order in which detectors give them: clockwise from the top left of the picture.
_CORNERS = np.array([[-1.0, 1], [1, 1], [1, -1], [-1, -1]])


@dataclass(frozen=True)
class Markers:
    """m tags of one `dictionary` on the body of `device`, their black squares `size` mm wide: the
    numbers `ids` (m,); `centers` (m, 3) mm in the rest frame; `axes` (m, 3, 3), in columns the
    tag's x (to the right in its picture), y (up in it) and the normal out of the body; which of
    them lie on the `anchor` (m,)."""

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
                f"markers: {m} numbers do not go with centers {self.centers.shape}, axes"
                f" {self.axes.shape} and anchor {self.anchor.shape}",
                code="wrong-shape",
            )
        if not (np.isfinite(self.centers).all() and np.isfinite(self.axes).all()):
            raise CaptureError("markers: a center or an axis is no number", code="not-finite")
        if not 0 < self.size < 1000:
            raise CaptureError(
                f"markers: size {self.size:g} mm cannot be", code="bad-marker-size", size=self.size
            )
        if len(np.unique(self.ids)) < m:
            raise CaptureError("markers: numbers must be different", code="duplicate-marker")
        if self.ids.min() < 0:
            raise CaptureError("markers: numbers must be 0 or more", code="bad-marker-id")
        for number, a in zip(self.ids, self.axes, strict=True):
            if np.abs(a.T @ a - np.eye(3)).max() > 1e-6 or np.linalg.det(a) < 0:
                raise CaptureError(
                    f"markers: tag {number}: axes must be at right angles, of length 1 and"
                    " right-handed",
                    code="bad-marker-axes",
                    marker=int(number),
                )

    @property
    def corners(self) -> Float:
        """Of the black squares (m, 4, 3) mm, in the order of detectors: top left, top right, bottom
        right, bottom left of the tag's picture."""
        across = np.einsum("ck,mjk->mcj", _CORNERS, self.axes[:, :, :2])
        return np.asarray(self.centers[:, None] + self.size / 2 * across)


def write_markers_file(markers: Markers, path: Path) -> None:
    """Raises StorageError where it cannot be written."""
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
    """Of `markers.json`, or of the folder that holds it. Raises CaptureError with the file."""
    path = path / FILE if path.is_dir() else path
    data = load_json(path, CaptureError, "'defsense capture markers DEVICE' writes such a file")
    try:
        if data["schema"] != SCHEMA:
            raise CaptureError(
                f"this version reads schema {SCHEMA}, not {data['schema']!r}", code="wrong-schema"
            )
        tags = list(data["tags"])
        for tag in tags:
            _check(tag)
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
        raise CaptureError(f"{path}: {error}", code=error.code, **error.data) from None
    except KeyError as error:
        raise CaptureError(
            f"{path}: {error.args[0]!r} is missing; write it anew",
            code="missing-key",
            key=error.args[0],
        ) from None
    except (TypeError, ValueError, OverflowError) as error:
        raise CaptureError(
            f"{path}: not as 'defsense capture markers' writes it: {error}",
            code="bad-marker-file",
        ) from None


def _check(tag: dict[str, object]) -> None:
    number = tag["id"]
    if not isinstance(number, int) or isinstance(number, bool):
        raise CaptureError(f"tag {number!r}: its id must be a whole number", code="bad-marker-id")
    for key, shape in (("center", (3,)), ("axes", (3, 3))):
        if np.shape(np.asarray(tag[key], float)) != shape:
            raise CaptureError(
                f"tag {number}: {key} must be {' x '.join(map(str, shape))} numbers",
                code="wrong-shape",
                marker=number,
                key=key,
            )
    if not isinstance(tag["anchor"], bool):
        raise CaptureError(
            f"tag {number}: anchor must be true or false", code="not-a-boolean", marker=number
        )
