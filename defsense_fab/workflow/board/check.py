"""Check the wiring of a built device on its read-out board."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...capture.board_check.assignment import choose_poses, indistinct_pairs
from ...capture.board_check.diagnosis import rest_deviation
from ...capture.board_check.guided_check import CheckWork, Hand, check_steps
from ...capture.board_check.mains import Sampling, choose_sampling
from ...capture.board_check.records import BoardSetup, ExpectedCord, Finding
from ...capture.readout.ports import open_port
from ...capture.readout.reader import Reader, ReadoutSettings
from ...core.device.build_folder import finished_build
from ...core.device.device import Device
from ...core.device.device_file import load_device
from ...core.errors import CaptureError
from ...core.guided_run import GuidedRun, GuidedView, Screen
from ...core.progress import Notice
from ...sensing.serial_frames import Info
from ...sensing.voltage_divider import reference_resistors
from ...store.build import Build
from ...store.fields import INDEX
from ...store.layout import LAYOUT
from ...store.manifest import MANIFEST
from ...twin.live.wiring_twin import WiringTwin, WiringTwinOptions
from ...twin.options import TWIN
from ..view import open_guided_page
from .expected_cords import expected_cords
from .options import CheckOptions

_DEFAULT_OPTIONS = CheckOptions()
_TITLE = "Check the wiring"


@dataclass(frozen=True)
class BoardCheck:
    """Result of a check of the wiring.

    Attributes:
        device: Name of the device.
        findings: One finding for each channel; empty if the readings at rest are missing.
        notices: What the check could not decide.
        sampling: Rate and averages of the readings.
        reference: Reference resistors that were assumed (c,), ohm.
        poses: Poses that were to be held.
        is_complete: Whether all steps were done.
    """

    device: str
    findings: tuple[Finding, ...]
    notices: tuple[Notice, ...]
    sampling: Sampling
    reference: tuple[float, ...]
    poses: tuple[str, ...]
    is_complete: bool

    @property
    def is_sound(self) -> bool:
        """Whether all channels are in order."""
        return bool(self.findings) and all(f.code == "ok" for f in self.findings)


def check_board(
    folder: Path,
    port: str,
    options: CheckOptions = _DEFAULT_OPTIONS,
    *,
    screen: AbstractContextManager[Screen],
    auto: bool = False,
    page: int | None = None,
    on_page: Callable[[str], None] | None = None,
) -> BoardCheck:
    """Check the wiring of a device, step by step.

    Args:
        folder: Folder of the device, built until its parts.
        port: Port of the read-out board, or `twin`, with faults as in `twin:cut=A`.
        options: What is checked.
        screen: Shows the steps and reads keys; opened when the board answers.
        auto: Whether each step starts without a key.
        page: Port of a page in the browser that shows the steps, too; None for none. Unless steps
            start without keys, the page stays until the user closes it.
        on_page: Called with the address of the page.

    Returns:
        The findings, and what could not be decided.

    Raises:
        CaptureError: The device is not built, the port cannot be read, is a recording
            (`port-is-recording`), or the number of reference resistors is wrong.
        OutputError: The page cannot be served.
        StorageError: A file of the build is missing or damaged.
    """
    device = load_device(folder)
    build = Build(finished_build(device, LAYOUT, INDEX, MANIFEST))
    cords = expected_cords(device, build)
    proposed = options.reference or build.reference_resistors
    reference = tuple(reference_resistors(proposed, len(cords)))
    deviation = rest_deviation(cords)
    poses = choose_poses(cords, deviation) if options.poses else ()
    notices = _find_doubts(cords, poses, options)
    steps = check_steps([c.name for c in cords], poses, wiggle=options.wiggle)
    reader, hand = _open(device, build, port, len(cords))
    with closing(reader):
        info = reader.start()
        info = reader.info or info
        sampling = Sampling(info.rate, info.averages, 0.0)
        board = BoardSetup(
            info.converter, float(info.full_scale), info.averages, np.array(reference)
        )
        work = CheckWork(steps, reader, cords, board, hand, notices)
        with ExitStack() as stack:
            shown = stack.enter_context(screen)
            if page is not None:
                shown = stack.enter_context(_with_page(shown, page, on_page))
            is_complete = GuidedRun(work, shown, auto=auto).run()
            findings = work.diagnose()
            if page is not None and not auto and is_complete:
                _wait_for_key(shown)
    return BoardCheck(
        device.name, findings, tuple(notices), sampling, reference, poses, is_complete
    )


def _open(device: Device, build: Build, port: str, channels: int) -> tuple[Reader, Hand | None]:
    """Return the reader of a port, and the hand of a simulated device."""

    def settings(info: Info) -> ReadoutSettings:
        s = choose_sampling(info.converter, channels, info.averages)
        return ReadoutSettings(channels=channels, average=s.averages, rate=s.rate)

    if port.endswith(".csv"):
        raise CaptureError(
            f"{port} is a recording, whose wires cannot be moved",
            code="port-is-recording",
            where="port",
            action="Give the port of a read-out board, or twin",
            port=port,
        )
    if port.partition(":")[0] == TWIN:
        twin = WiringTwin(device, WiringTwinOptions.parse(port), build)
        board = twin.board()
        return Reader(lambda: board, port, settings), twin.perform
    return Reader(partial(open_port, port), port, settings), None


def _find_doubts(
    cords: list[ExpectedCord], poses: tuple[str, ...], options: CheckOptions
) -> list[Notice]:
    """Return notices on pairs of cords that the steps cannot distinguish."""
    out = []
    for first, second in indistinct_pairs(cords, rest_deviation(cords), poses):
        if options.wiggle:
            means = "only moved wires can show whether they are exchanged"
        else:
            means = "it is not checked whether they are exchanged"
        text = f"{first} and {second} are not distinguishable by their readings: {means}"
        out.append(Notice("not-distinguishable", text, first, {"cords": (first, second)}))
    return out


class _TwoScreens:
    """Shows a guided run on two screens; keys of both count."""

    def __init__(self, first: Screen, second: Screen) -> None:
        self._first, self._second = first, second

    def show(self, view: GuidedView) -> None:
        """Show the state of the run on both."""
        self._first.show(view)
        self._second.show(view)

    def key(self, timeout: float) -> str | None:
        """Return the next key of either screen."""
        return self._first.key(timeout) or self._second.key(0.0)


@contextmanager
def _with_page(
    screen: Screen, port: int, on_page: Callable[[str], None] | None
) -> Iterator[Screen]:
    """Serve a page that shows the run, in addition to a screen."""
    with open_guided_page(port, _TITLE) as page:
        if on_page is not None:
            on_page(page.url)
        yield _TwoScreens(screen, page.screen)


def _wait_for_key(screen: Screen) -> None:
    """Wait until the user presses a key, so that the page can be read."""
    while screen.key(0.2) is None:
        pass
