"""Measure which faults of the wiring `defsense board check` finds and names on twins of devices.

    python -m benchmarks.board_check my-joystick my-bar my-cube
    python -m benchmarks.board_check my-bar --size 0.3 --converter ads1115 --no-poses

Each device must be built until the parts. Every case is another unit, with other cords, noise and
hand. A fault is found if its channel has a finding, and named if the code is the right one and, for
exchanged or connected wires, both channels are. False alarms are findings on other channels, and
all findings on sound units.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from defsense_fab.capture.board_check.assignment import choose_poses
from defsense_fab.capture.board_check.diagnosis import diagnose, rest_deviation
from defsense_fab.capture.board_check.mains import choose_sampling
from defsense_fab.capture.board_check.records import BoardSetup, ExpectedCord, Finding, Phase
from defsense_fab.core.device.boards import CONVERTERS
from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.store.build import Build
from defsense_fab.twin.live.wiring_twin import WiringTwin, WiringTwinOptions
from defsense_fab.workflow.board.expected_cords import expected_cords

#: Faults and the codes that name them: the range of their sizes as exponents of ten, or None.
KINDS: tuple[tuple[str, str, tuple[float, float] | None], ...] = (
    ("cut", "open", None),
    ("swap", "swapped", None),
    ("short", "short", None),
    ("noise", "noisy", (1.6, 2.2)),  # 40 to 160 mV
    ("hum50", "hum", (0.9, 2.0)),  # 8 to 100 mV
    ("loose", "loose", (1.6, 3.0)),  # 40 to 1000 ohm
    ("reference", "reference-wrong", (1.0, 1.0)),
    ("series", "rest-off", (2.8, 3.3)),  # 630 to 2000 ohm
    ("bridge", "short", (-1.0, 0.0)),
    ("hum60", "hum", (0.9, 2.0)),
    ("reference", "reference-wrong", (-1.0, -1.0)),
    ("unread", "not-read", None),
    ("loose", "loose", (5.0, 7.0)),  # open while it moves
    ("reference", "saturated", (2.0, 2.1)),
    ("reference", "saturated", (-2.1, -2.0)),
    ("supply", "saturated", (0.15, 0.2)),  # 5 V instead of 3.3 V
)
_SIZED = ("noisy", "hum", "loose", "rest-off")
REST_S, WIGGLE_S, POSE_S, LEAD_S = 5.0, 3.0, 2.0, 1.5


@dataclass(frozen=True)
class Case:
    """A unit with a fault, or a sound one.

    Attributes:
        options: The unit.
        code: The right code; empty for a sound unit.
        channels: Names of the channels that must have it.
    """

    options: WiringTwinOptions
    code: str = ""
    channels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Result:
    """Result of a case.

    Attributes:
        case: The case.
        findings: The findings.
    """

    case: Case
    findings: tuple[Finding, ...]

    @property
    def codes(self) -> set[str]:
        """Codes on the channels with the fault."""
        return {f.code for f in self.findings if f.cord in self.case.channels}

    @property
    def is_found(self) -> bool:
        """Whether a channel with the fault has a finding."""
        return bool(self.codes - {"ok"})

    @property
    def is_named(self) -> bool:
        """Whether all channels with the fault have the right code."""
        return self.codes == {self.case.code}

    @property
    def false_alarms(self) -> list[Finding]:
        """Findings on sound channels."""
        return [f for f in self.findings if f.code != "ok" and f.cord not in self.case.channels]


def fault_cases(
    names: Sequence[str], count: int, seed: int = 1, size: float = 1.0
) -> Iterator[Case]:
    """Yield cases with one fault each, of all kinds in turn.

    Args:
        names: Names of the channels.
        count: Number of cases.
        seed: Seed of channels and sizes; units are numbered from 100 times the seed on.
        size: Factor of the sizes of noise, hum, loose contacts and additional resistances.
    """
    rng = np.random.default_rng(seed)
    for k in range(count):
        kind, code, exponents = KINDS[k % len(KINDS)]
        number = 2 if kind in ("swap", "bridge") else 1
        chosen = tuple(str(n) for n in rng.permutation(names)[:number])
        affected = tuple(names) if kind == "supply" else chosen
        amount = 1.0 if exponents is None else 10 ** rng.uniform(*exponents)
        amount *= size if code in _SIZED else 1.0
        word = f"{kind}={'+'.join(chosen)}" + ("" if exponents is None else f"*{amount:.4g}")
        yield Case(WiringTwinOptions(100 * seed + k, seed, 1.0, (word,)), code, affected)


def healthy_cases(count: int, seed: int = 1) -> Iterator[Case]:
    """Yield sound units, other ones than those of `fault_cases`."""
    for k in range(count):
        yield Case(WiringTwinOptions(5000 + 100 * seed + k, seed + k))


class Bench:
    """Checks of units of one device.

    Args:
        device: A device that is built until the parts.
        has_wiggle: Whether wires are moved.
        has_poses: Whether poses are held.
    """

    def __init__(self, device: Device, *, has_wiggle: bool = True, has_poses: bool = True) -> None:
        self.device, self.build = device, Build(device.source / "build")
        self.cords: list[ExpectedCord] = expected_cords(device, self.build)
        poses = choose_poses(self.cords, rest_deviation(self.cords)) if has_poses else ()
        wires = [("wiggle", c.name, WIGGLE_S) for c in self.cords] if has_wiggle else []
        self.steps = [("rest", "", REST_S), *wires, *(("pose", p, POSE_S) for p in poses)]

    def run(self, case: Case) -> Result:
        """Check one unit."""
        twin = WiringTwin(self.device, case.options, self.build)
        sampling = choose_sampling(twin.converter, len(self.cords), twin.averages)
        board = BoardSetup(twin.converter, twin.full_scale, sampling.averages, twin.reference)
        phases = [
            Phase(kind, name, *twin.record(kind, name, s, sampling.rate, sampling.averages, LEAD_S))  # type: ignore[arg-type]
            for kind, name, s in self.steps
        ]
        return Result(case, tuple(diagnose(self.cords, board, phases)))


def table(results: Sequence[Result]) -> list[str]:
    """Return the confusion table: a row for each code, with the codes that were reported."""
    lines = [f"{'fault':<16} {'cases':>5} {'found':>5} {'named':>5}  reported as"]
    faulty = [r for r in results if r.case.code]
    for code in dict.fromkeys(r.case.code for r in faulty):
        own = [r for r in faulty if r.case.code == code]
        reported = Counter("+".join(sorted(r.codes)) for r in own)
        lines.append(
            f"{code:<16} {len(own):>5} {sum(r.is_found for r in own):>5}"
            f" {sum(r.is_named for r in own):>5}  "
            + ", ".join(f"{name} {n}" for name, n in reported.most_common())
        )
    sound = [r for r in results if not r.case.code]
    alarms = Counter(f.code for r in results for f in r.false_alarms)
    channels = sum(len(r.findings) - len(r.case.channels) for r in results)
    lines += [
        f"{'all':<16} {len(faulty):>5} {sum(r.is_found for r in faulty):>5}"
        f" {sum(r.is_named for r in faulty):>5}",
        f"sound units: {len(sound)}, {sum(bool(r.false_alarms) for r in sound)} with a false alarm;"
        f" sound channels of all units: {channels}, {sum(alarms.values())} with a false alarm"
        f" {dict(alarms) or ''}",
    ]
    return lines


def main() -> None:
    """Print the tables of the devices."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("devices", nargs="+", type=Path)
    parser.add_argument("--faults", type=int, default=32)
    parser.add_argument("--healthy", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", type=float, default=1.0, help="factor of the faults' sizes")
    parser.add_argument("--converter", choices=list(CONVERTERS))
    parser.add_argument("--no-wiggle", action="store_true")
    parser.add_argument("--no-poses", action="store_true")
    parser.add_argument("--list", action="store_true", help="print each case that was not named")
    arguments = parser.parse_args()
    total: list[Result] = []
    for folder in arguments.devices:
        device = load_device(folder)
        bench = Bench(
            replace(device, converter=arguments.converter or device.converter),
            has_wiggle=not arguments.no_wiggle,
            has_poses=not arguments.no_poses,
        )
        names = [c.name for c in bench.cords]
        started_at = time.perf_counter()
        seed = 10 * arguments.seed + arguments.devices.index(folder)  # no unit is used twice
        cases = [*fault_cases(names, arguments.faults, seed, arguments.size)]
        cases += healthy_cases(arguments.healthy, seed)
        results = [bench.run(case) for case in cases]
        total += results
        seconds = time.perf_counter() - started_at
        steps = ", ".join(f"{kind} {name}".strip() for kind, name, _ in bench.steps)
        print(f"\n{folder.name}: {len(names)} cords, {seconds / len(cases):.2f} s a case; {steps}")
        print("\n".join(table(results)))
        for r in results:
            if arguments.list and (r.false_alarms or (r.case.code and not r.is_named)):
                print(f"  {r.case.options.unit} {r.case.options.faults}")
                print("\n".join(f"    {f.code}: {f}" for f in r.findings))
    if len(arguments.devices) > 1:
        print("\nall devices")
        print("\n".join(table(total)))


if __name__ == "__main__":
    main()
