"""The part of the panel that is about the next cord."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane
from ...core.device.device import Sensor
from ...optimize.prediction.body_section import BodySection
from ...optimize.prediction.layout_judge import LayoutJudge
from ...optimize.prediction.next_cord import map_next_cord, NextCord
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench

# The search for the place of the next cord, beside the page.


@dataclass(frozen=True)
class Asked:
    """Beside which `sensors`, in which `plane`, of which `length` (mm; None: from skin to skin)."""

    judge: LayoutJudge
    body: BodySection
    plane: Plane
    sensors: Sequence[Sensor]
    length: float | None


class HeatSearch:
    """One search at a time. `told` hears of the share that is done, 0 to 1, or None once nothing is
    under way; `found` takes the coarse map and the fine one; all on a thread of this."""

    def __init__(
        self,
        told: Callable[[float | None], None],
        found: Callable[[Asked, NextCord], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._told, self._found = told, found
        self._lock = threading.Lock()
        self._wanted: Asked | None = None
        self._work = LatestWorker(self._search, failed)

    def start(self, asked: Asked) -> None:
        """In place of what is under way."""
        with self._lock:
            self._wanted = asked
        self._work.give(asked)

    def cancel(self) -> None:
        """What is under way ends within some hundredths of a second, without a map."""
        with self._lock:
            self._wanted = None

    def wait(self, seconds: float) -> bool:
        """Whether nothing is under way within so many s."""
        return self._work.wait(seconds)

    def close(self) -> None:
        self.cancel()
        self._work.close()

    def _search(self, asked: Asked) -> None:
        if self._wanted is not asked:
            return
        try:
            self._told(0.0)
            for known in map_next_cord(
                asked.judge, asked.body, asked.plane, asked.sensors, asked.length
            ):
                if self._wanted is not asked:
                    return
                self._told(known.share if known.fine else 0.0)
                if known.share == 1.0:
                    self._found(asked, known)
        finally:
            self._told(None)


_SHORT, _THROUGH = "short ones", "from skin to skin"
_LEAST, _MOST = 10.0, 1000.0  # mm, of a short cord


class NextCordPanel:
    """Shown while one looks at where the next cord would help."""

    def __init__(
        self,
        bench: Workbench,
        again: Callable[[], None],
        cancel: Callable[[], None],
        draw: Callable[[], None],
    ) -> None:
        gui = bench.server.gui
        self._folder = gui.add_folder("The next cord", visible=False)
        with self._folder:
            self._kind = gui.add_dropdown(
                "Cords tried", (_SHORT, _THROUGH),
                hint="Short ones tell where; those from skin to skin can be made as they are",
            )  # fmt: skip
            self._length = gui.add_number(
                "Length, mm", 30.0, min=_LEAST, max=_MOST, step=1.0, hint="Of a short cord"
            )
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self._told = gui.add_markdown("")
            self._draw = bench.button("Draw a cord there", "The orange one", draw, disabled=True)
            self._cancel = bench.button("Cancel the search", "Keep what is shown", cancel)
            self._cancel.visible = False
        for control in (self._kind, self._length):
            control.on_update(lambda event: again() if event.client is not None else None)
        self._kind.on_update(lambda _: self._show_length())

    @property
    def length(self) -> float | None:
        """Of the cords that are tried, mm; None from skin to skin."""
        return float(self._length.value) if self._kind.value == _SHORT else None

    def begin(self, shortest: float) -> None:
        """With short cords of that length, mm."""
        self._length.value = shortest

    def choose(self, length: float | None) -> None:
        """Which cords are tried, from a program."""
        self._kind.value = _THROUGH if length is None else _SHORT
        if length is not None:
            self._length.value = length
        self._show_length()

    def show(self, shown: bool) -> None:
        self._folder.visible = shown

    def searched(self, share: float | None) -> None:
        """A search has come so far, or is over."""
        self._bar.visible = self._cancel.visible = share is not None
        self._bar.value = 100 * (share or 0.0)

    def say(self, told: str) -> None:
        """Markdown; nothing can be drawn."""
        self._told.content, self._draw.disabled = told, True

    def say_found(self, found: NextCord) -> None:
        """What a map says."""
        self._told.content = found_words(found, self.length)
        self._draw.disabled = found.best is None

    def _show_length(self) -> None:
        self._length.visible = self._kind.value == _SHORT


def found_words(found: NextCord, length: float | None) -> str:
    """Markdown: the best place, the drop there, what was tried."""
    kind = "from skin to skin" if length is None else f"of {length:g} mm"
    tried = f"{found.tried} cords {kind} tried, {found.step:.1f} mm apart"
    if not found.tried:
        return (
            f"No cord {kind} has room in this plane beside those that there are: move the plane,"
            " or try the other kind of cords, or other lengths."
        )
    if found.best is None:
        return f"No cord here lowers the expected error of {found.error:.2f} mm; {tried}."
    middle = format_point(found.ends[found.best].mean(axis=0))
    return (
        f"Best: **{found.error:.2f} → {found.error - found.best_drop:.2f} mm** about {middle};"
        f" {tried}, by the fast decoders on unseen states."
    )


def drop_words(found: NextCord, rest: Float) -> str:
    """Of a point (3,) mm at rest, what a cord through it would do."""
    away = np.linalg.norm(found.points - rest, axis=1)
    at = int(away.argmin()) if len(away) else -1
    if at < 0 or np.isnan(found.drop[at]) or away[at] > found.step:
        return "no cord has room here"
    return f"a cord through it changes the expected error by {-found.drop[at]:+.2f} mm".replace(
        "+-", "-"
    )
