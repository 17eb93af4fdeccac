"""What the view's panel does and asks, linked to the run that it belongs to."""

from __future__ import annotations

import math
from collections.abc import Callable

from ...core.errors import DefsenseError
from ..frames.live_decoder import LiveDecoder
from ..view.live_view import PanelActions
from .animations import Animations
from .live_loop import LiveLoop
from .run_folder import RunFolder

_FILE = "animation.glb"


def panel_actions(
    decoder: LiveDecoder, animations: Animations | None, folder: RunFolder
) -> PanelActions:
    """Of a run whose files go to `folder`; without `animations` none can be recorded."""
    if animations is None:
        return PanelActions(decoder.rest_now)
    return PanelActions(
        decoder.rest_now, record_button(animations, folder),
        lambda: animations.recording is not None,
    )  # fmt: skip


def record_button(animations: Animations, folder: RunFolder) -> Callable[[bool], str]:
    """Starts an animation in the run's folder, and stops the one that is being recorded."""

    def clicked(on: bool) -> str:
        try:
            if on:
                return f"recording into {animations.start(folder.make() / _FILE)}"
            written = animations.finish()
        except DefsenseError as error:
            again = "; press again to try once more" if animations.recording and not on else ""
            return f"{error}{again}"
        return "no animation was being recorded" if written is None else written.told

    return clicked


def follow(actions: PanelActions, loop: LiveLoop) -> None:
    """From now on the panel tells the loop's notes, and how late it is."""
    actions.notes = lambda: loop.status.notes
    actions.latency = lambda: latency(loop.status.shown)


def latency(shown: tuple[float, float]) -> str:
    """Of median and 99th percentile, s, until frames were handed to the view; NaN: none yet."""
    if not all(map(math.isfinite, shown)):
        return ""
    median, most = (1e3 * s for s in shown)
    return f"{median:.0f} ms from the sample to the view (99 %: {most:.0f} ms)"
