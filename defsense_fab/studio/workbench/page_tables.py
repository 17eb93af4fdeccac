"""Cells and values of the tables on the page."""

from __future__ import annotations

import html
from collections.abc import Mapping


def escape_cell(text: str) -> str:
    """Return a text that neither ends its cell of a markdown table nor is read as HTML."""
    return html.escape(text, quote=False).replace("|", "\\|")


def full_pose_errors(per_state: Mapping[str, float]) -> dict[str, float]:
    """Return each pose's error in its largest single state; mixed states are left out.

    Args:
        per_state: Errors, mm, by state: "pose@level" for single states.
    """
    best: dict[str, tuple[float, float]] = {}
    for state, error in per_state.items():
        pose, at_sign, level = state.partition("@")
        if not at_sign or "+" in state:
            continue
        share = float(level)
        if share > best.get(pose, (-1.0, 0.0))[0]:
            best[pose] = (share, error)
    return {pose: error for pose, (_, error) in best.items()}
