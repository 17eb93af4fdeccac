"""A calm line or two for each live device, that say how it does."""

from __future__ import annotations

import json
import logging
import math
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from ...capture.readout.source import RecordingEnd
from ...core.errors import DefsenseError, LiveError
from ...runtime.frames.live_frame import Quality
from ...runtime.live.live_loop import LiveStatus
from ...runtime.live.live_run import LiveRun

_EVERY = 0.25  # s between two looks
_TOLD = 1.0  # s between two lines of JSON
_PASSING = re.compile(r"\d+ s\b")  # what alone makes no new line: for how long it is so
_log = logging.getLogger(__name__)
_COLORS = {Quality.TRUSTED: "green", Quality.UNTRAINED: "yellow", Quality.FALLBACK: "yellow",
           Quality.LOST: "red"}  # fmt: skip
_BAR = 10


@dataclass
class _Followed:
    """A run, what it is called, what was told of it last, and why it has `ended`, if it has."""

    run: LiveRun
    label: str
    told: str = ""
    ended: str | None = None


class LiveLines:
    """Follows runs on a terminal; where there is none, or with `as_json`, lines follow each other,
    as what they say changes."""

    def __init__(self, runs: Sequence[LiveRun], *, as_json: bool = False) -> None:
        self._all = [_Followed(run, label) for run, label in zip(runs, labels(runs), strict=True)]
        self._json = as_json
        self._console = Console(stderr=False)
        self._live: Live | None = None
        self._last = -math.inf

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._json:
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.__exit__(None, None, None)

    def follow(self, seconds: float | None) -> None:
        """Until all runs have ended, so many s have passed, or Ctrl-C. A run that has ended is
        told once, and closed while others go on. Raises the last error that ended one; a recording
        that is at its end is none."""
        begun, failure = time.monotonic(), list[DefsenseError]()
        try:
            while seconds is None or time.monotonic() - begun < seconds:
                new = [each for each in self._all if each.ended is None]
                failure += [error for each in new if (error := _look(each)) is not None]
                new = [each for each in new if each.ended is not None]
                self._show(new)
                if all(each.ended is not None for each in self._all):
                    break
                for each in new:
                    each.run.end()
                time.sleep(_EVERY)
        except KeyboardInterrupt:
            self._say_ended()
        if failure:
            raise failure[-1]

    def _say_ended(self) -> None:
        if self._live is not None:
            self._console.print("ended")
        elif not self._json:
            print("ended", flush=True)  # noqa: T201

    def _show(self, new: Sequence[_Followed]) -> None:
        """What goes on, and what has ended since the last look (`new`)."""
        if self._json:
            self._tell_json(new)
        elif self._live is not None:
            rows = [row for e in self._all for row in page(e.run.loop.status, e.label, e.ended)]
            self._live.update(Group(*rows), refresh=True)
        else:
            for each in self._all:
                text = _line(each)
                apart = _PASSING.sub("", text)
                if apart != each.told:
                    each.told = apart
                    print(f"{each.label}: {text}", flush=True)  # noqa: T201

    def _tell_json(self, new: Sequence[_Followed]) -> None:
        """A line a second for each that goes on, and a last one for what has ended."""
        now, rows = time.monotonic(), list(new)
        if now - self._last >= _TOLD:
            self._last = now
            rows += [each for each in self._all if each.ended is None]
        for each in rows:
            about = {"device": each.run.device, "port": each.run.port, "ended": each.ended}
            sys.stdout.write(json.dumps(about | as_mapping(each.run.loop.status)) + "\n")
        sys.stdout.flush()


def labels(runs: Sequence[LiveRun]) -> list[str]:
    """The runs' devices; of several with their ports, since units of one name differ by these."""
    return [f"{r.device} ({r.port})" if len(runs) > 1 else r.device for r in runs]


def _look(followed: _Followed) -> DefsenseError | None:
    """Note whether a run has ended; the error that ended it."""
    failure: DefsenseError | None = None
    try:
        followed.run.loop.wait(0)
    except RecordingEnd as end:
        followed.ended = str(end)
    except DefsenseError as error:
        failure = error
    except Exception as error:  # of what this run alone is made of: others go on
        _log.debug("%s: where it happened", followed.label, exc_info=True)
        told = f"{followed.label}: {type(error).__name__} in the live loop: {error}"
        failure = LiveError(
            f"{type(error).__name__} in the live loop: {error}",
            code="live-loop-failed",
            where=followed.label,
            action="Run it with -v and report the traceback",
        )
    if failure is not None:
        followed.ended = str(failure)
    return failure


def _line(followed: _Followed) -> str:
    if followed.ended is not None:
        return f"ended: {followed.ended}"
    status = followed.run.loop.status
    return "; ".join(
        [status.frame.quality.value if status.frame else "waiting", *map(str, status.notes)]
    )


def page(status: LiveStatus, label: str, ended: str | None = None) -> list[Text]:
    """Lines for one device of that name, or why it has `ended`."""
    frame = status.frame
    if ended is not None:
        return [Text(f"{label} ended: {ended}", "red")]
    if frame is None:
        return [Text(f"{label}: waiting for samples", "yellow"), *_notes(status)]
    line = Text(f"{label} ")
    said = frame.quality.value + (f" without {frame.lost_channel}" if frame.lost_channel else "")
    line.append(said, f"bold {_COLORS[frame.quality]}")
    line.append(f"  {status.rate:.0f} Hz", "dim")
    if status.surface_rate:
        line.append(f", {status.surface_rate:.0f} surfaces/s", "dim")
    line.append(f", {_ms(status.output_latency)} to outputs", "dim")
    if status.surface_rate:
        line.append(f", {_ms(status.view_latency)} to the view", "dim")
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
        "latency": {"outputs": [known(x) for x in status.output_latency],
                    "view": [known(x) for x in status.view_latency]},
        "notes": [str(note) for note in status.notes],
    }  # fmt: skip
    if frame is not None:
        out |= {
            "time": frame.time, "quality": frame.quality.value,
            "lost": frame.lost_channel, "controls": dict(frame.controls),
            "confidence": dict(frame.confidence), "distance": known(frame.distance),
            "ohm": [known(float(r)) for r in frame.ohms],
        }  # fmt: skip
    return out
