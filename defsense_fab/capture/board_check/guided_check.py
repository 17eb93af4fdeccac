"""Guide the user through the steps of a check: hands off, each wire moved in turn, poses held."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.guided_parts import Bars
from ...core.guided_run import Ending, GuidedView, GuidedWork, Key, RunState
from ...core.guided_run import Phase as RunPhase
from ...core.progress import Notice
from ..readout.source import Source, StampedSample
from .channel_texts import format_ohm
from .diagnosis import diagnose
from .records import BoardSetup, ExpectedCord, Finding, Phase, PhaseKind

#: Durations of the readings of a step, s. At rest: frequencies 0.2 Hz apart are resolved. Wires:
#: some ten movements of a hand. Poses: until a median is steady.
STEP_S: Mapping[PhaseKind, float] = {"rest": 5.0, "wiggle": 3.0, "pose": 2.0}
#: Time until readings count, s: a hand has let go, or holds the pose.
LEAD_S = 1.5
_LOST_TIMEOUT_S = 10.0  # without a sample, after which the check ends
_BAR_RANGE = 2.0  # full length of a bar, relative to the expected resistance
#: Moves the hand of a simulated device: kind and subject of a step.
Hand = Callable[[str, str], None]
CHECK_KEYS: Mapping[RunPhase, tuple[Key, ...]] = {
    "ready": (
        Key("enter", "start", "start"),
        Key("s", "skip", "skip"),
        Key("q", "stop", "stop"),
    ),
    "active": (
        Key("r", "repeat", "repeat"),
        Key("s", "skip", "skip"),
        Key("q", "stop", "stop"),
    ),
    "waiting": (Key("q", "stop", "stop"),),
}


@dataclass(frozen=True)
class CheckStep:
    """A step of the check.

    Attributes:
        kind: What the user does.
        subject: Name of the cord whose wire is moved, or of the pose; empty for rest.
    """

    kind: PhaseKind
    subject: str = ""

    @property
    def instruction(self) -> str:
        """What the user has to do."""
        if self.kind == "rest":
            return "Lay the device down. **Hands off** the device and its wires."
        if self.kind == "wiggle":
            return f"Hold the device still. **Wiggle the wire of {self.subject}**, at both ends."
        return f"Hold the pose **{self.subject}**, and keep still."


def check_steps(names: Sequence[str], poses: Sequence[str], *, wiggle: bool) -> list[CheckStep]:
    """Return the steps of a check.

    Args:
        names: Names of the cords.
        poses: Poses to hold.
        wiggle: Whether wires are moved.
    """
    wires = [CheckStep("wiggle", name) for name in names] if wiggle else []
    return [CheckStep("rest"), *wires, *(CheckStep("pose", name) for name in poses)]


@dataclass
class _Received:
    """Samples of the current step: times in s, and counts."""

    time: list[float] = field(default_factory=list)
    counts: list[Float] = field(default_factory=list)
    is_broken: bool = False


class CheckWork(GuidedWork):
    """Work of the steps of a check.

    Args:
        steps: The steps; the first one is at rest.
        source: Source of samples, which is started.
        cords: What the build expects, in the order of the channels.
        board: How the board measures.
        hand: Moves a simulated device; None for a user.
        notes: What the user should know from the start on.

    Attributes:
        phases: Readings by the number of the step.
        findings: Findings, once the readings at rest exist and the run has ended.
    """

    keys = CHECK_KEYS

    def __init__(
        self,
        steps: Sequence[CheckStep],
        source: Source,
        cords: Sequence[ExpectedCord],
        board: BoardSetup,
        hand: Hand | None = None,
        notes: Sequence[Notice] = (),
    ) -> None:
        self._steps, self._source, self._hand = list(steps), source, hand
        self._cords, self._board, self._notes = list(cords), board, list(notes)
        self.step_count = len(steps)
        self.phases: dict[int, Phase] = {}
        self.findings: tuple[Finding, ...] = ()
        self._received = _Received()
        self._last_ohm = np.full(len(cords), np.nan)
        self._late, self._step = False, 0
        self._received_at = time.monotonic()

    def start(self, step: int) -> None:
        """Start a step: earlier samples do not belong to it."""
        plan = self._steps[step]
        if self._hand is not None:
            self._hand(plan.kind, plan.subject)
        self.receive()
        self._received = _Received()

    def receive(self) -> None:
        """Process the samples that arrived.

        Raises:
            CaptureError: The board has sent nothing for ten seconds (`board-gone`).
        """
        for item in self._source.drain():
            if isinstance(item, StampedSample):
                self._received_at = time.monotonic()
                if len(item.sample.sums) != len(self._cords):
                    continue
                counts = item.sample.counts
                self._late |= item.sample.late
                self._last_ohm = self._board.dividers.resistance(counts)
                self._received.time.append(item.device_us / 1e6)
                self._received.counts.append(counts)
            elif item.kind == "gap":
                self.is_interrupted, self._received.is_broken = True, True
            elif item.kind in ("resumed", "start"):
                self.is_interrupted = False
            elif item.kind in ("restart", "dropped"):
                self._received.is_broken = True
        if time.monotonic() - self._received_at > _LOST_TIMEOUT_S:
            raise CaptureError(
                f"no sample arrived for {_LOST_TIMEOUT_S:g} s",
                code="board-gone",
                where=self._source.name,
                action="Connect the read-out board, and repeat the check",
            )

    def check(self, *, is_requested: bool) -> Ending | None:  # noqa: ARG002 - steps end by time
        """Return `done` when the readings of the step are complete."""
        received = self._received
        if received.is_broken:  # readings before a gap do not belong to those after it
            self._received = _Received()
            return None
        return "done" if self._elapsed >= self._duration else None

    @property
    def _elapsed(self) -> float:
        times = self._received.time
        return times[-1] - times[0] if times else 0.0

    @property
    def _duration(self) -> float:
        return LEAD_S + STEP_S[self._steps[self._step].kind]

    def leave(self, step: int, ending: object) -> None:
        """Store the readings of a step that is done."""
        if ending == "done":
            times, counts = np.array(self._received.time), np.array(self._received.counts)
            is_valid = times >= times[0] + LEAD_S
            plan = self._steps[step]
            self.phases[step] = Phase(plan.kind, plan.subject, times[is_valid], counts[is_valid])
        if self._hand is not None:
            self._hand("rest", "")

    def diagnose(self) -> tuple[Finding, ...]:
        """Return the findings of the readings so far; none without those at rest."""
        if 0 in self.phases and not self.findings:
            phases = [self.phases[k] for k in sorted(self.phases)]
            self.findings = tuple(diagnose(self._cords, self._board, phases))
        return self.findings

    def view(self, state: RunState) -> GuidedView:
        """Describe the step, with a bar for each channel."""
        self._step = state.step
        plan, notes = self._steps[state.step], list(self._notes)
        title = f"Step {state.step + 1} of {self.step_count}"
        begin = "Start the step when ready."
        if self._hand is not None:
            begin = "Start the step: the simulated device and its wires move automatically."
        instruction, status, progress = plan.instruction, begin, None
        findings = self.diagnose() if state.phase == "done" else ()
        if state.phase == "done":
            faults = [f for f in findings if f.code != "ok"]
            title = "Check of the wiring"
            instruction = (
                f"**{len(faults)} of {len(findings)} channels need attention.**"
                if faults
                else "**All channels are in order.**"
            )
            status = ""
            notes += [Notice(f.code, str(f), f.cord) for f in faults]
        elif state.phase == "waiting":
            instruction = "**The read-out board is disconnected.** Connect it again."
        elif state.phase == "active":
            left = max(self._duration - self._elapsed, 0.0)
            status, progress = f"{left:.0f} s", min(self._elapsed / self._duration, 1.0)
        if self._late:
            text = "the read-out board is slower than its firmware should be: samples are late"
            notes.append(Notice("board-late", text))
        return GuidedView(
            state,
            title,
            instruction,
            status=(status,) if status else (),
            progress=progress,
            parts=(self._bars(findings),),
            notes=tuple(notes),
        )

    def _bars(self, findings: Sequence[Finding]) -> Bars:
        """Return the live resistances as bars, with their expected ranges."""
        values, texts, states, bands = [], [], [], []
        for c, (cord, ohm) in enumerate(zip(self._cords, self._last_ohm, strict=True)):
            full = _BAR_RANGE * cord.ohm
            bands.append([cord.low / full, cord.high / full])
            values.append([min(ohm / full, 1.0) if math.isfinite(ohm) else float(ohm == np.inf)])
            shown = "-" if math.isnan(ohm) else "short" if ohm == 0 else "open"
            texts.append(format_ohm(ohm) if math.isfinite(ohm) and ohm > 0 else shown)
            if findings:
                states.append("ok" if findings[c].code == "ok" else "fault")
                if findings[c].code != "ok":
                    texts[-1] += f"  {findings[c].code}"
            else:
                states.append("" if cord.low <= ohm <= cord.high else "fault")
        names = tuple(f"{c.name} (A{k})" for k, c in enumerate(self._cords))
        return Bars(
            np.array(values),
            names,
            tuple(texts),
            "Resistances, with their expected ranges",
            bands=np.array(bands),
            states=tuple(states),
        )
