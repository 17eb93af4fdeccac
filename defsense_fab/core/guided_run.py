"""Guided runs: a user goes through steps, which a screen shows and keys control.

A `GuidedRun` decides which step is next and what a key does. Its `GuidedWork` reads the sources,
decides when a step is complete and describes the state. A `Screen` shows the state and reads keys;
it knows the parts of a view, but not what the steps are about.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from .guided_parts import Part
from .progress import Notice

#: `ready`: the next step waits for the user. `active`: the step's work is done. `waiting`: the work
#: is interrupted until a device is connected again. `done`: the run has ended.
Phase = Literal["ready", "active", "waiting", "done"]
#: What a key does: start a step, complete it before its end, leave it out, start it again, go back,
#: or stop the run.
Action = Literal["start", "complete", "skip", "repeat", "back", "stop"]
#: How a step ends without a key: it is done, or it ends the run.
Ending = Literal["done", "finish"]

KEY_INTERVAL_S = 0.1  # for which a run waits for a key before it looks at the sources again


@dataclass(frozen=True)
class Key:
    """Key of a phase.

    Attributes:
        name: `enter`, or a character in lower case.
        label: What it does, for the user; empty for a second name of another key.
        action: What it does.
        hint: When it is used; empty if the label says it.
    """

    name: str
    label: str
    action: Action
    hint: str = ""


#: Stops a run that can be resumed.
STOP = Key("q", "stop", "stop", "resume later")


@dataclass(frozen=True)
class RunState:
    """State of a guided run.

    Attributes:
        phase: Phase of the run.
        step: Number of the step, from 0; the last one at the end.
        done: Numbers of the finished steps.
        keys: Keys of the phase.
    """

    phase: Phase
    step: int
    done: frozenset[int]
    keys: tuple[Key, ...]


@dataclass(frozen=True)
class GuidedView:
    """What a screen shows of a guided run.

    Attributes:
        state: State of the run.
        title: Name of the step and its number.
        instruction: What the user has to do; the words between `**` are emphasized.
        status: Lines with what was received.
        progress: Share of the step or of the run that is over, 0 to 1; None for none.
        parts: Pictures, bars, plots and tables.
        notes: What the user should attend to.
        alert: Whether the user is alerted, once: something has just been completed.
    """

    state: RunState
    title: str
    instruction: str
    status: tuple[str, ...] = ()
    progress: float | None = None
    parts: tuple[Part, ...] = ()
    notes: tuple[Notice, ...] = ()
    alert: bool = False


class Screen(Protocol):
    """Shows a guided run and reads keys."""

    def show(self, view: GuidedView) -> None:
        """Show the state of the run."""

    def key(self, timeout: float) -> str | None:
        """Return the name of the key that is pressed within a time in s, or None."""


class GuidedWork(ABC):
    """Work of the steps of a guided run.

    Attributes:
        keys: Keys by phase.
        step_count: Number of steps, which may change during the run.
        is_interrupted: Whether the work waits for a device that is disconnected.
    """

    keys: Mapping[Phase, tuple[Key, ...]]
    step_count: int
    is_interrupted = False

    def start(self, step: int) -> None:  # noqa: B027
        """Start a step, or start it again."""

    @abstractmethod
    def receive(self) -> None:
        """Process what the sources have delivered; called in every phase before `view`."""

    @abstractmethod
    def check(self, *, is_requested: bool) -> Ending | None:
        """Return how the active step ends; None while it continues.

        Args:
            is_requested: Whether the user has pressed a key to complete the step now.
        """

    def leave(self, step: int, ending: Ending | Action) -> None:  # noqa: B027
        """Process the end of an active step.

        Args:
            step: Number of the step.
            ending: Its ending, or the key's action that ended it.
        """

    def skip(self, step: int) -> None:  # noqa: B027
        """Process that a step is skipped in this run."""

    def reopen(self, step: int) -> None:  # noqa: B027
        """Discard a finished step, which is done again."""

    @abstractmethod
    def view(self, state: RunState) -> GuidedView:
        """Describe the state for a screen."""


class GuidedRun:
    """One run through the steps; those that were done before are left out.

    Args:
        work: Work of the steps.
        screen: Screen for the user.
        done: Numbers of the steps that were done in earlier runs.
        auto: Whether each step starts without a key.
        key_interval_s: Time to wait for a key before the sources are read again, s.

    Attributes:
        done: Numbers of the finished steps.
        skipped: Numbers of the steps that the user skipped, which the next run does.
        is_stopped: Whether the user stopped the run.
    """

    def __init__(
        self,
        work: GuidedWork,
        screen: Screen,
        done: Collection[int] = (),
        *,
        auto: bool = False,
        key_interval_s: float = KEY_INTERVAL_S,
    ) -> None:
        self._work, self._screen, self._key_interval_s = work, screen, key_interval_s
        self._first_phase: Phase = "active" if auto else "ready"
        self.done, self.skipped = set(done), set[int]()
        self.is_stopped = False

    def run(self) -> bool:
        """Go through the steps until all are done or the user stops.

        Returns:
            Whether the run came to its end without a skipped step.
        """
        step, phase = self._next_step(0), self._first_phase
        while step is not None:
            ending = self._run_phase(step, phase)
            if phase == "active":
                self._work.leave(step, ending)
            if ending == "skip":
                self._work.skip(step)
            if ending == "stop":
                self.is_stopped = True
                return False
            if ending == "finish":
                break
            if ending == "start":
                phase = "active"
                continue
            if ending == "back" and phase == "ready":
                step = self._reopen_step_before(step)
            elif ending in ("done", "skip"):
                (self.done if ending == "done" else self.skipped).add(step)
                step = self._next_step(step)
            phase = phase if ending == "repeat" else self._first_phase
        self._show("done", max(self._work.step_count - 1, 0))
        return not self.skipped

    def _next_step(self, start: int) -> int | None:
        """Return the first open step, searching from `start` and then from the beginning."""
        order = [*range(start, self._work.step_count), *range(start)]
        return next((n for n in order if n not in self.done | self.skipped), None)

    def _reopen_step_before(self, step: int) -> int:
        """Return the last step before `step` that was done or skipped, to be done again."""
        previous = max((n for n in self.done | self.skipped if n < step), default=None)
        if previous is None:
            return step
        if previous in self.done:
            self._work.reopen(previous)
        self.done.discard(previous)
        self.skipped.discard(previous)
        return previous

    def _run_phase(self, step: int, phase: Phase) -> Ending | Action:
        """Wait for a key, or do the work of a step; return how the phase ended."""
        if phase == "active":
            self._work.start(step)
        while True:
            self._work.receive()
            visible_phase: Phase = "waiting" if self._work.is_interrupted else phase
            self._show(visible_phase, step)
            action = self._pressed_action(visible_phase)
            if visible_phase == "active":
                ending = self._work.check(is_requested=action == "complete")
                if ending is not None:
                    return ending
            if action is not None and action != "complete":
                return action

    def _pressed_action(self, phase: Phase) -> Action | None:
        name = self._screen.key(self._key_interval_s)
        keys = self._work.keys.get(phase, ())
        return next((k.action for k in keys if k.name == name), None)

    def _show(self, phase: Phase, step: int) -> None:
        keys = self._work.keys.get(phase, ())
        self._screen.show(self._work.view(RunState(phase, step, frozenset(self.done), keys)))
