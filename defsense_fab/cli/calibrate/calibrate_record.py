"""Commands `defsense calibrate ports | record | reference | twin`."""

from __future__ import annotations

import argparse
import sys
import time
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
from .ports_display import run_ports

if TYPE_CHECKING:
    from ...calibration.session import CalibrationSession
    from ..options import Commands

_PORT = "/dev/ttyUSB0, COM3, socket://host:port, or twin (twin:speed=20,k=2,seed=1)"


def add(steps: Commands) -> None:
    """Add the commands to `calibrate`."""
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
    _add_board_options(sub)
    add_output_options(sub)
    sub.set_defaults(run=run_ports)
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
    _add_board_options(sub)
    add_output_options(sub)
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
    add_output_options(sub)
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
        ("k", 2.0, "slope of the response at rest (k_res)"),
        ("q", 0.0, "quadratic coefficient of the response"),
        ("noise", 0.002, "standard deviation of one reading of (R - R0)/R0"),
        ("play", 0.003, "half width of the hysteresis, relative to R0"),
        ("healing", 0.1, "share of a change that relaxes"),
        ("time", 8.0, "time constant of the relaxation in s"),
        ("spread", 0.02, "standard deviation of the gains of the pieces"),
        ("drift", 0.0, "drift of all resistances per hour"),
        ("misplaced", 0.0, "standard deviation of the heights of the cords in mm"),
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
    add_output_options(sub)
    sub.set_defaults(run=_twin)


def _add_board_options(sub: argparse.ArgumentParser) -> None:
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


def _record(options: argparse.Namespace) -> int:
    from ...calibration import session as sessions
    from ...calibration.guided_measurement import run_guided_measurement
    from ...capture.readout.reader import ReadoutSettings
    from ...twin.live.sample_sources import open_source
    from ..terminal.guided_measurement import MeasurementLines, MeasurementTerminal

    if options.port.endswith(".csv"):
        raise DeviceError(
            f"{options.port} is a recording, which cannot be measured again",
            code="port-is-recording",
            where="--port",
            action="Give the port of a read-out board, or twin",
        )
    specimen = sessions.read_specimen(options.specimen)
    parent = options.specimen if options.specimen.is_dir() else options.specimen.parent
    folder = options.out or parent / "session"
    fields = _session_fields(options, specimen)
    session, is_resumed = sessions.create_or_resume(
        folder, fields, [k for k in fields if k in _given_fields(options)]
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
        if not is_resumed:
            sessions.discard_empty(session)
        raise
    return _print_recorded(options, session, done)


#: Options of `record`, by their field of a session, with the defaults of a new session.
_DEFAULTS = {
    "name": None, "rounds": 3, "radii": None, "faces": "ab", "tolerance": 0.05, "longest": 90.0,
    "seed": 1, "reference": f"{REFERENCE_OHM:g}", "rate": 20, "average": None,
}  # fmt: skip


def _given_fields(options: argparse.Namespace) -> set[str]:
    """Return the fields of a session that the user has set."""
    given = {name for name in _DEFAULTS if getattr(options, name) is not None}
    return {{"tolerance": "criterion", "longest": "criterion"}.get(n, n) for n in given}


def _session_fields(options: argparse.Namespace, specimen: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a new session, after checking the options."""
    from ...calibration.readings import MIN_RADII
    from ...core.storage.session_manifest import Criterion

    o: dict[str, Any] = {
        n: d if getattr(options, n) is None else getattr(options, n) for n, d in _DEFAULTS.items()
    }
    for name, low, high in (
        ("rounds", 1, 100), ("rate", 1, 500), ("tolerance", 1e-4, 10), ("longest", 10, 3600),
        ("seed", 0, 2**32),
    ):  # fmt: skip
        check_range(f"--{name}", o[name], low, high)
    radii = specimen["radii"] if o["radii"] is None else parse_numbers("--radii", o["radii"])
    unknown = [r for r in radii if r not in specimen["radii"]]
    if unknown:
        available = ", ".join(f"{r:g}" for r in specimen["radii"])
        raise DeviceError(
            f"{unknown[0]:g} is not the radius of one of the specimen's jigs",
            code="unknown-radius",
            where="--radii",
            action=f"Choose from {available}",
            radius=unknown[0],
        )
    if len(set(radii)) < max(len(radii), MIN_RADII):
        raise DeviceError(
            f"{len(set(radii))} different radii are too few",
            code="too-few-radii",
            where="--radii",
            action=f"Give {MIN_RADII} different radii or more",
            count=len(set(radii)),
        )
    return {
        "name": o["name"] or f"{specimen['length']:g}",
        "geometry": specimen["geometry"],
        "length": specimen["length"],
        "radii": radii,
        "rounds": o["rounds"],
        "faces": list(o["faces"]),
        "seed": o["seed"],
        "reference": parse_references(o["reference"], 3),
        "criterion": Criterion(tolerance=o["tolerance"] / 100, most=o["longest"]),
        "rate": o["rate"],
        "average": o["average"],
    }


def _print_recorded(options: argparse.Namespace, session: CalibrationSession, done: bool) -> int:
    from ...calibration import session as sessions

    remaining = len(sessions.unfinished_steps(session))
    total = len(session.steps)
    if options.json:
        data = {"session": str(session.folder), "finished": done, "left": remaining, "steps": total}
        print_json(data)
    elif done and not remaining:
        sys.stdout.write(
            f"All {total} readings are complete: {session.folder}\n"
            f"Next:    defsense calibrate fit {session.folder} (and other specimens' sessions)\n"
        )
    else:
        sys.stdout.write(
            f"Stopped after {total - remaining} of {total} readings; all frames are in"
            f" {session.folder}\n"
            "Next:    rerun the command to resume; fit accepts incomplete sessions\n"
        )
    return DONE if done and not remaining else STOPPED


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
        raise CaptureError(
            "no sample arrived",
            code="no-samples",
            where=source.name,
            action="Check the read-out board and its cable",
        )
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
    existing = [f for f in folders if f.exists()]
    if len(set(folders)) < len(folders):
        raise DeviceError(
            f"{options.lengths} has equal lengths",
            code="lengths-not-unique",
            where="--lengths",
            action="Give different lengths",
        )
    if existing:
        raise DeviceError(
            "exists already",
            code="session-exists",
            where=existing[0],
            action="Choose another folder",
            path=existing[0],
        )
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
