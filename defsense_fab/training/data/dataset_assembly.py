"""Datasets of one layout as one: channels by their names, markers by their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Bool, Int
from ...core.errors import TrainingError
from .dataset import Dataset, Recording

# Places of markers that cameras hardly know: seen at a slant, or by one of them alone.

_USUAL, _LEAST = 5.0, 1.0  # of the median; mm


def without_uncertain(dataset: Dataset) -> tuple[Dataset, float]:
    """Without places whose stated standard deviation (of the distance) is over 1 mm and over five
    times the median, and which share of the places those were. By what the tracks say of
    themselves alone: an error is never the reason. As motion-capture systems leave them out."""
    stated = [np.sqrt((r.sigma**2).sum(axis=2)) for r in dataset.recordings]
    every = np.concatenate([s[np.isfinite(s)] for s in stated])
    if not len(every):
        return dataset, 0.0
    limit = max(_USUAL * float(np.median(every)), _LEAST)
    recordings = []
    for r, s in zip(dataset.recordings, stated, strict=True):
        gone: Bool = s > limit
        points = np.where(gone[..., None], np.nan, r.points)
        recordings.append(
            replace(r, points=points, sigma=np.where(gone[..., None], np.nan, r.sigma))
        )
    seen = sum(int(r.seen.sum()) for r in dataset.recordings)
    share = float((every > limit).sum()) / max(seen, 1)
    return replace(dataset, recordings=tuple(recordings)), share


#: mm, by which two sessions may have a marker at other places of the device at rest.
APART = 0.5


def without_markers(dataset: Dataset, ids: Sequence[int]) -> Dataset:
    """Raises TrainingError for numbers that no marker has, and where none is left."""
    unknown = [i for i in ids if i not in dataset.ids]
    if unknown or len(set(ids)) == len(dataset.ids):
        known = ", ".join(map(str, dataset.ids.tolist()))
        if unknown:
            raise TrainingError(
                f"no marker has the number {unknown[0]}; there are {known}",
                code="unknown-marker",
                marker=int(unknown[0]),
            )
        raise TrainingError(f"no marker would be left; there are {known}", code="no-markers-left")
    keep = ~np.isin(dataset.ids, ids)
    recordings = tuple(
        replace(r, points=r.points[:, keep], sigma=r.sigma[:, keep]) for r in dataset.recordings
    )
    return replace(
        dataset, ids=dataset.ids[keep], rest_points=dataset.rest_points[keep],
        recordings=recordings,
    )  # fmt: skip


def join(parts: Sequence[Dataset]) -> Dataset:
    """All recordings of the `parts`, with the channels and the order of the first one's, and the
    markers of all. Raises TrainingError for parts of different devices, layouts, channels, or
    places of markers."""
    if not parts:
        raise TrainingError(
            "there is nothing to train on: give a session, a dataset or two files", code="no-data"
        )
    first = parts[0]
    layouts = dict.fromkeys(p.layout for p in parts if p.layout)
    for part in parts[1:]:
        if part.device != first.device:
            raise TrainingError(
                f"{_name(part)} is of the device {part.device!r}, and {_name(first)} of"
                f" {first.device!r}; train a model for each",
                code="devices-differ",
                devices=(first.device, part.device),
            )
    if len(layouts) > 1:
        a, b = (next(p for p in parts if p.layout == hash_) for hash_ in list(layouts)[:2])
        raise TrainingError(
            f"{_name(a)} and {_name(b)} were recorded with cords laid differently (layouts"
            f" {a.layout} and {b.layout}); train a model for each",
            code="layouts-differ",
            layouts=(a.layout, b.layout),
        )
    ids = np.unique(np.concatenate([p.ids for p in parts]))
    if np.array_equal(ids, np.sort(first.ids)):
        ids = first.ids
    rest = np.full((len(ids), 3), np.nan)
    for part in parts:
        at = _places(ids, part.ids)
        known = np.isfinite(rest[at, 0])
        off = np.linalg.norm(rest[at] - part.rest_points, axis=1)
        if (off[known] > APART).any():
            k = int(np.argmax(np.where(known, off, 0.0)))
            raise TrainingError(
                f"{_name(part)}: marker {part.ids[k]} is {off[k]:.1f} mm from where {_name(first)}"
                " has it at rest; train on sessions with the same markers.json",
                code="markers-moved",
                marker=int(part.ids[k]),
                distance_mm=float(off[k]),
            )
        rest[at] = np.where(known[:, None], rest[at], part.rest_points)
    recordings = [r for part in parts for r in _matched(part, first.channels, ids)]
    told: dict[str, object] = {}
    for part in parts:
        for key, value in part.provenance.items():
            before = told.get(key)
            told[key] = [*before, *value] if _lists(before, value) else value  # type: ignore[misc]
    return Dataset(
        first.device, next(iter(layouts), ""), first.channels, ids, rest, tuple(recordings), told
    )


def in_order(part: Dataset, channels: Sequence[str]) -> Dataset:
    """With the `channels` of a device, by their names. Raises TrainingError where one is missing,
    or there are others."""
    recordings = tuple(_matched(part, tuple(channels), part.ids))
    return replace(part, channels=tuple(channels), recordings=recordings)


def without(
    dataset: Dataset, channels: Sequence[str] = (), recordings: Sequence[str] = ()
) -> Dataset:
    """All but some channels and recordings. Raises TrainingError for names that there are not, and
    where nothing is left."""
    for what, names, known, unknown, empty in (
        ("channel", channels, dataset.channels, "unknown-channel", "no-channels-left"),
        (
            "recording",
            recordings,
            tuple(r.name for r in dataset.recordings),
            "unknown-recording",
            "no-recordings-left",
        ),
    ):
        others = [name for name in names if name not in known]
        if others:
            raise TrainingError(
                f"there is no {what} {others[0]}; there are {', '.join(known)}",
                code=unknown,
                name=others[0],
                known=known,
            )
        if len(set(names)) == len(known):
            raise TrainingError(f"no {what} is left; leave fewer out", code=empty)
    kept = [k for k, name in enumerate(dataset.channels) if name not in channels]
    return replace(
        dataset,
        channels=tuple(dataset.channels[k] for k in kept),
        recordings=tuple(
            replace(r, ohm=r.ohm[:, kept], rest=r.rest[kept])
            for r in dataset.recordings
            if r.name not in recordings
        ),
    )


def _matched(part: Dataset, channels: tuple[str, ...], ids: Int) -> list[Recording]:
    missing = [c for c in channels if c not in part.channels]
    others = [c for c in part.channels if c not in channels]
    if missing or others:
        wrong = f"has no channel {missing[0]}" if missing else f"has a channel {others[0]} more"
        raise TrainingError(
            f"{_name(part)}: {wrong}: its channels are {', '.join(part.channels)}, wanted are"
            f" {', '.join(channels)}; name them alike, or leave it out",
            code="channels-differ",
            missing=tuple(missing),
            extra=tuple(others),
        )
    order = [part.channels.index(c) for c in channels]
    at = _places(ids, part.ids)
    out = []
    for r in part.recordings:
        points, sigma = np.full((2, len(r.time), len(ids), 3), np.nan)
        points[:, at], sigma[:, at] = r.points, r.sigma
        matched = replace(r, ohm=r.ohm[:, order], rest=r.rest[order], points=points, sigma=sigma)
        out.append(matched)
    return out


def _places(ids: Int, of: Int) -> Int:
    """Where the markers `of` (k,) are among `ids`."""
    order = np.argsort(ids)
    return np.asarray(order[np.searchsorted(ids, of, sorter=order)])


def _lists(a: object, b: object) -> bool:
    return isinstance(a, list | tuple) and isinstance(b, list | tuple)


def _name(part: Dataset) -> str:
    return part.recordings[0].session or part.recordings[0].name
