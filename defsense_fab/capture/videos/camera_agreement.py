"""Check whether several cameras, their calibration and the tags belong together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ..cameras.rig_file import Rig
from ..tracking.observations import StoredObservations
from ..tracking.reconstruction import reconstruct
from .camera_sync import TrackWarning, views_of_tags
from .located_tags import LocatedTags

#: Share of the tags seen by several cameras on which they agree; fewer mean a wrong calibration.
MIN_AGREEMENT = 0.5
MIN_USED_VIEWS = 0.9  # share of the views that agree with a right calibration
MAX_SCALE_ERROR = 0.03  # of the tags' size, if the order of the cameras is certain
MAX_PRINT_SCALE_ERROR = 0.07  # of the stated size: "fit to page" shrinks by up to 6 %
MAX_RESIDUAL_PX = 0.25  # median; with more, cameras are not synchronous or were moved
MAX_ORDER_RESIDUAL_PX = 1.5  # of a credible order of the cameras


def check_agreement(
    located: LocatedTags,
    rig: Rig,
    observations: Sequence[StoredObservations],
    size: float,
    names: Sequence[str],
) -> None:
    """Check that cameras agree, and that the tags have the stated size.

    Args:
        located: Tags that were located.
        rig: The cameras.
        observations: Observations of each camera.
        size: Side of the tags, mm.
        names: Names of the videos.

    Raises:
        CaptureError: The videos are in another order than the cameras (`camera-order-differs`), the
            cameras disagree (`calibration-wrong`), or the tags have another size
            (`tag-size-wrong`).
    """
    by_several = located.views >= 2
    if len(rig.cameras) < 2 or by_several.sum() < 3:
        return
    agreement = float((located.cameras[by_several] >= 2).mean())
    scale = float(np.nanmedian(located.sides)) / size if agreement else 0.0
    is_credible = agreement >= MIN_AGREEMENT and abs(scale - 1) <= MAX_PRINT_SCALE_ERROR
    is_right = is_credible and abs(scale - 1) <= MAX_SCALE_ERROR
    used = float(located.cameras[by_several].sum() / located.views[by_several].sum())
    if is_right and used >= MIN_USED_VIEWS and float(np.nanmedian(located.miss)) <= MAX_RESIDUAL_PX:
        return
    rows = np.argwhere(by_several)
    sample = rows[:: max(len(rows) // (200 if len(rig.cameras) < 5 else 30), 1)]
    order = _find_order(rig, *views_of_tags(observations, sample), size, located)
    if order is not None:
        pairs = ", ".join(
            f"{name} is of {rig.cameras[k].name}" for name, k in zip(names, order, strict=True)
        )
        raise CaptureError(
            f"the videos are in another order than the cameras: it seems that {pairs}",
            code="camera-order-differs",
            where="videos",
            action="Give the videos in the order of the cameras",
            order=order,
        )
    if is_credible:
        return
    if agreement < MIN_AGREEMENT:
        raise CaptureError(
            "the views do not fit the calibration: of the tags that several cameras see, only"
            f" {agreement:.0%} agree",
            code="calibration-wrong",
            where="cameras",
            action=(
                "Run 'defsense capture camera check' to see whether a camera was moved, or give the"
                " offsets of videos that started more than some seconds apart"
            ),
        )
    raise CaptureError(
        f"tags of {size:g} mm look {scale * size:.3g} mm large to these cameras",
        code="tag-size-wrong",
        where="cameras",
        action=(
            f"Measure the black square of a tag ({scale * size:.3g} mm?) and the board's"
            " squares, and check that the calibration is in mm"
            " and that no camera was moved"
        ),
        measured=scale * size,
    )


def agreement_warnings(
    located: LocatedTags,
    is_outlier: Bool,
    disagreeing: Bool,
    time: Float,
    residual: float | None,
) -> list[TrackWarning]:
    """Return warnings about cameras that disagree.

    Args:
        located: Tags that were located.
        is_outlier: Positions that were left out (t, m).
        disagreeing: Frames in which most positions were left out (t,).
        time: Times of the frames (t,), s.
        residual: Median residual, px; None if it is not known.
    """
    warnings: list[TrackWarning] = []
    by_three = located.views >= 3
    disagrees = by_three & (located.cameras >= 2) & (located.cameras < located.views)
    if disagrees.sum() > (1 - MIN_USED_VIEWS) * max(by_three.sum(), 1):
        share, first = disagrees.sum() / by_three.sum(), time[disagrees.any(axis=1)][0]
        warnings.append(
            TrackWarning(
                "Of the tags that three cameras see, one camera disagrees on"
                f" {share:.0%}, first at {first:.2f} s, and was left out there. Check whether it"
                " was moved.",
                "camera-disagrees",
            )
        )
    if disagreeing.any():
        warnings.append(
            TrackWarning(
                f"In {int(disagreeing.sum())} frames, the first at {time[disagreeing][0]:.2f} s,"
                " the cameras' views of most tags disagree, because a camera was moved or its"
                " times jump. These positions were left out.",
                "cameras-disagree",
            )
        )
    if is_outlier.any():
        warnings.append(
            TrackWarning(
                f"{int(is_outlier.sum())} positions were left out, because the cameras' views of"
                " the tag disagree.",
                "positions-left-out",
            )
        )
    if (residual or 0.0) > MAX_RESIDUAL_PX:
        warnings.append(
            TrackWarning(
                f"The cameras' views differ by {residual:.2f} px, because they are not"
                " synchronous or one was moved since the calibration. Positions may be wrong by"
                " millimeters.",
                "residual-large",
            )
        )
    return warnings


def _find_order(
    rig: Rig, corners: Float, covariance: Float, size: float, located: LocatedTags
) -> tuple[int, ...] | None:
    """Return the order of cameras that fits better than the stated one, if there is one.

    Args:
        rig: The cameras in the stated order.
        corners: Corners of some tags (n, v, 4, 2), px.
        covariance: Their covariances (n, v, 5, 2, 2), px^2.
        size: Side of the tags, mm.
        located: Tags located in the stated order.
    """
    agreement = located.cameras[located.views >= 2]
    residual = (
        float(np.median(located.miss[located.cameras >= 2])) if (agreement >= 2).any() else np.inf
    )
    best: tuple[float, tuple[int, ...]] | None = None
    for order in list(itertools.permutations(range(len(rig.cameras))))[1:]:
        cameras = [rig.cameras[k] for k in order]
        # Corners are without distortion, but in pixels of the stated camera.
        converted = np.stack(
            [
                (corners[:, c] - old.matrix[:2, 2]) / old.focal * new.focal + new.matrix[:2, 2]
                for c, (old, new) in enumerate(zip(rig.cameras, cameras, strict=True))
            ],
            axis=1,
        )
        candidate = reconstruct(cameras, converted[:, None], covariance[:, None], size)
        by_several = candidate.views >= 2
        if (candidate.cameras[by_several] < 2).mean() > 0.2:
            continue
        scale = float(np.nanmedian(candidate.sides)) / size
        candidate_residual, gain = (
            float(np.nanmedian(candidate.miss)),
            candidate.cameras[by_several].mean() - agreement.mean(),
        )
        if (
            candidate_residual < MAX_ORDER_RESIDUAL_PX
            and abs(scale - 1) <= MAX_SCALE_ERROR
            and (gain > 0.3 or candidate_residual < residual / 2)
        ):
            best = min(best or (np.inf, order), (candidate_residual, order))
    return best[1] if best else None
