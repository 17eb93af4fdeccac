"""What may be wrong with a dataset, before anything is trained on it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Bool, Float
from .channel_checks import channel_problems, longest_at
from .dataset import Dataset, Recording
from .problems import Problem, refuse
from .time_alignment import WITHIN, find_shift
from .unit_checks import unit_problems

_EACH = 10  # frames for each weight of a decoder
_LEAST = 50  # frames
_SHORT = 60.0  # s of frames, fewer than which show little of how a device moves
_REST = 0.5  # s
_STILL = 3.0  # mm, root mean square, by which markers at rest are off their places
_BARE = 0.05  # of the frames
_HIDDEN = 0.5  # of the frames
_NOTHING = 0.05  # of the movements' variance: what tells less forbids training
_STEPS = _TELL_NOTHING, _OUT_OF_STEP = "signals-tell-nothing", "out-of-step"
_ALIKE = 0.4  # correlation of a channel's signal with what was predicted of it
_WRONG = 0.2  # s, by which signals out of step forbid training


def check_dataset(
    dataset: Dataset, *, channels: Sequence[str] | None = None,
    predicted: Mapping[str, Float] | None = None,
) -> tuple[Problem, ...]:  # fmt: skip
    """All problems, those that forbid training first. `channels`: those that the device has;
    `predicted`: see `channel_problems`."""
    out = [
        *_together(dataset), *_twice(dataset), *_named(dataset, channels), *_numbers(dataset),
        *unit_problems(dataset), *_times(dataset),
    ]  # fmt: skip
    if not any(p.fatal for p in out):  # what follows computes with them
        # Causes first: of what has no signals or markers, too few frames are what follows.
        out += [
            *channel_problems(dataset, predicted), *_hidden(dataset), *_frames(dataset),
            *_rest(dataset), *_steps(dataset, predicted or {}),
        ]  # fmt: skip
    return tuple(sorted(out, key=lambda p: not p.fatal))


def checked(
    dataset: Dataset, channels: Sequence[str] | None = None,
    predicted: Mapping[str, Float] | None = None, in_step: bool = False,
) -> tuple[Problem, ...]:  # fmt: skip
    """The problems that do not forbid training. Raises TrainingError for those that do. Where
    signals are known to be `in_step` with the markers, as a twin's are, neither that they tell
    nothing nor that they seem to tell more at another time forbids it."""
    problems = check_dataset(dataset, channels=channels, predicted=predicted)
    refuse(p for p in problems if not (in_step and p.code in _STEPS))
    return problems


def usable(r: Recording) -> Bool:
    """Frames (t,) in which a marker is seen and every channel has a signal."""
    signals = r.signals_at(r.time)
    return np.asarray(np.isfinite(signals).all(axis=1) & r.seen.any(axis=1))


def _together(dataset: Dataset) -> list[Problem]:
    out = []
    for key, what, code in (
        ("device", "devices", "different-devices"),
        ("layout", "layouts of cords", "different-layouts-of-cords"),
    ):
        known = {
            str(s[key]): str(s.get("folder", "?"))
            for s in dataset.provenance.get("sessions", ())
            if s.get(key)
        }
        if len(known) > 1:
            told = ", ".join(f"{value} ({folder})" for value, folder in known.items())
            out.append(
                Problem(
                    code, True, f"sessions are of different {what}: {told}",
                    "train a model for each", data={"found": known},
                )
            )  # fmt: skip
    return out


def _twice(dataset: Dataset) -> list[Problem]:
    """Copies of a recording: what is trained on would be tested on."""
    return [
        Problem(
            "same-recording", True, f"{r.name} is a copy of {other.name}",
            "give each recording once", of=(r.name, other.name),
        )
        for k, r in enumerate(dataset.recordings)
        for other in dataset.recordings[:k]
        if np.array_equal(r.time, other.time) and _same(r.signals, other.signals)
    ]  # fmt: skip


def _same(a: Float, b: Float) -> bool:
    return a.shape == b.shape and np.allclose(a, b, rtol=0, atol=1e-5, equal_nan=True)


def _named(dataset: Dataset, channels: Sequence[str] | None) -> list[Problem]:
    missing = [c for c in channels or () if c not in dataset.channels]
    if not missing:
        return []
    what = f"{', '.join(missing)} of {dataset.device} is not among the channels"
    have = ", ".join(dataset.channels)
    return [
        Problem(
            "missing-channel",
            True,
            f"{what} {have}",
            "name the columns as the cords are named",
            data={"channels": tuple(missing)},
        )
    ]


def _numbers(dataset: Dataset) -> list[Problem]:
    """Numbers that are none, where there must be one."""
    out = []
    nowhere = dataset.ids[~np.isfinite(dataset.rest_points).all(axis=1)]
    if len(nowhere):
        told = ", ".join(map(str, nowhere.tolist()))
        out.append(
            Problem(
                "no-number", True, f"markers {told} have no place at rest",
                "give their markers.json, or leave them out",
                data={"markers": tuple(nowhere.tolist())},
            )
        )  # fmt: skip
    for r in dataset.recordings:
        part = np.isfinite(r.points).any(axis=2) != np.isfinite(r.points).all(axis=2)
        wrong = part | np.isinf(r.points).any(axis=2)
        if wrong.any():
            frame, k = (int(i) for i in np.argwhere(wrong)[0])
            out.append(
                Problem(
                    "no-number", True,
                    f"{r.name}: marker {dataset.ids[k]} has a place at {r.time[frame]:.2f} s of"
                    " which a part is no number",
                    "write three numbers, or none", of=(r.name,),
                    data={"markers": (int(dataset.ids[k]),), "time_s": float(r.time[frame])},
                )
            )  # fmt: skip
    return out


def _times(dataset: Dataset) -> list[Problem]:
    """Samples and frames at other times altogether."""
    out = []
    for r in dataset.recordings:
        if not (len(r.time) and len(r.sample_time)):
            continue
        (a, b), (c, d) = r.sample_time[[0, -1]], r.time[[0, -1]]
        if b < c or a > d:
            out.append(
                Problem(
                    "out-of-step", True,
                    f"{r.name}: samples ({a:.1f} to {b:.1f} s) and frames ({c:.1f} to {d:.1f} s)"
                    " have no time in common",
                    "process the session again, or tell how far their clocks are apart (--shift)",
                    of=(r.name,),
                )
            )  # fmt: skip
    return out


def _frames(dataset: Dataset) -> list[Problem]:
    out = []
    counts = {r.name: int(usable(r).sum()) for r in dataset.recordings}
    total, c = sum(counts.values()), len(dataset.channels)
    needed = max(_LEAST, _EACH * (1 + c))
    lasts = sum(
        counts[r.name] * float(np.median(np.diff(r.time)))
        for r in dataset.recordings
        if len(r.time) > 1
    )
    if total < needed:
        out.append(
            Problem(
                "too-few-frames", True,
                f"{total} of {dataset.frames} frames have markers and all signals, and {c} channels"
                f" need {needed}",
                "record for longer", total, data={"needed": needed},
            )
        )  # fmt: skip
    elif lasts < _SHORT:
        out.append(
            Problem(
                "few-frames", False,
                f"frames with markers and all signals last {lasts:.0f} s in all",
                f"record {_SHORT:.0f} s or more, with all ways in which the device moves", lasts,
            )
        )  # fmt: skip
    return out


def _hidden(dataset: Dataset) -> list[Problem]:
    """Frames before and after all samples, and without markers; markers that no camera saw."""
    out = []
    for r in dataset.recordings:
        bare = (r.time < r.sample_time[0]) | (r.time > r.sample_time[-1])
        if bare.mean() > _BARE:
            out.append(
                Problem(
                    "frames-without-samples", False,
                    f"{r.name}: {bare.mean():.0%} of the frames are before or after all samples"
                    f" (samples {r.sample_time[0]:.1f} to {r.sample_time[-1]:.1f} s, frames"
                    f" {r.time[0]:.1f} to {r.time[-1]:.1f} s)",
                    "see whether the file of the signals is cut off", float(bare.mean()), (r.name,),
                )
            )  # fmt: skip
        hidden = float((~r.seen.any(axis=1)).mean()) if len(r.time) else 1.0
        if hidden > _HIDDEN:
            out.append(
                Problem(
                    "frames-without-markers", hidden == 1,
                    f"{r.name}: {hidden:.0%} of the frames show no marker",
                    "move the cameras or the hands that cover the markers, and record again"
                    if hidden < 1 else "leave the recording out",
                    hidden, (r.name,),
                )
            )  # fmt: skip
    never = dataset.ids[~np.any([r.seen.any(axis=0) for r in dataset.recordings], axis=0)]
    if len(never):
        told = ", ".join(map(str, never.tolist()))
        out.append(
            Problem(
                "markers-never-seen", False, f"markers {told} were never seen",
                "they are not decoded; turn the device so that cameras see them", len(never),
                data={"markers": tuple(never.tolist())},
            )
        )  # fmt: skip
    return out


def _rest(dataset: Dataset) -> list[Problem]:
    lacking = [r.name for r in dataset.recordings if _rested(dataset, r) < _REST]
    if not lacking:
        return []
    every = len(lacking) == len(dataset.recordings)
    return [
        Problem(
            "no-rest-pose", every,
            f"{', '.join(lacking)}: the markers are never at rest for {_REST} s, within"
            f" {_STILL:.0f} mm of where they are designed",
            "begin with some seconds in which nothing touches the device; check that the tracks are"
            " in its frame",
            of=tuple(lacking),
        )
    ]  # fmt: skip


def _rested(dataset: Dataset, r: Recording) -> float:
    """s at once in which the markers that move are where they are at rest, as often as they are
    seen."""
    spread = np.zeros(len(dataset.ids))
    for k, there in enumerate(r.seen.T):
        if there.any():
            spread[k] = np.sqrt(r.points[there, k].var(axis=0).sum())
    moving = spread > _STILL / 3
    which = moving if moving.any() else np.ones_like(moving)
    seen = r.seen & which
    # Of each picture the median over its markers: some may be wrong.
    far = np.where(seen, np.linalg.norm(r.points - dataset.rest_points, axis=2), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # pictures without a marker
        off = np.nanmedian(far, axis=1)
    frames = np.flatnonzero(seen.any(axis=1))
    still = off[frames] <= _STILL
    begin, end = longest_at(np.asarray(still))
    return float(r.time[frames[end - 1]] - r.time[frames[begin]]) if end > begin else 0.0


def _as_predicted(r: Recording, predicted: Float | None) -> bool:
    """Whether signals tell so little because the cords lie so: what was predicted of them (t, c)
    tells no more, and a channel goes with that, so that they are in step."""
    if predicted is None:
        return False
    would = find_shift(
        replace(r, sample_time=r.time, ohm=1 + predicted, rest=np.ones(predicted.shape[1]))
    )
    if would is None or would.tells:
        return False
    signals = r.signals_at(r.time)
    for one, other in zip(signals.T, predicted.T, strict=True):
        known = np.isfinite(one) & np.isfinite(other)
        a, b = one[known] - one[known].mean(), other[known] - other[known].mean()
        if known.sum() >= _LEAST and a @ b > _ALIKE * np.linalg.norm(a) * np.linalg.norm(b) > 0:
            return True
    return False


def _steps(dataset: Dataset, predicted: Mapping[str, Float]) -> list[Problem]:
    """Signals that are not in step with the markers."""
    out = []
    for r in dataset.recordings:
        found = find_shift(r)
        if found is not None and not found.tells:
            told = f"{r.name}: signals tell {max(found.best, 0):.0%} of the markers' movement"
            if _as_predicted(r, predicted.get(r.name)):
                remedy = "cords that lie elsewhere would ('defsense build' shows the error)"
                told += ", as the simulation says of this layout"
                out.append(Problem("cords-tell-little", False, told, remedy, found.best, (r.name,)))
                continue
            out.append(
                Problem(
                    _TELL_NOTHING, found.best < _NOTHING,
                    f"{told}, shifted by up to {WITHIN:.0f} s either way",
                    "see whether the clocks are further apart (--shift, or --offset auto for files"
                    " of others), and whether signals and markers are of one device and time",
                    found.best, (r.name,),
                )
            )  # fmt: skip
        if found is None or not found.stands_out:
            continue
        out.append(
            Problem(
                _OUT_OF_STEP, abs(found.seconds) > _WRONG,
                f"{r.name}: signals are {abs(found.seconds):.2f} s"
                f" {'late' if found.seconds < 0 else 'early'}: they tell {found.best:.0%} of the"
                f" markers' movement when shifted by {found.seconds:+.2f} s, and {found.now:.0%} as"
                " they are",
                f"let them be shifted (--shift auto, or --shift {found.seconds:.2f})",
                found.seconds, (r.name,),
            )
        )  # fmt: skip
    return out
