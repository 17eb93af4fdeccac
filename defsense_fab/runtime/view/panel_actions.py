"""What the buttons of a live view do, and where its texts come from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ...core.arrays import Float
from ..frames.live_frame import Note


@dataclass
class PanelActions:
    """The actions of a live view's buttons, and the sources of its texts.

    Attributes:
        rest: Takes the present readings as those at rest; None for no button.
        record: Starts (True) or stops (False) an animation, and returns a message about it; None
            for no button.
        is_recording: Returns whether an animation is being recorded.
        notes: Returns notes on the whole run, which replace those of the frame.
        latency: Returns a sentence about the latency.
        bend: Bends the simulated device to levels of poses, 0 to 1, or lets it move automatically
            with None; None for a real device.
        poses: Names of the poses that the simulated device can be bent by.
        shape: Returns the true surface (v, 3) of the simulated device, mm; None for a real device.
        undo_rest: Uses the resistances at rest as they were before `rest`.
    """

    rest: Callable[[], None] | None = None
    record: Callable[[bool], str] | None = None
    is_recording: Callable[[], bool] = lambda: False
    notes: Callable[[], Sequence[Note | str]] | None = None
    latency: Callable[[], str] | None = None
    bend: Callable[[Mapping[str, float] | None], None] | None = None
    poses: tuple[str, ...] = ()
    shape: Callable[[], Float] | None = None
    undo_rest: Callable[[], None] | None = None
