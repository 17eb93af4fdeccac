"""Show the status of each live device in one or two lines."""

from __future__ import annotations

import json
import logging
import math
import re
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from ...core.errors import DefsenseError, LiveError
from ...workflow.run.run import LiveRun, LiveStatus, Quality, RecordingEnd

_POLL_INTERVAL_S = 0.25
_JSON_INTERVAL_S = 1.0
_VALUES_INTERVAL_S = 1.0  # between printed lines with values of targets
_CHANGING = re.compile(r"\d+ (s\b|%)")  # durations and shares, whose change alone is not printed
_log = logging.getLogger(__name__)
_COLORS = {
    Quality.TRUSTED: "green",
    Quality.UNTRAINED: "yellow",
    Quality.FALLBACK: "yellow",
    Quality.LOST: "red",
}
_BAR_CELLS = 15  # on each side of 0


@dataclass
class _Followed:
    """A run that is displayed.

    Attributes:
        run: The run.
        label: Name of its device.
        printed: Last printed line, without changing numbers.
        printed_at: When it was printed, s.
        ended: Why the run has ended; None while it runs.
    """

    run: LiveRun
    label: str
    printed: str = ""
    printed_at: float = -math.inf
    ended: str | None = None


class LiveLines:
    """Display of live runs; use it as a context manager.

    A terminal shows lines that are updated. Otherwise, a new line is printed for each change.

    Args:
        runs: The runs to follow.
        as_json: Print one line of JSON per second and run instead.
    """

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
        """Show the runs until all have ended or Ctrl-C is pressed.

        A run that has ended is reported once, and closed while the others continue.

        Args:
            seconds: Time limit in s; None for no limit.

        Raises:
            DefsenseError: The last error that ended a run; the end of a recording is not an error.
        """
        started_at, failures = time.monotonic(), list[DefsenseError]()
        try:
            while seconds is None or time.monotonic() - started_at < seconds:
                new = [each for each in self._all if each.ended is None]
                failures += [error for each in new if (error := _check_ended(each)) is not None]
                new = [each for each in new if each.ended is not None]
                self._show(new)
                if all(each.ended is not None for each in self._all):
                    break
                for each in new:
                    each.run.end()
                time.sleep(_POLL_INTERVAL_S)
        except KeyboardInterrupt:
            self._print_ended()
        if failures:
            raise failures[-1]

    def _print_ended(self) -> None:
        if self._live is not None:
            self._console.print("ended")
        elif not self._json:
            print("ended", flush=True)  # noqa: T201

    def _show(self, new: Sequence[_Followed]) -> None:
        """Show all runs; `new` are those that have ended since the last call."""
        if self._json:
            self._print_json(new)
        elif self._live is not None:
            rows = [row for e in self._all for row in page(e.run.loop.status, e.label, e.ended)]
            self._live.update(Group(*rows), refresh=True)
        else:
            for each in self._all:
                state, values = _state(each), _values(each)
                without_numbers = _CHANGING.sub("", "; ".join(state))
                has_waited = time.monotonic() - each.printed_at >= _VALUES_INTERVAL_S
                if without_numbers != each.printed or (values and has_waited):
                    each.printed, each.printed_at = without_numbers, time.monotonic()
                    text = "; ".join([*state[:1], *values, *state[1:]])
                    print(f"{each.label}: {text}", flush=True)  # noqa: T201

    def _print_json(self, new: Sequence[_Followed]) -> None:
        """Print one line per second for each run, and a last line when it has ended."""
        now, rows = time.monotonic(), list(new)
        if now - self._last >= _JSON_INTERVAL_S:
            self._last = now
            rows += [each for each in self._all if each.ended is None]
        for each in rows:
            about = {"device": each.run.device, "port": each.run.port, "ended": each.ended}
            sys.stdout.write(json.dumps(about | as_mapping(each.run.loop.status)) + "\n")
        sys.stdout.flush()


def labels(runs: Sequence[LiveRun]) -> list[str]:
    """Return the names of the devices; several have their ports, which distinguish equal names."""
    return [f"{r.device} ({r.port})" if len(runs) > 1 else r.device for r in runs]


def _check_ended(followed: _Followed) -> DefsenseError | None:
    """Note whether a run has ended, and return the error that ended it."""
    failure: DefsenseError | None = None
    try:
        followed.run.loop.wait(0)
    except RecordingEnd as end:
        followed.ended = str(end)
    except DefsenseError as error:
        failure = error
    except Exception as error:  # concerns this run only: the others continue
        _log.debug("%s: traceback of the error", followed.label, exc_info=True)
        failure = LiveError(
            f"{type(error).__name__} in the live loop: {error}",
            code="live-loop-failed",
            where=followed.label,
            action="Run it with -v and report the traceback",
        )
    if failure is not None:
        followed.ended = str(failure)
    return failure


def _state(followed: _Followed) -> list[str]:
    """Return the quality of a run's frames and its notes, or why it has ended."""
    if followed.ended is not None:
        return [f"ended: {followed.ended}"]
    status = followed.run.loop.status
    quality = status.frame.quality.value if status.frame else "waiting"
    return [quality, *map(str, status.notes)]


def _values(followed: _Followed) -> list[str]:
    """Return the controls or targets of a run; none once it has ended."""
    status = followed.run.loop.status
    if followed.ended is not None or status.frame is None:
        return []
    controls, targets = status.frame.controls, status.targets
    return [
        *(f"{name} {value:.2f}" for name, value in controls.items()),
        *map(_describe_target, targets, targets.values()),
    ]


def page(status: LiveStatus, label: str, ended: str | None = None) -> list[Text]:
    """Return the lines of one device.

    Args:
        status: Status of its live loop.
        label: Its name.
        ended: Why it has ended; None while it runs.
    """
    frame = status.frame
    if ended is not None:
        return [Text(f"{label} ended: {ended}", "red")]
    if frame is None:
        return [Text(f"{label}: waiting for samples", "yellow"), *_notes(status)]
    line = Text(f"{label} ")
    quality = frame.quality.value + (f" without {frame.lost_channel}" if frame.lost_channel else "")
    line.append(quality, f"bold {_COLORS[frame.quality]}")
    line.append(f"  {status.rate:.0f} Hz", "dim")
    if status.surface_rate:
        line.append(f", {status.surface_rate:.0f} surfaces/s", "dim")
    line.append(f", {_ms(status.output_latency)} to outputs", "dim")
    if status.surface_rate:
        line.append(f", {_ms(status.view_latency)} to the view", "dim")
    rows = [line]
    if status.network is not None:
        rows.append(Text(status.network.summary, "dim"))
    width = max(map(len, frame.controls), default=0)
    rows += [_bar(name.rjust(width), value) for name, value in frame.controls.items()]
    if values := status.targets:
        rows.append(Text("   ".join(map(_describe_target, values, values.values())), "cyan"))
    return rows + _notes(status)


def _bar(name: str, value: float) -> Text:
    """Return a bar from -1 to 1 with its middle at 0; values outside fill it."""
    filled = round(_BAR_CELLS * min(abs(value), 1.0)) if math.isfinite(value) else 0
    empty = " " * (_BAR_CELLS - filled)
    bar = Text(f"{name} ")
    bar.append(empty if value < 0 else " " * _BAR_CELLS)
    bar.append("━" * filled if value < 0 else "", "cyan")
    bar.append("│", "dim")
    bar.append("" if value < 0 else "━" * filled, "cyan")
    bar.append(" " * _BAR_CELLS if value < 0 else empty)
    bar.append(f" {value:5.2f}")
    return bar


def _describe_target(name: str, values: Mapping[str, object]) -> str:
    """Return a target with its interval and unit, such as `angle 12.3 ± 1.2 deg`."""
    value, width = values["value"], values["half_width"]
    numbers = value if isinstance(value, list) else [value]
    text = ", ".join("?" if x is None else f"{x:.4g}" for x in numbers)
    interval = f" ± {width:.3g}" if isinstance(width, float) else ""
    return f"{name} {text}{interval} {values['unit']}".rstrip()


def _notes(status: LiveStatus) -> list[Text]:
    return [Text(f"! {note}", "yellow") for note in status.notes]


def _ms(seconds: tuple[float, float]) -> str:
    return f"{1e3 * seconds[0]:.1f} ms (99 %: {1e3 * seconds[1]:.1f})"


def as_mapping(status: LiveStatus) -> dict[str, object]:
    """Return a status as plain values for JSON; unknown numbers are None."""
    frame = status.frame

    def finite_or_none(x: float) -> float | None:
        return x if math.isfinite(x) else None

    out: dict[str, object] = {
        "rate": status.rate,
        "samples": status.samples,
        "skipped": status.skipped,
        "lost_samples": status.lost,
        "latency": {
            "outputs": [finite_or_none(x) for x in status.output_latency],
            "view": [finite_or_none(x) for x in status.view_latency],
        },
        "notes": [str(note) for note in status.notes],
    }
    if status.network is not None:
        out["network"] = status.network.data()
    if frame is not None:
        out |= {
            "time": frame.time,
            "quality": frame.quality.value,
            "lost": frame.lost_channel,
            "controls": dict(frame.controls),
            "confidence": dict(frame.confidence),
            "distance": finite_or_none(frame.distance),
            "ohm" if frame.targets is None else "readings": [
                finite_or_none(float(r)) for r in frame.ohms
            ],
        }
        if frame.targets is not None:
            out["targets"] = status.targets
    return out
