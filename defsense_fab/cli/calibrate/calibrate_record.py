"""The commands `defsense calibrate ports | record | reference | twin`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import CaptureError, DefsenseError, DeviceError
from ..exit_codes import DONE, STOPPED
from ..options import (
    REFERENCE_OHM,
    add_output_options,
    check_range,
    parse_numbers,
    parse_references,
)
from ..output import print_json

if TYPE_CHECKING:
    from ...calibration.session import CalibrationSession
    from ...capture.readout.ports import Port
    from ...capture.readout.source import Source
    from ...core.arrays import Float
    from ...sensing.serial_frames import Info
    from ..options import Commands

_PORT = "/dev/ttyUSB0, COM3, socket://host:port, or twin (twin:speed=20,k=2,seed=1)"


def add(steps: Commands) -> None:
    """Add the commands to those of `calibrate`."""
    sub = steps.add_parser(
        "ports",
        help="List serial ports and show what a read-out board reads",
        description="List the serial ports, with the resistances that the read-out boards on them "
        "read, as bars. Read-out boards restart when their port is opened; --list "
        "opens none. With --port, show the resistances of one board until Ctrl-C.",
        examples=["defsense calibrate ports", "defsense calibrate ports --port twin"],
    )
    sub.add_argument(
        "--port",
        metavar="PORT",
        help=f"Show the board on this port: {_PORT}, or a recording (.csv)",
    )
    sub.add_argument("--list", action="store_true", help="List the ports without opening them")
    sub.add_argument(
        "--seconds", type=float, metavar="S", help="Stop after this time in s (default: at Ctrl-C)"
    )
    _board(sub)
    _ends(sub)
    sub.set_defaults(run=_ports)
    sub = steps.add_parser(
        "record",
        help="Measure a specimen on its jigs, step by step",
        description="Measure a specimen on its jigs. The screen shows which jig is next and which "
        "side lies on it, waits until the reading has settled, and plots the points so"
        " far. Every frame is written immediately. Press q to stop; rerun the command "
        "to resume.",
        examples=[
            "defsense calibrate record --port /dev/ttyUSB0 --specimen my-specimen",
            "defsense calibrate record --port twin:speed=20 --specimen my-specimen --rounds 2",
        ],
    )
    sub.add_argument(
        "--port", required=True, metavar="PORT", help=f"Set the port of the read-out board: {_PORT}"
    )
    sub.add_argument(
        "--specimen",
        type=Path,
        required=True,
        metavar="DIR",
        help="Set the folder that 'calibrate specimen' wrote, or its specimen.json",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="SESSION",
        help="Set the session folder (default: session, next to specimen.json)",
    )
    sub.add_argument(
        "--name",
        help="Set the name of the specimen; pieces of the same name are the same piece "
        "(default: its length)",
    )
    sub.add_argument(
        "--rounds",
        type=int,
        metavar="N",
        help="Set the number of rounds over all jigs (default: 3)",
    )
    sub.add_argument(
        "--radii", metavar="R,R,...", help="Set the radii in mm of the jigs to use (default: all)"
    )
    sub.add_argument(
        "--faces",
        choices=("ab", "a", "b"),
        default="ab",
        help="Choose the sides to place on the jigs: both (ab, default), or one",
    )
    sub.add_argument(
        "--tolerance",
        type=float,
        metavar="PERCENT",
        help="Set the remaining change of a settled reading in percent (default: 0.05)",
    )
    sub.add_argument(
        "--longest",
        type=float,
        metavar="S",
        help="Set the time after which a reading is taken even if it has not settled, in s "
        "(default: 90)",
    )
    sub.add_argument(
        "--seed", type=int, help="Set the random seed of the order of the jigs (default: 1)"
    )
    sub.add_argument(
        "--auto",
        action="store_true",
        help="Read no keys: for twins, and for machines that bend the specimen",
    )
    _board(sub)
    _ends(sub)
    sub.set_defaults(run=_record)
    sub = steps.add_parser(
        "reference",
        help="Measure the reference resistors with a known resistor",
        description="Measure the reference resistors. Replace every cord by one known resistor (1 "
        "percent or better, near the cords' resistance), and pass the printed numbers "
        "as --reference. The response does not depend on them; resistances in ohm do.",
        examples=["defsense calibrate reference --port /dev/ttyUSB0 --known 2200"],
    )
    sub.add_argument(
        "--port", required=True, metavar="PORT", help=f"Set the port of the read-out board: {_PORT}"
    )
    sub.add_argument(
        "--known", type=float, required=True, metavar="OHM", help="Set the known resistance in ohm"
    )
    sub.add_argument(
        "--channels",
        type=int,
        default=3,
        metavar="N",
        help="Set the number of channels (default: 3)",
    )
    sub.add_argument(
        "--seconds",
        type=float,
        default=2.0,
        metavar="S",
        help="Set the time to average over in s (default: 2)",
    )
    _ends(sub)
    sub.set_defaults(run=_reference)
    sub = steps.add_parser(
        "twin",
        help="Create sessions of a simulated specimen, to try the fit",
        description="Write calibration sessions of simulated specimens, with noise, hysteresis, "
        "relaxation and differences between pieces, without the waiting time of a "
        "measurement.",
        examples=["defsense calibrate twin my-twin --k 2 --lengths 150,200 --seed 1"],
    )
    sub.add_argument(
        "folder", type=Path, metavar="OUT", help="Output folder; it gets one session per specimen"
    )
    for name, default, text in (
        ("k", 2.0, "slope of the response at rest, k_res"),
        ("q", 0.0, "its quadratic coefficient"),
        ("noise", 0.002, "standard deviation of one reading of (R - R0)/R0"),
        ("play", 0.003, "half the width of the hysteresis, of R0"),
        ("healing", 0.1, "part of a change that relaxes"),
        ("time", 8.0, "time constant of that, s"),
        ("spread", 0.02, "standard deviation of the pieces' gains"),
        ("drift", 0.0, "of all resistances, per hour"),
        ("misplaced", 0.0, "standard deviation of the cords' heights, mm"),
    ):
        sub.add_argument(
            f"--{name}", type=float, default=default, help=f"Set the {text} (default: {default:g})"
        )
    sub.add_argument(
        "--lengths",
        default="150,200",
        metavar="MM,MM,...",
        help="Set the lengths in mm, one per specimen (default: 150,200)",
    )
    sub.add_argument(
        "--rounds",
        type=int,
        default=3,
        metavar="N",
        help="Set the number of rounds over all jigs (default: 3)",
    )
    sub.add_argument("--seed", type=int, default=1, help="Set the random seed (default: 1)")
    _ends(sub)
    sub.set_defaults(run=_twin)


def _board(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--reference",
        metavar="OHM,...",
        help="Set the reference resistors of the channels in ohm, or one for all (default: "
        f"{REFERENCE_OHM:g})",
    )
    sub.add_argument(
        "--rate", type=int, metavar="HZ", help="Set the sampling rate in Hz (default: 20)"
    )
    sub.add_argument(
        "--average",
        type=int,
        metavar="N",
        help="Set the number of conversions per sample (default: the board's)",
    )


def _ends(sub: argparse.ArgumentParser) -> None:
    add_output_options(sub)


def _ports(options: argparse.Namespace) -> int:
    from ...capture.readout.ports import serial_ports
    from ...capture.readout.reader import ReadoutSettings
    from ...twin.live.sample_sources import open_source

    if options.seconds is not None:
        check_range("--seconds", options.seconds, 0.1, 1e6)
    if options.port is None:
        return _survey(options, serial_ports())
    source = open_source(
        options.port, ReadoutSettings(rate=options.rate, average=options.average)
    ).source
    info = source.start()
    try:
        return _watch(options, source, info)
    except KeyboardInterrupt:
        return 0
    finally:
        source.close()


def _survey(options: argparse.Namespace, found: Sequence[Port]) -> int:
    """Every port, and one look at what the read-out boards on them read."""
    looks = [{} if options.list else _look(options, p.device) for p in found]
    if options.json:
        rows = [vars(p) | look for p, look in zip(found, looks, strict=True)]
        print_json(rows)
        return 0
    if not found:
        sys.stdout.write(
            "no serial port is plugged in\n"
            "Next:    plug the read-out board in; or try defsense calibrate ports --port twin\n"
        )
        return 0
    from rich.console import Console

    from ..terminal.guided_measurement import bars

    console = Console()
    for p, look in zip(found, looks, strict=True):
        console.print(f"{p.device:<16} {p.description}", highlight=False, markup=False)
        if "ohm" in look:
            nan = float("nan")
            values = {f"  channel {i + 1}": nan if r is None else r
                      for i, r in enumerate(look["ohm"])}  # fmt: skip
            console.print(bars(values))
        elif look:
            console.print(f"  {look['problem']}", highlight=False, markup=False, soft_wrap=True)
    best = next((p.device for p, look in zip(found, looks, strict=True) if "ohm" in look), None)
    console.print(f"Next:    defsense calibrate ports --port {best or found[0].device}",
                  highlight=False)  # fmt: skip
    return 0


def _look(options: argparse.Namespace, port: str) -> dict[str, Any]:
    """Resistances on a port, or why there are none."""
    import numpy as np

    from ...capture.readout.reader import ReadoutSettings
    from ...sensing.voltage_divider import Dividers
    from ...twin.live.sample_sources import open_source

    source = open_source(port, ReadoutSettings()).source
    try:
        info = source.start()
        time.sleep(0.5)
        latest = source.read_latest(2.0)
    except CaptureError as error:
        return {"problem": str(error).removeprefix(f"{port}: ")}
    finally:
        source.close()
    known = np.array(parse_references(options.reference or f"{REFERENCE_OHM:g}", info.channels))
    ohm = Dividers(known, float(info.full_scale)).resistance(latest.sample.counts)
    return {"ohm": [float(r) if np.isfinite(r) else None for r in ohm]}


def _watch(options: argparse.Namespace, source: Source, info: Info) -> int:
    """Live values until the time is over or the source has no more."""
    import numpy as np
    from rich.console import Console
    from rich.live import Live

    from ...capture.readout.source import StampedSample
    from ...sensing.voltage_divider import Dividers
    from ..terminal.guided_measurement import bars

    dividers = Dividers(
        np.array(parse_references(options.reference or f"{REFERENCE_OHM:g}", info.channels)),
        float(info.full_scale),
    )
    end = time.monotonic() + (options.seconds or float("inf"))
    ohm: Float | None = None
    console = Console(stderr=options.json)
    with Live(console=console, auto_refresh=False, transient=options.json) as live:
        while time.monotonic() < end:
            time.sleep(0.1)
            try:
                items = [i for i in source.drain() if isinstance(i, StampedSample)]
            except CaptureError:
                break
            if items:
                ohm = dividers.resistance(items[-1].sample.counts)
                named = {f"channel {i + 1}": float(r) for i, r in enumerate(ohm)}
                live.update(bars(named), refresh=not options.json)
    s = source.statistics
    if ohm is None:
        raise CaptureError(f"{source.name}: no sample arrived")
    if options.json:
        told = [float(r) if np.isfinite(r) else None for r in ohm]
        print_json({"ohm": told, **vars(s)})
    else:
        sys.stdout.write(f"\n{s.samples} samples, {s.lost} lost, {s.bad} damaged frames\n")
    return 0


def _record(options: argparse.Namespace) -> int:
    from ...calibration import session as sessions
    from ...calibration.guided_measurement import run_guided_measurement
    from ...capture.readout.reader import ReadoutSettings
    from ...twin.live.sample_sources import open_source
    from ..terminal.guided_measurement import MeasurementLines, MeasurementTerminal

    if options.port.endswith(".csv"):
        raise DeviceError(f"--port {options.port}: a recording cannot be measured again")
    about = sessions.read_specimen(options.specimen)
    beside = options.specimen if options.specimen.is_dir() else options.specimen.parent
    folder = options.out or beside / "session"
    wanted = _wanted(options, about)
    session, begun = sessions.create_or_resume(
        folder, wanted, [k for k in wanted if k in _given(options)]
    )
    settings = ReadoutSettings(channels=3, average=session.average, rate=session.rate)
    try:
        opened = open_source(options.port, settings, session.geometry, session.length)
        if options.auto:
            done = run_guided_measurement(
                session, opened.source, MeasurementLines(), opened.hands, auto=True
            )
        else:
            screen = MeasurementTerminal(
                session.criterion, session.geometry.thickness, session.length
            )
            with screen:
                done = run_guided_measurement(session, opened.source, screen, opened.hands)
    except KeyboardInterrupt:
        done = False
    except DefsenseError:
        if not begun:
            sessions.discard_empty(session)
        raise
    return _recorded(options, session, done)


#: Options of `record` by what they set in a session, with what is taken where they are not given.
_PLAN = {
    "name": None, "rounds": 3, "radii": None, "faces": "ab", "tolerance": 0.05, "longest": 90.0,
    "seed": 1, "reference": f"{REFERENCE_OHM:g}", "rate": 20, "average": None,
}  # fmt: skip


def _given(options: argparse.Namespace) -> set[str]:
    """What of a session the user named."""
    given = {name for name in _PLAN if getattr(options, name) is not None}
    return {{"tolerance": "criterion", "longest": "criterion"}.get(n, n) for n in given}


def _wanted(options: argparse.Namespace, about: dict[str, Any]) -> dict[str, Any]:
    """Of a new session. Raises DeviceError for options that make none."""
    from ...calibration.readings import MIN_RADII
    from ...core.storage.session_manifest import Criterion

    o: dict[str, Any] = {
        n: d if getattr(options, n) is None else getattr(options, n) for n, d in _PLAN.items()
    }
    for name, low, high in (
        ("rounds", 1, 100), ("rate", 1, 500), ("tolerance", 1e-4, 10), ("longest", 10, 3600),
        ("seed", 0, 2**32),
    ):  # fmt: skip
        check_range(f"--{name}", o[name], low, high)
    radii = about["radii"] if o["radii"] is None else parse_numbers("--radii", o["radii"])
    strange = [r for r in radii if r not in about["radii"]]
    if strange:
        have = ", ".join(f"{r:g}" for r in about["radii"])
        raise DeviceError(f"--radii: {strange[0]:g} is none of the specimen's jigs: {have}")
    if len(set(radii)) < max(len(radii), MIN_RADII):
        raise DeviceError(f"--radii: give {MIN_RADII} different ones or more")
    return {
        "name": o["name"] or f"{about['length']:g}",
        "geometry": about["geometry"],
        "length": about["length"],
        "radii": radii,
        "rounds": o["rounds"],
        "faces": list(o["faces"]),
        "seed": o["seed"],
        "reference": parse_references(o["reference"], 3),
        "criterion": Criterion(tolerance=o["tolerance"] / 100, most=o["longest"]),
        "rate": o["rate"],
        "average": o["average"],
    }


def _recorded(options: argparse.Namespace, session: CalibrationSession, done: bool) -> int:
    from ...calibration import session as sessions

    left = len(sessions.unfinished_steps(session))
    total = len(session.steps)
    if options.json:
        data = {"session": str(session.folder), "finished": done, "left": left, "steps": total}
        print_json(data)
    elif done and not left:
        sys.stdout.write(
            f"all {total} readings are done: {session.folder}\n"
            f"Next:    defsense calibrate fit {session.folder} (and other specimens' sessions)\n"
        )
    else:
        sys.stdout.write(
            f"stopped with {total - left} of {total} readings; every frame is in {session.folder}\n"
            "Next:    the same command goes on with the others; fit takes what there is\n"
        )
    return DONE if done and not left else STOPPED


def _reference(options: argparse.Namespace) -> int:
    import numpy as np

    from ...capture.readout.reader import ReadoutSettings
    from ...capture.readout.source import StampedSample
    from ...sensing.voltage_divider import measure_reference
    from ...twin.live.sample_sources import open_source

    check_range("--known", options.known, 1e-3, 1e9)
    check_range("--seconds", options.seconds, 0.1, 3600)
    check_range("--channels", options.channels, 1, 16)
    source = open_source(options.port, ReadoutSettings(channels=options.channels)).source
    info = source.start()
    try:
        time.sleep(options.seconds)
        counts = [i.sample.counts for i in source.drain() if isinstance(i, StampedSample)]
    finally:
        source.close()
    if not counts:
        raise CaptureError(f"{source.name}: no sample arrived")
    found = measure_reference(np.mean(counts, axis=0), options.known, float(info.full_scale))
    words = ",".join(f"{r:.1f}" for r in found)
    if options.json:
        print_json({"reference": found.tolist()})
    else:
        sys.stdout.write(f"Next:    defsense calibrate record ... --reference {words}\n")
    return 0


def _twin(options: argparse.Namespace) -> int:
    from ...core.response import ResponseSpec
    from ...sensing.response import build_response
    from ...twin.calibration_session import record_twin
    from ...twin.electronics.cords import CordTraits

    for name, low, high in (
        ("k", -100, 100), ("q", -1000, 1000), ("noise", 0, 1), ("play", 0, 1), ("healing", 0, 1),
        ("time", 0.1, 1e4), ("spread", 0, 0.5), ("drift", -10, 10), ("misplaced", 0, 5),
        ("rounds", 1, 100), ("seed", 0, 2**32),
    ):  # fmt: skip
        check_range(f"--{name}", getattr(options, name), low, high)
    lengths = parse_numbers("--lengths", options.lengths)
    for length in lengths:
        check_range("--lengths", length, 10, 1000)
    folders = [options.folder / f"session-{length:g}" for length in lengths]
    there = [f for f in folders if f.exists()]
    if there or len(set(folders)) < len(folders):
        raise DeviceError(
            f"{there[0]}: is there already; choose another folder" if there
            else f"--lengths {options.lengths}: give different ones"
        )  # fmt: skip
    spec = ResponseSpec("quadratic", {"k": options.k, "q": options.q}, (-0.1, 0.1))
    traits = CordTraits(
        build_response(spec), options.noise, options.play, options.healing, options.time,
        options.spread, drift=options.drift,
    )  # fmt: skip
    for n, (length, folder) in enumerate(zip(lengths, folders, strict=True)):
        record_twin(
            folder, traits, seed=1000 * options.seed + n, length=length, rounds=options.rounds,
            misplaced=options.misplaced,
        )  # fmt: skip
    if options.json:
        print_json({"sessions": list(map(str, folders))})
    else:
        out = options.folder / "response.json"
        sys.stdout.write(
            f"Next:    defsense calibrate fit {' '.join(map(str, folders))} --out {out}\n"
        )
    return 0
