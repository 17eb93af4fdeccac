"""Command `defsense run`: run devices live."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from msgspec import Meta

from ...core.errors import DeviceError
from ...core.schema.options import check_options
from ...workflow.run.options import RunOptions
from ..app import command, whole_number
from ..completers import complete_device_folders
from ..output import OutputOptions, print_error_line, print_lines, progress_bars
from .run_end import stop_at_end

if TYPE_CHECKING:
    from cyclopts import Token

    from ...core.progress import Progress
    from ...workflow.run.run import LiveRun

_DEFAULT_PAGE = 8080


def _texts(_: object, tokens: Sequence[Token]) -> tuple[str, ...]:
    """Return the words as they are: commas do not separate them."""
    return tuple(token.value for token in tokens)


def _device_folders(_: object, tokens: Sequence[Token]) -> tuple[Path, ...]:
    """Return folders of devices, each given by the folder or its device.toml."""
    from ...core.device.device_file import DEVICE

    paths = [Path(token.value) for token in tokens]
    return tuple(p.parent if p.name == DEVICE and p.is_file() else p for p in paths)


def _page_port(_: object, tokens: Sequence[Token]) -> tuple[int, ...]:
    return tuple(whole_number(None, [token]) for token in tokens)


@dataclass(frozen=True)
class ShowOptions:
    """What `defsense run` shows, sends and stores.

    Attributes:
        view: Show the surface in the browser on this port (default: 8080; following ports for
            further devices).
        browser: Open a browser; otherwise only print the page's address.
        output: Send to osc, websocket, midi, lsl or gamepad, with its settings
            (docs/live-outputs.md); may be repeated.
        live: Read outputs and controls from this live.toml (default: that of the device).
        no_record: Store no readings.
        seconds: Stop after this time in s (default: at Ctrl-C).
    """

    view: Annotated[
        tuple[Annotated[int, Meta(ge=1024, le=65535)], ...] | None,
        Parameter(converter=_page_port, consume_multiple=(0, 1), metavar="[PORT]"),
    ] = None
    browser: bool = True
    output: Annotated[
        tuple[str, ...],
        Parameter(
            converter=_texts,
            n_tokens=1,
            allow_repeating=True,
            metavar="KIND,...",
            show_default=False,
        ),
    ] = ()
    live: Annotated[Path | None, Parameter(metavar="TOML")] = None
    no_record: bool = False
    seconds: Annotated[float, Meta(ge=0.1, le=1e7)] | None = None

    def __post_init__(self) -> None:
        check_options(self)

    def page(self, number: int) -> int | None:
        """Return the port of the page of device `number`, counted from 0."""
        return None if self.view is None else (self.view or (_DEFAULT_PAGE,))[0] + number


_DEFAULTS, _SHOW_DEFAULTS, _NO_OUTPUT = RunOptions(), ShowOptions(), OutputOptions()

run = command(
    "run",
    "defsense run my-device/model.json --port twin --view",
    "defsense run my-device/model.json --port /dev/ttyUSB0 --view --output osc,port=9000",
    "defsense run my-device/model.json --port /dev/ttyUSB0 --live my-device/live.toml",
    "defsense run a/model.json b/model.json --port /dev/ttyUSB0 /dev/ttyUSB1 --view",
    "defsense run my-device/model.json --port twin:seed=7,cut=A@20-30 --seconds 40",
)


@run.default
def _run(
    models: Annotated[tuple[Path, ...], Parameter(metavar="MODEL...")],
    /,
    *,
    port: Annotated[
        tuple[str, ...], Parameter(converter=_texts, consume_multiple=True, metavar="PORT...")
    ],
    device: Annotated[
        tuple[Path, ...],
        Parameter(
            converter=_device_folders,
            consume_multiple=True,
            metavar="DIR...",
            show_default=False,
            completer=complete_device_folders,
        ),
    ] = (),
    options: Annotated[RunOptions, Parameter(name="*")] = _DEFAULTS,
    show: Annotated[ShowOptions, Parameter(name="*")] = _SHOW_DEFAULTS,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Run devices live: show their surfaces and send their poses to programs.

    Reads a device's cords and shows how it is bent, twisted or pulled: as a moving surface in the
    browser (--view), and as named controls for other programs (--output), one per pose or as
    formulas. Leave the device at rest for three seconds at the start. New rubber settles in its
    first cycles, so move the device through its poses and let it rest once more. All readings are
    stored in the device folder (live/); replay them with --port replay:FILE.

    Args:
        models: Model files (model.json), or their folders; several run at once.
        port: Set the port of each read-out board: /dev/ttyUSB0, COM3, socket://host:port,
            udp://HOST or tcp://HOST (Wi-Fi; HOST may be the name of a paired board);
            replay:board.csv or replay:SESSION (with the tracks of its cameras); or twin
            (twin:unit=1,seed=7,minutes=5,cut=A@20-30; cut, short, stuck, or swap=A+B;
            cords=hysteretic for cords fitted to recordings). A model of any other sensor plays a
            table (replay:signals.csv), or reads lines of text (stdin).
        device: Set the device folder for each model (default: that of the model).
    """
    from ..terminal.live_lines import LiveLines

    _check_counts(len(models), port, device, show)
    runs: list[LiveRun] = []
    with stop_at_end(runs, as_json=output.json):
        with progress_bars(output) as progress:
            for live_run in _prepare_runs(models, port, device, options, show, progress):
                runs += [live_run]  # at once: if a later one fails, this one is stopped
        for live_run in runs:
            live_run.loop.start()
        with LiveLines(runs, as_json=output.json) as lines:
            _announce(runs, as_json=output.json)
            if show.browser:
                _open_pages(runs)
            lines.follow(show.seconds)


def _check_counts(
    count: int, ports: Sequence[str], devices: Sequence[Path], show: ShowOptions
) -> None:
    """Raise DeviceError unless there is one port, and one folder if any, for each model."""
    for name, values in (("port", ports), ("device", devices)):
        if len(values) != count and (values or name == "port"):
            raise DeviceError(
                f"has {len(values)} values for {count} models",
                code="count-differs",
                where=f"--{name}",
                action="Give one for each model",
                option=f"--{name}",
                count=len(values),
            )
    last_page = show.page(count - 1)
    if last_page is not None and last_page > 65535:
        raise DeviceError(
            f"{last_page} is out of range",
            code="out-of-range",
            where="--view",
            action=f"Give a port of at most {65536 - count}",
            value=last_page,
        )


def _prepare_runs(
    models: Sequence[Path],
    ports: Sequence[str],
    devices: Sequence[Path],
    options: RunOptions,
    show: ShowOptions,
    progress: Progress,
) -> Iterator[LiveRun]:
    """Prepare the run of each device, with names, outputs, pages and files of its own."""
    from ...workflow.run.live_device import live_device
    from ...workflow.run.outputs import OutputAllocator, read_settings
    from ...workflow.run.run import prepare_run

    allocator = OutputAllocator()
    for k, model in enumerate(models):
        live = live_device(model, devices[k] if devices else None)
        name = allocator.unique_name(live.model.device)
        live = replace(live, model=replace(live.model, device=name))
        folder = live.device.source if live.device else None
        settings = read_settings(folder, show.live, show.output)
        yield prepare_run(
            live,
            ports[k],
            replace(
                options,
                record=own_folder(options.record, k),
                animation=own_file(options.animation, k),
            ),
            settings=replace(settings, outputs=allocator.allocate(settings.outputs)),
            view=show.page(k),
            keeps_readings=not show.no_record,
            progress=progress,
        )


def own_file(path: Path | None, k: int) -> Path | None:
    """Return the file of device `k`: x.glb for the first, then x-2.glb and so on."""
    return path if path is None or not k else path.parent / f"{path.stem}-{k + 1}{path.suffix}"


def own_folder(path: Path | None, k: int) -> Path | None:
    """Return the folder of device `k`, numbered like files; inside `.` and `..`, a subfolder."""
    if path is None or not k:
        return path
    inside = path.name in ("", "..")
    return path / f"{k + 1}" if inside else path.with_name(f"{path.name}-{k + 1}")


def _announce(runs: Sequence[LiveRun], *, as_json: bool) -> None:
    """Print addresses and notes at the start; on standard error for JSON."""
    for run in runs:
        lines = [f"note: {note}" for note in run.notes]
        if run.view is not None:
            lines.append(f"View:    {run.view.url}")
        for output in run.outputs:
            output.wait_until_tried(2.0)
            lines.append(f"Output:  {output.trouble or output.about}")
        if run.surface:
            lines.append(f"Surface: {run.surface}")
        if run.recording is not None:
            is_started = run.recording.wait_until_started(2.0)
            state = "" if is_started else " (starts with the first sample)"
            lines.append(f"Record:  {run.recording.path}{state}")
        if run.targets is not None:
            lines.append(f"Record:  {run.targets} (targets)")
        if run.animations is not None and run.animations.recording is not None:
            lines.append(f"Record:  {run.animations.recording} (animation, written at the end)")
        if as_json:
            for line in lines:
                print_error_line(line)
        else:
            print_lines(lines)
    if not as_json:
        print_lines(["Press Ctrl-C to stop."])
    sys.stdout.flush()


def _open_pages(runs: Sequence[LiveRun]) -> None:
    import webbrowser

    for run in runs:
        if run.view is not None:
            webbrowser.open(run.view.url)
