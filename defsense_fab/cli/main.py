"""The command `defsense`: reads arguments, calls the pipeline, shows progress and results."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from .. import __version__
from ..core.errors import DefsenseError, DeviceError, StorageError
from ..core.progress import Progress, silent
from . import calibrate, capture
from .options import console, say

_STAGES = {
    "build": ("report", "all stages: body, mesh, poses, cords, parts, report"),
    "mesh": ("mesh", "load the body and make tetrahedra"),
    "simulate": ("simulate", "solve every pose, after what it needs"),
    "optimize": ("optimize", "route the cords, after what they need"),
    "fabricate": ("fabricate", "make the parts, after what they need"),
    "report": ("report", "write the report, after what it needs"),
}


_INTERRUPTED = {
    "build": "interrupted; the last build is untouched, and the same command goes on from the last"
    " finished stage",
    "capture": "interrupted; what was recorded is there, and files that were being written are not",
    "calibrate": "interrupted; what was recorded is there, and the same command goes on",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0, or 2 for an error the user can mend."""
    options = _parser().parse_args(arguments)
    level = logging.DEBUG if options.verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    for noisy in ("matplotlib", "numba", "trimesh", "build123d", "PIL"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    with _interrupts() as interrupted:
        try:
            return int(options.run(options))
        except DefsenseError as error:
            return _refuse(str(error))
        except MemoryError:
            return _refuse("out of memory; use a larger [mesh] edge_length in device.toml")
        except KeyboardInterrupt:
            return _refuse(_INTERRUPTED.get(options.command, _INTERRUPTED["build"]))
        except Exception:
            if not interrupted:
                raise
            return _refuse(_INTERRUPTED.get(options.command, _INTERRUPTED["build"]))


@contextlib.contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Ctrl-C as KeyboardInterrupt, remembered: native modules turn it into other errors."""
    seen: list[int] = []

    def interrupt(number: int, _: object) -> None:
        seen.append(number)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield seen
        return
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield seen
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _output() -> Iterator[None]:
    """Results go to standard output: a reader that left is no error, a full disk is one."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise StorageError(
            f"standard output: {error.strerror}; the build is finished, its results are in its"
            " folder"
        ) from None


def _refuse(message: str) -> int:
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write("error: " + " ".join(message.split()) + "\n")
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="defsense",
        description="Soft objects that sense their own deformation: from a device folder to"
        " printable parts with a predicted accuracy.",
        epilog="example:  defsense build fixtures/devices/bar",
    )
    parser.add_argument("--version", action="version", version=f"defsense-fab {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (until, text) in _STAGES.items():
        sub = commands.add_parser(
            name,
            help=text,
            description=f"{text.capitalize()}. What is up to date is reused.",
            epilog=f"example:  defsense {name} fixtures/devices/bar --set width=32",
        )
        _common(sub)
        sub.set_defaults(until=until, run=_build)
    sub = commands.add_parser(
        "modes",
        help="propose poses from the body's natural modes",
        description="Find the lowest vibration modes of the body with a region held, and turn"
        " bends, twists and stretches into poses for device.toml, which may have none yet.",
        epilog="example:  defsense modes fixtures/devices/bar --fixed base",
    )
    _common(sub)
    sub.add_argument("--fixed", required=True, metavar="REGION", help="the region that is held")
    sub.add_argument("--count", type=int, default=8, help="how many modes to look at (8)")
    sub.add_argument("--write", action="store_true", help="add the poses to device.toml")
    sub.set_defaults(run=_modes)
    sub = commands.add_parser(
        "study",
        help="how many cords a device should have",
        description="Find the best layout of each number of cords and show how the predicted error"
        " falls. Cords drawn in device.toml are left out of account; [design] planes holds; for the"
        " decoder auto the affine one is studied. A study that was interrupted goes on where it"
        " stood.",
        epilog="example:  defsense study fixtures/devices/bar --sensors 1..6",
    )
    _common(sub)
    sub.add_argument(
        "--sensors", default="1..6", metavar="A..B", help="numbers of cords to look at (1..6)"
    )
    sub.set_defaults(run=_study)
    calibrate.add(commands, _bars)
    capture.add(commands, _bars)
    return parser


def _common(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("folder", type=Path, metavar="DIR", help="the folder of device.toml")
    sub.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the body's script, in place of device.toml's; may be repeated",
    )
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")


def _modes(options: argparse.Namespace) -> int:
    from ..core.device_file import load_device

    if not 1 <= options.count <= 50:
        raise DeviceError(f"--count {options.count}: give a number from 1 to 50")
    device = load_device(options.folder, _overrides(options.set), complete=False)
    from ..pipeline.study import propose_poses

    with _silent_stdout(), _bars(options) as progress:
        found = propose_poses.propose_poses(device, options.fixed, options.count, progress)
    if options.write:
        propose_poses.append(
            options.folder / "device.toml", found, tuple(p.name for p in device.poses)
        )
    with _output():
        if options.json:
            rows = [
                {"frequency": m.frequency, "kind": m.kind, "order": m.order} for m in found.modes
            ]
            data = {"modes": rows, "toml": found.text, "picture": str(found.picture)}
            sys.stdout.write(json.dumps(data, indent=1) + "\n")
        else:
            _show_modes(found, options)
    return 0


def _show_modes(found: Any, options: argparse.Namespace) -> None:
    from rich.table import Table

    out = console()
    table = Table(title=f"modes with {options.fixed!r} held")
    for column in ("Hz", "kind", "order"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    for mode in found.modes:
        table.add_row(f"{mode.frequency:.3g}", mode.kind, str(mode.order))
    out.print(table)
    say([found.text])
    following = (
        f"defsense build {options.folder}"
        if options.write
        else f"defsense modes {options.folder} --fixed {options.fixed} --write, or paste the text"
        " into device.toml"
    )
    say([f"Look at: {found.picture}", f"Next:    {following}"])


def _study(options: argparse.Namespace) -> int:
    from ..core.device_file import load_device

    least, most = _range(options.sensors)
    device = load_device(options.folder, _overrides(options.set))
    from ..pipeline.study import cord_count

    with _silent_stdout(), _bars(options) as progress:
        found = cord_count.study(device, least, most, progress)
    with _output():
        if options.json:
            rows = [
                {k: v for k, v in vars(r).items() if k != "layout" and v == v} for r in found.rows
            ]
            data = {"rows": rows, "knee": found.knee, "decoder": found.decoder}
            data["ended"] = found.ended
            files = {"file": str(found.file), "picture": str(found.picture)}
            sys.stdout.write(json.dumps({**data, **files}, indent=1) + "\n")
        else:
            _show_study(found, options)
    return 0


def _range(text: str) -> tuple[int, int]:
    least, dots, most = text.partition("..")
    if not (least.isdigit() and (most.isdigit() if dots else not most)):
        raise DeviceError(f"--sensors {text}: write a range such as 1..6, or one number")
    a, b = int(least), int(most or least)
    if not 1 <= a <= b <= 16:
        raise DeviceError(f"--sensors {text}: give numbers from 1 to 16, the smaller one first")
    return a, b


def _show_study(found: Any, options: argparse.Namespace) -> None:
    from rich.table import Table

    out = console()
    table = Table(title=f"predicted RMSE, mm, {found.decoder} decoder, by number of cords")
    for column in ("cords", "with noise", "without", "held out", "affine floor", ""):
        table.add_column(column, justify="right" if column else "left")
    for r in found.rows:
        numbers = (r.rmse, r.rmse_noise_free, r.held_out, r.floor)
        cells = ("-" if v != v else f"{v:.3f}" for v in numbers)
        mark = "recommended" if r.sensors == found.knee else ""
        table.add_row(str(r.sensors), *cells, mark)
    out.print(table)
    if found.ended:
        say([f"note: ended early: {found.ended}"])
    if any(r.held_out != r.held_out for r in found.rows):
        say([
            "note: no states are held out; [states] held_out in device.toml tells how the layouts"
            " do between the poses"
        ])  # fmt: skip
    say([
        f"Look at: {found.picture}",
        f"Next:    [design] sensors = {found.knee} in {options.folder / 'device.toml'}, then"
        f" defsense build {options.folder}",
    ])  # fmt: skip


def _build(options: argparse.Namespace) -> int:
    from ..core.device_file import load_device

    device = load_device(options.folder, _overrides(options.set))
    from ..pipeline.build.build import build, summary

    with _silent_stdout(), _bars(options) as progress:
        result = build(device, options.until, progress)
    data = {**summary(result.folder), "made": result.made, "reused": result.reused}
    with _output():
        if options.json:
            sys.stdout.write(json.dumps(data, indent=1) + "\n")
        else:
            _show(data, options)
    return 0


def _overrides(pairs: Sequence[str]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name.isidentifier():
            raise DeviceError(f"--set {pair}: write it as NAME=VALUE, for example length=180")
        try:
            out[name] = json.loads(text)
        except ValueError:
            out[name] = text
    return out


@contextlib.contextmanager
def _silent_stdout() -> Iterator[None]:
    """Native libraries print to descriptor 1: send that to standard error meanwhile."""
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(saved, 1)
        os.close(saved)


@contextlib.contextmanager
def _bars(options: argparse.Namespace) -> Iterator[Progress]:
    """A bar for each stage on standard error; plain lines where that is no terminal."""
    if options.json and not options.verbose:
        yield silent
        return
    if not sys.stderr.isatty():
        yield _Lines(options.verbose)
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    with Bars(
        TextColumn("{task.fields[stage]:<10}"),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
        console=Console(stderr=True),
    ) as bars:
        tasks: dict[str, Any] = {}

        def show(stage: str, fraction: float, message: str) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(message, total=1.0, stage=stage)
            bars.update(tasks[stage], completed=fraction, description=message)

        yield show


class _Lines:
    """Progress as lines: the beginning and end of each stage, or everything with -v."""

    def __init__(self, everything: bool) -> None:
        self._everything, self._stage = everything, ""

    def __call__(self, stage: str, fraction: float, message: str) -> None:
        if self._everything or stage != self._stage or message == "done":
            self._stage = stage
            sys.stderr.write(f"{stage:<10} {100 * fraction:3.0f} %  {message}\n")


def _percent(error: float | None) -> str:
    return "an unknown error" if error is None else f"{error:.2%}"


def _show(data: dict[str, Any], options: argparse.Namespace) -> None:
    from rich.table import Table

    out = console()
    if not data["made"]:
        say(["Everything is up to date."])
    folder = data["build"]
    chosen = data.get("mesh", {}).get("accuracy")
    if chosen:
        say([
            f"mesh: an edge length of {data['mesh']['edge_length']:.3g} mm"
            f" ({data['mesh']['tets']} tets) keeps signals within {_percent(chosen['reached'])};"
            f" {chosen['asked']:.2%} was asked"
        ])  # fmt: skip
    say(f"note: {w}" for k in ("simulation", "layout") for w in data.get(k, {}).get("warnings", []))
    if "layout" in data:
        layout = data["layout"]
        first, best = layout["initial"], layout["prediction"]
        table = Table(title="predicted RMSE, mm")
        for column in (
            "",
            "as proposed" if layout["proposed"] else "as drawn",
            "optimised",
            "floor" if best["decoder"] == "affine" else "affine floor",
        ):
            table.add_column(column, justify="right" if column else "left")
        table.add_row("with noise", f"{first['rmse']:.3f}", f"{best['rmse']:.3f}", "")
        table.add_row(
            "without",
            f"{first['rmse_noise_free']:.3f}",
            f"{best['rmse_noise_free']:.3f}",
            f"{best['floor']:.3f}",
        )
        band = layout["band"]
        table.add_row("90 % of devices", "", f"{band['low']:.2f} to {band['high']:.2f}", "")
        out.print(table)
    if "manifest" in data:
        manifest = data["manifest"]
        table = Table(title="parts")
        for column in ("part", "volume, cm3", "size, mm"):
            table.add_column(column, justify="left" if column == "part" else "right")
        for p in manifest["parts"]:
            low, high = p["bbox"]
            size = " x ".join(f"{b - a:.1f}" for a, b in zip(low, high, strict=True))
            table.add_row(p["name"], f"{p['volume'] / 1000:.2f}", size)
        out.print(table)
        table = Table(title="cut list")
        for column in ("cord", "cut to, mm", "expected, ohm"):
            table.add_column(column, justify="left" if column == "cord" else "right")
        for c in manifest["cords"]:
            table.add_row(c["sensor"], f"{c['cut_length']:.0f}", f"{c['resistance']:.0f}")
        out.print(table)
        say(f"note: {w}" for w in manifest["warnings"])
    where = f"{folder}/report.html" if options.until == "report" else folder
    following = {
        "build": f"slice {folder}/parts/plate*.3mf, follow {folder}/guide.html",
        "mesh": f"defsense simulate {options.folder}",
        "simulate": f"defsense optimize {options.folder}",
        "optimize": f"defsense fabricate {options.folder}",
        "fabricate": f"defsense report {options.folder}",
        "report": f"slice {folder}/parts/plate*.3mf, follow {folder}/guide.html",
    }[options.command]
    text = f"Look at: {where}\nNext:    {following}"
    say([text])


if __name__ == "__main__":
    sys.exit(main())
