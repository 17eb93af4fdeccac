"""What a build's `state.json` holds: of each finished stage what it was made of and left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .stages import read_json

STATE = "state.json"


def load_state(folder: Path) -> dict[str, Any]:
    """By the stage's name; empty where there is none that can be read."""
    try:
        state = read_json(folder / STATE)
    except (FileNotFoundError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}
