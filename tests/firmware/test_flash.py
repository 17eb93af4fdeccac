"""Write the firmware through the boot loaders of real boards, in simavr.

Optiboot and ATmegaBOOT are those of the Arduino core. They program the simulated chip themselves,
and the firmware that they start is read over the same port.
"""

import json
import random
import re
import shutil
import subprocess
import time

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from defsense_fab.capture.boards.images import IMAGES, IMAGES_FOLDER, find_image
from defsense_fab.capture.boards.stk500 import PAGE_BYTES, write_flash
from defsense_fab.capture.readout import greeting
from defsense_fab.capture.readout.ports import Port, open_port
from defsense_fab.cli.main import main
from defsense_fab.core.errors import CaptureError
from defsense_fab.sensing.serial_frames import FIRMWARE_VERSION, format_version
from defsense_fab.workflow.board import readout
from defsense_fab.workflow.board.flash import flash_board
from defsense_fab.workflow.board.options import FlashOptions
from defsense_fab.workflow.doctor import hardware
from tests.firmware import build
from tests.support.errors import raises
from tests.support.places import BAR

BAUD_RATES = {"optiboot": 115200, "atmegaboot": 57600}
VERSION = format_version(FIRMWARE_VERSION)
DIVIDER = IMAGES["nano", "arduino"].read()


@pytest.fixture
def arduino(board, built, tmp_path):
    """Return a function that starts a board with a boot loader, and the file of its memory."""
    memory = tmp_path / "memory"

    def start(boot_loader, sketch=None, *options):
        place = f"{build.BOOT_LOADERS[boot_loader]}:{built / boot_loader}.bin"
        return board(sketch, "--bootloader", place, "--flash", memory, *options)

    return start, memory


def write_anyway(running, **options):
    """Write the firmware to a board without reading the installed version."""
    return flash_board(None, FlashOptions(port=running.url, yes=True, force=True, **options))


@pytest.mark.slow
@pytest.mark.parametrize("boot_loader", BAUD_RATES)
def test_empty_board_runs_the_firmware(arduino, boot_loader):
    start, memory = arduino
    running = start(boot_loader)
    started_at = time.monotonic()
    result = write_anyway(running)
    print(f"{boot_loader}: {time.monotonic() - started_at:.1f} s")
    assert (result.version, result.previous, result.channels) == (VERSION, "", 8)
    assert result.boot_loader.baud == BAUD_RATES[boot_loader]
    assert flash_board(None, FlashOptions(port=running.url)).boot_loader is None
    running.stop()
    assert memory.read_bytes()[: len(DIVIDER)] == DIVIDER


@pytest.mark.slow
def test_firmware_for_another_converter_or_board_replaces_the_installed(arduino, tmp_path):
    """The device's converter is used; its firmware also starts without the converter."""
    start, _ = arduino
    running = start("optiboot")
    assert write_anyway(running, board="uno").channels == 6
    for name in ("device.toml", "bar.py"):
        shutil.copy(BAR / name, tmp_path)
    device = (tmp_path / "device.toml").read_text("utf-8")
    table = '[readout]\nboard = "uno"\nconverter = "ads1115"\n'
    (tmp_path / "device.toml").write_text(f"{device}\n{table}", "utf-8")
    result = flash_board(tmp_path, FlashOptions(port=running.url))
    assert (result.previous, result.version) == (VERSION, VERSION)
    assert (result.file, result.channels) == ("ads1115.hex", 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_interrupted_board_is_repaired_by_another_run(arduino, seed):
    """The board loses its power within a byte, and is plugged in again with what it has then."""
    start, memory = arduino
    boot_loader = "atmegaboot" if seed < 3 else "optiboot"
    running = start(boot_loader)
    port = open_port(running.url)
    pages = len(DIVIDER) // PAGE_BYTES + 1
    greeting, writing, verifying = 10, pages * (4 + 133), pages * (4 + 5)  # bytes of the commands
    cut_after = random.Random(seed).randrange(greeting + writing + verifying)
    write, sent = port.write, 0

    def write_until_the_cut(data):
        nonlocal sent
        if port.baudrate != BAUD_RATES[boot_loader]:
            write(data)
            return
        count = min(len(data), cut_after - sent)
        sent += count
        write(data[:count])
        if count < len(data):
            running.stop()

    port.write = write_until_the_cut
    with port, raises(CaptureError, "flash-interrupted"):
        write_flash(port, DIVIDER, "P")
    left = memory.read_bytes()
    assert (left[: len(DIVIDER)] == DIVIDER) == (cut_after >= greeting + writing)
    repaired = start(boot_loader)
    with open_port(repaired.url) as port:
        write_flash(port, DIVIDER, "P")
    repaired.stop()
    after = memory.read_bytes()
    assert after[: len(DIVIDER)] == DIVIDER
    section = int(build.BOOT_LOADERS[boot_loader], 16)
    assert after[section:] == left[section:]


@pytest.fixture(scope="module")
def old_firmware(built, tmp_path_factory):
    """Compile the firmware as an older version, and return its name."""
    library = tmp_path_factory.mktemp("old") / "DefSense"
    shutil.copytree(build.LIBRARY, library)
    source = library / "src/DefSense.cpp"
    text, count = re.subn(
        r"versionMajor = \d+, versionMinor = \d+",
        "versionMajor = 0, versionMinor = 9",
        source.read_text("utf-8"),
    )
    assert count == 1
    source.write_text(text, "utf-8")
    elf = build.build_sketch("divider", library.parent, library=library)
    shutil.copy(elf, built / "old.elf")
    return "old"


@pytest.mark.slow
def test_older_firmware_is_recognized_and_updated(arduino, old_firmware, monkeypatch, capsys):
    start, _ = arduino
    running = start("atmegaboot", old_firmware)
    monkeypatch.setattr(readout, "serial_ports", lambda: [Port(running.url, "")])
    offer = f"defsense board flash --port {running.url}"
    (before,) = readout.list_ports()
    assert (before.firmware, before.update) == ("0.9", VERSION)
    assert offer in hardware.describe_board(running.url)
    assert main(["board", "flash", "--port", running.url, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["previous"], result["version"]) == ("0.9", VERSION)
    assert main(["board", "ports"]) == 0
    assert offer not in capsys.readouterr().out
    assert main(["board", "flash", "--port", running.url]) == 0
    assert "already runs" in capsys.readouterr().out


@pytest.mark.slow
def test_another_program_is_replaced_only_on_request(arduino, monkeypatch):
    start, memory = arduino
    monkeypatch.setattr(greeting, "GREETING_TIMEOUT_S", 3)
    running = start("optiboot")
    with raises(CaptureError, "replacement-not-confirmed"):
        flash_board(None, FlashOptions(port=running.url))
    running.stop()
    assert set(memory.read_bytes()[: len(DIVIDER)]) == {255}


def test_version_in_the_sources_is_the_one_of_the_package():
    text = (build.LIBRARY / "src/DefSense.cpp").read_text("utf-8")
    found = re.search(r"versionMajor = (\d+), versionMinor = (\d+);", text)
    assert tuple(map(int, found.groups())) == FIRMWARE_VERSION


@pytest.mark.slow
@pytest.mark.parametrize("name", build.IMAGES)
def test_images_of_the_package_are_those_of_the_sources(built, tmp_path, name):
    """The bytes are the same in another folder."""
    if versions := build.differing_versions():
        pytest.skip(f"other versions give other images: {', '.join(versions)}")
    library = tmp_path / "elsewhere" / "DefSense"
    shutil.copytree(build.LIBRARY, library)
    image = build.build_image(name, tmp_path, library)
    assert image.read_bytes() == (IMAGES_FOLDER / image.name).read_bytes()


@pytest.mark.parametrize("count", [0, 2])
def test_port_is_chosen_only_if_it_is_the_only_one(monkeypatch, count):
    ports = [usb_port(n) for n in range(count)]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    code = "port-ambiguous" if count else "board-not-found"
    with raises(CaptureError, code, ports=[p.device for p in ports]):
        flash_board()


def usb_port(number):
    port = ListPortInfo(f"/dev/ttyUSB{number}", skip_link_detection=True)
    port.hwid, port.vid = "USB VID:PID=1A86:7523", 0x1A86
    return port


def test_absent_port_is_reported():
    with raises(CaptureError, "port-not-found"):
        flash_board(None, FlashOptions(port="/dev/no-such-port"))
    with raises(CaptureError, "port-not-serial"):
        flash_board(None, FlashOptions(port="udp://192.168.1.20"))


def test_image_for_a_board_without_one_is_refused():
    with raises(CaptureError, "image-missing"):
        find_image("pico", "pico")


@pytest.mark.peer
@pytest.mark.parametrize("boot_loader", BAUD_RATES)
def test_avrdude_leaves_the_same_memory(arduino, boot_loader, tmp_path):
    """A pty has no DTR: the reset button is pressed while avrdude waits."""
    if not shutil.which("avrdude"):
        pytest.skip("not installed: avrdude")
    start, memory = arduino
    running = start(boot_loader)
    with open_port(running.url) as port:
        write_flash(port, DIVIDER, "P")
    running.stop()
    ours = memory.read_bytes()
    memory.unlink()
    running = start(boot_loader)
    image = IMAGES_FOLDER / "divider-nano.hex"
    command = ["avrdude", "-p", "m328p", "-c", "arduino", "-D", "-P", running.port]
    command += ["-b", str(BAUD_RATES[boot_loader]), "-U", f"flash:w:{image}:i"]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    running.press_reset()
    output, _ = program.communicate(timeout=120)
    running.stop()
    assert program.returncode == 0, output
    assert memory.read_bytes() == ours
