"""The commands `defsense board ...`: what they print and refuse."""

import json
import os
import shutil
from dataclasses import replace

import pytest
import serial

from defsense_fab.capture.boards import stk500
from defsense_fab.capture.readout import greeting
from defsense_fab.capture.readout.paired_boards import store_board
from defsense_fab.cli.exit_codes import DONE, STOPPED
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import CaptureError, DefsenseError, DeviceError
from defsense_fab.core.storage import typed_json
from defsense_fab.store.manifest import MANIFEST
from defsense_fab.workflow.board import flash
from defsense_fab.workflow.board.wiring import plan_if_possible
from tests.capture.readout.fake_board import BOARD_ID, KEY, FakeBoard
from tests.report.wiring.plans import manifest_of
from tests.support.errors import raises
from tests.support.places import BAR


@pytest.fixture
def run(capsys):
    """Run a command and return what it prints, which is parsed if it is JSON."""

    def run(*words, code=DONE):
        assert run_command(["board", *map(str, words)]) == code
        text = capsys.readouterr().out
        return json.loads(text) if "--json" in words else text

    return run


def test_board_is_shown(run):
    data = run("ports", "--port", "twin", "--seconds", "0.5", "--json")
    assert len(data["ohm"]) == 3
    assert data["samples"] > 0
    assert "channel 3" in run("ports", "--port", "twin", "--seconds", "0.5")
    assert isinstance(run("ports", "--list", "--json"), list)
    with raises(CaptureError, "source-invalid"):
        run_command(["board", "ports", "--port", "twin:pace=3"])


def test_board_with_wifi_is_shown_with_its_network(run, tmp_path, monkeypatch):
    """Only boards that are read over a network have such counts."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path))
    with FakeBoard() as board:
        store_board(BOARD_ID, "elbow", KEY, f"127.0.0.1:{board.port}")
        data = run("ports", "--port", "udp://elbow", "--seconds", "2", "--json")
    assert data["samples"] > 0
    assert {"reordered", "duplicates", "late", "rejected"} < set(data["network"])
    assert data["network"]["round_trip_ms"] == 2 * data["network"]["network_latency_ms"]
    assert "network" not in run("ports", "--port", "twin", "--seconds", "0.5", "--json")


def test_duration_starts_when_the_board_answers(run, tmp_path, monkeypatch):
    """Boards that restart when they are opened answer after seconds."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path))
    store_board(BOARD_ID, "elbow", KEY, "")
    with FakeBoard() as board:
        board.reboot(seconds=1.0)
        data = run("ports", "--port", board.url, "--seconds", "0.1", "--json")
    assert data["samples"] > 0


@pytest.mark.parametrize(("query", "warnings"), [("?key=none", 1), ("", 0)])
def test_port_without_a_key_is_read_with_a_warning(capsys, tmp_path, monkeypatch, query, warnings):
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path))
    with FakeBoard(key=KEY if not query else bytes(16)) as board:
        store_board(BOARD_ID, "elbow", KEY, "")
        run_command(["board", "ports", "--port", board.url + query, "--seconds", "1"])
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith("warning: ") for line in lines) == warnings


@pytest.mark.parametrize("words", [["reference", "--known", "2200"], ["check", str(BAR)]])
def test_all_commands_warn_of_ports_without_a_key(capsys, words):
    with pytest.raises(DefsenseError):  # not a port, or the device is not built
        run_command(["board", *words, "--port", "udp://127.0.0.1:0?key=none"])
    assert capsys.readouterr().err.startswith("warning: ")


@pytest.mark.parametrize("seconds", ["0", "-1", "nan"])
def test_invalid_duration_is_refused(seconds):
    with raises(DefsenseError, "out-of-range") as caught:
        run_command(["board", "ports", "--port", "twin", "--seconds", seconds])
    assert caught.value.where == "--seconds"


def test_reference_resistors_are_measured(run):
    data = run("reference", "--port", "twin", "--known", "2500", "--json")
    assert 1500 < min(data["reference"]) < 3500
    assert "--reference" in run("reference", "--port", "twin", "--known", "2500")


@pytest.fixture
def built(tmp_path):
    """Return a function that makes a device whose build has a number of cords."""

    def make(cords, readout=""):
        folder = tmp_path / "device"
        shutil.copytree(BAR, folder, ignore=shutil.ignore_patterns("build"))
        with (folder / "device.toml").open("a", encoding="utf-8") as file:
            file.write(f"\n[readout]\n{readout}\n")
        (folder / "build" / "parts").mkdir(parents=True)
        typed_json.save(folder / "build" / MANIFEST, manifest_of(cords)[1])
        return folder

    return make


def test_wiring_of_a_built_device_is_written(run, built, tmp_path):
    folder = built(3)
    data = run("wiring", folder, "--json")
    assert (data["board"], data["converter"]) == ("nano", "arduino")
    assert [c["pin"] for c in data["channels"]] == ["A0", "A1", "A2"]
    names = {"wiring.svg", "wireviz.yml"}
    assert {p.name for p in (folder / "wiring").iterdir()} == names
    text = run("wiring", folder, "--board", "esp32", "--converter", "ads1115", "--out", tmp_path)
    assert "ADS1115 1, A2" in text
    assert "GPIO22 (SCL)" in text
    assert all((tmp_path / name).is_file() for name in names)
    assert [c["module"] for c in data["channels"]] == [None] * 3


def test_wiring_follows_the_file_of_the_device(run, built):
    data = run("wiring", built(1, 'board = "pico"'), "--json")
    assert (data["board"], data["converter"]) == ("pico", "pico")


def test_wiring_that_is_not_possible_is_refused_without_files(built):
    folder = built(4)
    for words, code in (
        (["--board", "pico"], "too-many-cords"),
        (["--board", "pico", "--converter", "esp32"], "converter-not-on-board"),
    ):
        with raises(DeviceError, code):
            run_command(["board", "wiring", str(folder), *words])
    shutil.rmtree(folder / "build")
    with raises(CaptureError, "not-built"):
        run_command(["board", "wiring", str(folder)])
    assert not (folder / "wiring").exists()


def test_too_many_cords_for_a_board_are_a_note_of_the_build():
    device, manifest = manifest_of(9)
    wiring, notes = plan_if_possible(device, manifest)
    assert wiring is None
    assert len(notes) == 1
    assert plan_if_possible(replace(device, converter="ads1115"), manifest)[1] == ()


@pytest.mark.parametrize("url", ["udp://127.0.0.1", "tcp://elbow"])
def test_firmware_is_not_written_over_a_network(url):
    with raises(CaptureError, "port-not-serial"):
        run_command(["board", "flash", "--port", url, "--yes", "--force"])


@pytest.fixture
def silent_port(monkeypatch):
    """Return the port of a board on which nothing answers."""
    board, port = os.openpty()
    monkeypatch.setattr(greeting, "GREETING_TIMEOUT_S", 0.2)
    yield os.ttyname(port)
    os.close(board)
    os.close(port)


def test_another_program_is_replaced_only_on_request(silent_port):
    with raises(CaptureError, "replacement-not-confirmed", port=silent_port):
        run_command(["board", "flash", "--port", silent_port, "--json"])


def test_silent_boot_loader_is_reported(silent_port, monkeypatch):
    for name in ("SYNC_TIMEOUT_S", "DTR_OFF_S"):
        monkeypatch.setattr(stk500, name, 0.01)
    with raises(CaptureError, "boot-loader-silent"):
        run_command(["board", "flash", "--port", silent_port, "--yes"])


def test_interrupted_flash_states_what_is_kept(silent_port, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(flash, "write_flash", interrupt)
    assert main(["board", "flash", "--port", silent_port, "--yes"]) == STOPPED
    assert "boot loader" in capsys.readouterr().err


def test_port_in_use_is_not_written(silent_port):
    with serial.Serial(silent_port, exclusive=True), raises(CaptureError, "port-busy"):
        run_command(["board", "flash", "--port", silent_port, "--yes"])
