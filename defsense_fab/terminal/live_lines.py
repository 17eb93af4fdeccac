"""A calm line or two for each live device, that say how it does."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Sequence
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from ..core.errors import DefsenseError
from ..pipeline.live.live_loop import LiveStatus
from ..pipeline.live.live_run import LiveRun
from ..runtime.frames.live_frame import Quality

_EVERY = 0.25  # s between two looks
_TOLD = 1.0  # s between two lines of JSON
_COLORS = {Quality.TRUSTED: "green", Quality.UNTRAINED: "yellow", Quality.FALLBACK: "yellow",
           Quality.LOST: "red"}  # fmt: skip
_BAR = 10


class LiveLines:
    """Follows runs on a terminal; where there is none, or with `as_json`, lines follow each other,
    as what they say changes."""

    def __init__(self, runs: Sequence[LiveRun], *, as_json: bool = False) -> None:
        self._runs, self._json = runs, as_json
        self._console = Console(stderr=False)
        self._live: Live | None = None
        self._told, self._last = [""] * len(runs), -math.inf

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._json:
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.__exit__(None, None, None)

    def follow(self, seconds: float | None) -> None:
        """Until all runs have ended, so many s have passed, or Ctrl-C. Raises what ended the last
        of them."""
        begun, failure = time.monotonic(), dict[int, DefsenseError]()
        try:
            while seconds is None or time.monotonic() - begun < seconds:
                for k, run in enumerate(self._runs):
                    if k not in failure:
                        try:
                            run.loop.wait(0)
                        except DefsenseError as error:
                            failure[k] = error
                self._show(failure)
                if len(failure) == len(self._runs):
                    raise next(iter(failure.values()))
                time.sleep(_EVERY)
        except KeyboardInterrupt:
            self._console.print("ended")

    def _show(self, failure: dict[int, DefsenseError]) -> None:
        states = [run.loop.status for run in self._runs]
        if self._json:
            self._tell_json(states)
        elif self._live is not None:
            rows = [row for k, s in enumerate(states) for row in page(s, failure.get(k))]
            self._live.update(Group(*rows), refresh=True)
        else:
            for k, s in enumerate(states):
                text = "; ".join([s.frame.quality.value if s.frame else "waiting", *s.notes])
                if text != self._told[k]:
                    self._told[k] = text
                    name = s.frame.device if s.frame else "device"
                    print(f"{name}: {text}", flush=True)  # noqa: T201

    def _tell_json(self, states: Sequence[LiveStatus]) -> None:
        if time.monotonic() - self._last < _TOLD:
            return
        self._last = time.monotonic()
        for s in states:
            sys.stdout.write(json.dumps(as_mapping(s)) + "\n")
        sys.stdout.flush()


def page(status: LiveStatus, failure: DefsenseError | None = None) -> list[Text]:
    """Lines for one device."""
    frame = status.frame
    if failure is not None:
        return [Text(f"ended: {failure}", "red")]
    if frame is None:
        return [Text("waiting for samples", "yellow"), *_notes(status)]
    line = Text(f"{frame.device} ")
    said = frame.quality.value + (f" without {frame.lost}" if frame.lost else "")
    line.append(said, f"bold {_COLORS[frame.quality]}")
    line.append(f"  {status.rate:.0f} Hz", "dim")
    if status.surfaces:
        line.append(f", {status.surfaces:.0f} surfaces/s", "dim")
    line.append(f", {_ms(status.decoded)} to outputs", "dim")
    if status.surfaces:
        line.append(f", {_ms(status.shown)} to the view", "dim")
    rows = [line]
    if frame.controls:
        bars = Text()
        for name, value in frame.controls.items():
            filled = round(_BAR * min(abs(value), 1.0))
            bars.append(f"{name} ")
            bars.append("━" * filled, "cyan")
            bars.append("━" * (_BAR - filled), "bright_black")
            bars.append(f" {value:5.2f}   ")
        rows.append(bars)
    return rows + _notes(status)


def _notes(status: LiveStatus) -> list[Text]:
    return [Text(f"! {note}", "yellow") for note in status.notes]


def _ms(seconds: tuple[float, float]) -> str:
    return f"{1e3 * seconds[0]:.1f} ms (99 %: {1e3 * seconds[1]:.1f})"


def as_mapping(status: LiveStatus) -> dict[str, object]:
    """For --json: plain values, None for what is not known."""
    frame = status.frame

    def known(x: float) -> float | None:
        return x if math.isfinite(x) else None

    out: dict[str, object] = {
        "rate": status.rate, "samples": status.samples, "skipped": status.skipped,
        "latency": {"outputs": [known(x) for x in status.decoded],
                    "view": [known(x) for x in status.shown]},
        "notes": list(status.notes),
    }  # fmt: skip
    if frame is not None:
        out |= {
            "device": frame.device, "time": frame.time, "quality": frame.quality.value,
            "lost": frame.lost, "controls": dict(frame.controls),
            "confidence": dict(frame.confidence), "distance": known(frame.distance),
            "ohm": [known(float(r)) for r in frame.ohms],
        }  # fmt: skip
    return out
