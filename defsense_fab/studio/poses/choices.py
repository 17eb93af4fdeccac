"""Buttons side by side, which take less room than one below the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..workbench.workbench import Workbench


def choices(
    bench: Workbench, label: str, actions: Mapping[str, Callable[[], Any]], hint: str
) -> Any:
    """One for each action, by name; errors are told on the page."""
    group = bench.server.gui.add_button_group(label, tuple(actions), hint=hint)

    def clicked(event: Any) -> None:
        if event.client is not None:
            bench.run_action(actions[group.value])

    group.on_click(clicked)
    return group
