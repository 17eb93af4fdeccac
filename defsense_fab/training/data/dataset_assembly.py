"""Join datasets, and select their channels, targets, recordings and certain positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Bool, Int
from ...core.errors import TrainingError
from ...decoding.quantities import Readings
from .dataset import Dataset, Recording

_MAX_MARKER_SHIFT_MM = 0.5  # between the rest positions of one marker in two sessions
_UNCERTAIN_RATIO = 5.0  # times the median standard deviation, beyond which a position is uncertain
_UNCERTAIN_MM = 1.0  # smaller standard deviations are never uncertain


def join_datasets(parts: Sequence[Dataset]) -> Dataset:
    """Join the recordings of several datasets of one device and layout.

    Channels are matched by name and have the order of the first dataset; markers are matched by
    number, and the result has the markers of all parts. Other targets are matched by name; all
    parts must have the same ones. Readings are taken relative to the reference of the first part.

    Args:
        parts: The datasets, at least one.

    Returns:
        The joined dataset. Lists in the provenance are concatenated; of other values, the last
        part's is kept.

    Raises:
        TrainingError: If there are no parts, or if their devices, layouts, channels, targets,
            units or marker positions differ.
    """
    if not parts:
        raise TrainingError(
            "no training data given",
            code="no-data",
            action="Give a session, a dataset or two files",
        )
    first = parts[0]
    layout = _common_layout(parts)
    if first.targets is not None or any(p.targets is not None for p in parts):
        parts = [_match_targets(p, first) for p in parts]
    if first.readings is not None or any(p.readings is not None for p in parts):
        parts = [_match_readings(p, first) for p in parts]
    ids = np.unique(np.concatenate([p.ids for p in parts]))
    if np.array_equal(ids, np.sort(first.ids)):
        ids = first.ids
    rest_points = np.full((len(ids), first.rest_points.shape[1]), np.nan)
    for part in parts:
        index = _marker_indices(ids, part.ids)
        is_known = np.isfinite(rest_points[index, 0])
        distance = np.linalg.norm(rest_points[index] - part.rest_points, axis=1)
        if (distance[is_known] > _MAX_MARKER_SHIFT_MM).any():
            k = int(np.argmax(np.where(is_known, distance, 0.0)))
            raise TrainingError(
                f"the rest position of marker {part.ids[k]} is {distance[k]:.1f} mm from that in"
                f" {_session_name(first)}",
                code="markers-moved",
                where=_session_name(part),
                action="Train on sessions with the same markers.json",
                marker=int(part.ids[k]),
                distance_mm=float(distance[k]),
            )
        rest_points[index] = np.where(is_known[:, None], rest_points[index], part.rest_points)
    recordings = [r for part in parts for r in _rearrange(part, first.channels, ids)]
    provenance: dict[str, object] = {}
    for part in parts:
        for key, value in part.provenance.items():
            previous = provenance.get(key)
            provenance[key] = (
                [*previous, *value] if _are_lists(previous, value) else value  # type: ignore[misc]
            )
    return replace(
        first,
        layout=layout,
        ids=ids,
        rest_points=rest_points,
        recordings=tuple(recordings),
        provenance=provenance,
    )


def use_readings(dataset: Dataset, readings: Readings | None) -> Dataset:
    """Compute the signals of readings relative to another reference.

    Args:
        dataset: The dataset.
        readings: Units, reference and scale of its channels; without an effect if it is None.

    Returns:
        The dataset.
    """
    if readings is None:
        return dataset
    recordings = tuple(
        replace(r, rest=readings.reference, scale=readings.scale) for r in dataset.recordings
    )
    return replace(dataset, readings=readings, recordings=recordings)


def select_channels(dataset: Dataset, channels: Sequence[str]) -> Dataset:
    """Put the channels into the order of a device.

    Args:
        dataset: The dataset.
        channels: Names of all channels of the device, in the required order.

    Returns:
        The dataset with its channels in that order.

    Raises:
        TrainingError: If a channel is missing, or if the dataset has others.
    """
    recordings = tuple(_rearrange(dataset, tuple(channels), dataset.ids))
    readings = dataset.readings
    if readings is not None:
        readings = readings.select([dataset.channels.index(name) for name in channels])
    return replace(dataset, channels=tuple(channels), recordings=recordings, readings=readings)


def exclude_channels(dataset: Dataset, names: Sequence[str]) -> Dataset:
    """Leave out some channels.

    Args:
        dataset: The dataset.
        names: Names of the channels to leave out.

    Returns:
        The dataset without them.

    Raises:
        TrainingError: If no channel has one of the names, or if no channel is left.
    """
    known = ", ".join(dataset.channels)
    if unknown := [name for name in names if name not in dataset.channels]:
        raise TrainingError(
            f"no channel has the name {unknown[0]}",
            code="unknown-channel",
            where="without_channels",
            action=f"Choose from {known}",
            channel=unknown[0],
        )
    kept = [k for k, name in enumerate(dataset.channels) if name not in names]
    if not kept:
        raise TrainingError(
            f"no channel is left of {known}",
            code="no-channels-left",
            action="Keep at least one channel that changes",
        )
    return select_channel_indices(dataset, kept)


def select_channel_indices(dataset: Dataset, index: Sequence[int]) -> Dataset:
    """Return the dataset with the channels of some indices, in this order."""
    i = list(index)
    recordings = tuple(
        replace(r, ohm=r.ohm[:, i], rest=r.rest[i], scale=None if r.scale is None else r.scale[i])
        for r in dataset.recordings
    )
    return replace(
        dataset,
        channels=tuple(dataset.channels[k] for k in i),
        recordings=recordings,
        readings=None if dataset.readings is None else dataset.readings.select(i),
    )


def select_targets(dataset: Dataset, which: Bool | Int) -> Dataset:
    """Return the dataset with the targets or markers of a mask (m,) or of some indices."""
    recordings = tuple(
        replace(r, points=r.points[:, which], sigma=r.sigma[:, which]) for r in dataset.recordings
    )
    return replace(
        dataset,
        ids=dataset.ids[which],
        rest_points=dataset.rest_points[which],
        recordings=recordings,
        targets=None if dataset.targets is None else dataset.targets.select(which),
    )


def exclude_markers(dataset: Dataset, ids: Sequence[int]) -> Dataset:
    """Leave out some markers.

    Args:
        dataset: The dataset.
        ids: Numbers of the markers to leave out.

    Returns:
        The dataset without them.

    Raises:
        TrainingError: If no marker has one of the numbers, or if no marker is left.
    """
    unknown = [i for i in ids if i not in dataset.ids]
    known = ", ".join(map(str, dataset.ids.tolist()))
    if unknown:
        raise TrainingError(
            f"no marker has the number {unknown[0]}",
            code="unknown-marker",
            action=f"Choose from {known}",
            marker=int(unknown[0]),
        )
    if len(set(ids)) == len(dataset.ids):
        raise TrainingError(
            f"no marker is left of {known}",
            code="no-markers-left",
            action="Keep at least one marker",
        )
    return select_targets(dataset, ~np.isin(dataset.ids, ids))


def exclude_uncertain_positions(dataset: Dataset) -> tuple[Dataset, float]:
    """Leave out marker positions that the cameras hardly know.

    Such markers are seen at a slant, or by one camera only. A position is left out if its stated
    standard deviation (of the distance) is over 1 mm and over five times the median, as
    motion-capture systems do. Only the stated deviations decide; an error is never the reason.

    Args:
        dataset: The dataset.

    Returns:
        The dataset with these positions set to NaN, and their share of all visible positions.
    """
    stated = [np.sqrt((r.sigma**2).sum(axis=2)) for r in dataset.recordings]
    known = np.concatenate([s[np.isfinite(s)] for s in stated])
    if not len(known):
        return dataset, 0.0
    limit = max(_UNCERTAIN_RATIO * float(np.median(known)), _UNCERTAIN_MM)
    recordings = []
    for r, s in zip(dataset.recordings, stated, strict=True):
        is_uncertain: Bool = s > limit
        points = np.where(is_uncertain[..., None], np.nan, r.points)
        recordings.append(
            replace(r, points=points, sigma=np.where(is_uncertain[..., None], np.nan, r.sigma))
        )
    visible = sum(int(r.visible.sum()) for r in dataset.recordings)
    share = float((known > limit).sum()) / max(visible, 1)
    return replace(dataset, recordings=tuple(recordings)), share


def _common_layout(parts: Sequence[Dataset]) -> str:
    """Return the layout of all parts (empty if none is known); check it and the device."""
    first = parts[0]
    for part in parts[1:]:
        if part.device != first.device:
            raise TrainingError(
                f"is of the device {part.device!r}, and {_session_name(first)} of {first.device!r}",
                code="devices-differ",
                where=_session_name(part),
                action="Train a model for each device",
                devices=(first.device, part.device),
            )
    layouts = dict.fromkeys(p.layout for p in parts if p.layout)
    if len(layouts) > 1:
        a, b = (next(p for p in parts if p.layout == hash_) for hash_ in list(layouts)[:2])
        raise TrainingError(
            f"was recorded with another layout of cords ({b.layout}) than {_session_name(a)}"
            f" ({a.layout})",
            code="layouts-differ",
            where=_session_name(b),
            action="Train a model for each layout",
            layouts=(a.layout, b.layout),
        )
    return next(iter(layouts), "")


def _rearrange(part: Dataset, channels: tuple[str, ...], ids: Int) -> list[Recording]:
    """Return the recordings with these channels and markers, in their order."""
    missing = [c for c in channels if c not in part.channels]
    extra = [c for c in part.channels if c not in channels]
    if missing or extra:
        wrong = f"has no channel {missing[0]}" if missing else f"has an extra channel {extra[0]}"
        raise TrainingError(
            f"{wrong}: its channels are {', '.join(part.channels)}, but {', '.join(channels)} are"
            " expected",
            code="channels-differ",
            where=_session_name(part),
            action="Name the channels alike, or leave this data out",
            missing=tuple(missing),
            extra=tuple(extra),
        )
    order = [part.channels.index(c) for c in channels]
    index = _marker_indices(ids, part.ids)
    recordings = []
    for r in part.recordings:
        points, sigma = np.full((2, len(r.time), len(ids), r.points.shape[2]), np.nan)
        points[:, index], sigma[:, index] = r.points, r.sigma
        ohm, rest = r.ohm[:, order], r.rest[order]
        scale = None if r.scale is None else r.scale[order]
        recordings.append(replace(r, ohm=ohm, rest=rest, scale=scale, points=points, sigma=sigma))
    return recordings


def _match_targets(part: Dataset, first: Dataset) -> Dataset:
    """Return a dataset with the targets of another, in their order; they must not differ."""
    mine, others = part.targets, first.targets
    if mine is None or others is None or set(mine.names) != set(others.names):
        a, b = (_list_targets(p) for p in (part, first))
        raise TrainingError(
            f"its targets are {a}, but those of {_session_name(first)} are {b}",
            code="targets-differ",
            where=_session_name(part),
            action="Give the same targets, named alike, for all runs",
            found=() if mine is None else mine.names,
            expected=() if others is None else others.names,
        )
    order = np.array([mine.names.index(name) for name in others.names])
    units = tuple(mine.units[k] for k in order.tolist())
    if units != others.units or mine.axes != others.axes:
        k = next((k for k, u in enumerate(units) if u != others.units[k]), 0)
        raise TrainingError(
            f"{others.names[k]} is in {units[k] or 'no stated unit'}, but in"
            f" {others.units[k] or 'no stated unit'} in {_session_name(first)}",
            code="units-differ",
            where=_session_name(part),
            action="Give all runs in the same units",
            target=others.names[k],
            units=(units[k], others.units[k]),
        )
    recordings = tuple(
        replace(r, points=r.points[:, order], sigma=r.sigma[:, order]) for r in part.recordings
    )
    return replace(
        part, ids=first.ids, targets=others, recordings=recordings, rest_points=first.rest_points
    )


def _list_targets(part: Dataset) -> str:
    names = "markers" if part.targets is None else ", ".join(part.targets.names)
    return names or "unknown"


def _match_readings(part: Dataset, first: Dataset) -> Dataset:
    """Return a dataset with the reference of another; raise an error if the quantities differ."""
    mine, others = part.readings, first.readings
    if mine is not None and others is not None and set(part.channels) == set(first.channels):
        order = [first.channels.index(name) for name in part.channels]
        expected = others.select(order)
        if mine.units == expected.units:
            return use_readings(part, expected)
        k = next(k for k, u in enumerate(mine.units) if u != expected.units[k])
        units = mine.units[k], expected.units[k]
        channel = part.channels[k]
    elif (mine is None) != (others is None):
        a, b = (
            "ohm with R0" if each is None else ", ".join(dict.fromkeys(each.units))
            for each in (mine, others)
        )
        units, channel = (a, b), "the signal"
    else:
        return part  # channels differ, which is reported where they are put in order
    raise TrainingError(
        f"{channel} is in {units[0]}, but in {units[1]} in {_session_name(first)}",
        code="units-differ",
        where=_session_name(part),
        action="Give all runs in the same units",
        channel=channel,
        units=units,
    )


def _marker_indices(ids: Int, selected: Int) -> Int:
    """Return the indices in `ids` (m,) of the markers `selected` (k,)."""
    order = np.argsort(ids)
    return np.asarray(order[np.searchsorted(ids, selected, sorter=order)])


def _are_lists(a: object, b: object) -> bool:
    return isinstance(a, list | tuple) and isinstance(b, list | tuple)


def _session_name(part: Dataset) -> str:
    return part.recordings[0].session or part.recordings[0].name
