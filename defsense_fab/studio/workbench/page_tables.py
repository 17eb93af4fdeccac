"""Errors by state as errors by pose."""

from __future__ import annotations

from collections.abc import Mapping


def extremes(per_state: Mapping[str, float]) -> dict[str, float]:
    """By pose: the error in its farthest single state (pose@1, ...); mixtures are left out."""
    best: dict[str, tuple[float, float]] = {}
    for state, mm in per_state.items():
        pose, at, level = state.partition("@")
        if not at or "+" in state:
            continue
        share = float(level)
        if share > best.get(pose, (-1.0, 0.0))[0]:
            best[pose] = (share, mm)
    return {pose: mm for pose, (_, mm) in best.items()}
