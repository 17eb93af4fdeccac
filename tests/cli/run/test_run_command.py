"""The command `defsense run`, from start to end."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.capture.readout.recording import Recorder
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.cli.main import main
from defsense_fab.cli.run.run import own_file, own_folder
from defsense_fab.cli.terminal.live_lines import LiveLines
from defsense_fab.core.errors import ControlError, LiveError, StorageError
from defsense_fab.runtime.live.run_files import Animations
from defsense_fab.runtime.recording.animation_recorder import AnimationRecorder
from defsense_fab.sensing.serial_frames import Sample
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.training.fitting.model_file import load_model, write_model
from defsense_fab.workflow.run import sources
from defsense_fab.workflow.run.live_device import live_device
from defsense_fab.workflow.run.options import RunOptions
from defsense_fab.workflow.run.outputs import read_settings
from defsense_fab.workflow.run.run import connect_panel, panel_actions, prepare_run
from tests.capture.readout.fake_board import BOARD_ID, FakeBoard
from tests.runtime.live.conftest import R0
from tests.runtime.live.test_live_loop import board_of
from tests.support.errors import raises

REFERENCE = np.array([1500.0, 1000.0])
KNOWN = ["--rest", "1500,900", "--reference", "1500,1000"]
ABOUT = {
    "protocol": 1, "version": [1, 0], "converter": 0, "channels": 2, "averages": 64, "rate": 50,
    "led_period": 0, "most_channels": 8, "full_scale": 1024,
}  # fmt: skip


def recorded(path, seconds):
    """Write a recording of the device at rest."""
    sums = tuple(round(64 * c) for c in Dividers(REFERENCE, 1024.0).counts(R0))
    with Recorder(path, 2) as recorder:
        recorder.add(Event(0, "start", ABOUT))
        for k in range(round(50 * seconds)):
            sample = Sample(k, 20_000 * k, False, False, 64, sums)
            recorder.add(StampedSample(20_000_000 * k, 20_000 * k, sample))
    return path


@pytest.fixture
def device(live_bar, tmp_path):
    """Copy the device to a folder that runs may write to."""
    folder = tmp_path / "device"
    shutil.copytree(live_bar.folder, folder)
    return folder


def run(*arguments):
    return main(["run", *map(str, arguments)])


def lines(text, first):
    return [line for line in text.splitlines() if line.startswith(first)]


def test_end_of_a_recording_is_normal(device, tmp_path, capsys):
    board, out = recorded(tmp_path / "board.csv", 2.0), tmp_path / "a.npz"
    assert run(device, "--port", f"replay:{board}", "--animation", out, *KNOWN) == 0
    output = capsys.readouterr()
    assert "error:" not in output.err
    (line,) = lines(output.out, "Wrote:")
    assert line.startswith(f"Wrote:   {out}: ")
    assert any(line.startswith(f"bar: ended: {board}: ") for line in output.out.splitlines())
    assert len(np.load(out)["times"]) > 0


def test_json_lists_files_and_messages_go_to_standard_error(device, tmp_path, capsys):
    board, out = recorded(tmp_path / "board.csv", 2.0), tmp_path / "a.npz"
    arguments = ("--port", f"replay:{board}", "--animation", out, "--json", *KNOWN)
    assert run(device, *arguments, "--output", "websocket,port=0,host=0.0.0.0") == 0
    output = capsys.readouterr()
    rows = [json.loads(line) for line in output.out.splitlines()]
    assert rows[-1]["wrote"] == str(out)
    assert rows[-1]["instead"] is None
    assert rows[-2]["ended"].startswith(f"{board}: ")
    assert "?token=" in output.err
    assert any(line.startswith(f"Record:  {out} ") for line in output.err.splitlines())


def test_animation_that_cannot_be_written_is_an_error(device, tmp_path, capsys, monkeypatch):
    def full(self, path=None):
        raise StorageError("the disk is full", code="disk-full", where=path)

    monkeypatch.setattr(AnimationRecorder, "finish", full)
    board, out = recorded(tmp_path / "board.csv", 2.0), tmp_path / "a.npz"
    for more in ((), ("--json",)):
        arguments = ("--port", f"replay:{board}", "--animation", out, *KNOWN, *more)
        assert run(device, *arguments) == 2
        (line,) = lines(capsys.readouterr().err, "error: ")
        assert f"{out}: the disk is full" in line
        assert f"{device}/live/" in line


def test_animation_is_written_after_a_failed_run(device, tmp_path, capsys, monkeypatch):
    from defsense_fab.core.errors import CaptureError

    def fail(self, seconds):
        while self._all[0].run.animations.is_empty:
            time.sleep(0.01)
        raise CaptureError("is disconnected", code="port-disconnected", where="COM3")

    monkeypatch.setattr(LiveLines, "follow", fail)
    board, out = recorded(tmp_path / "board.csv", 60.0), tmp_path / "a.npz"
    assert run(device, "--port", f"replay:{board}", "--animation", out, *KNOWN) == 2
    output = capsys.readouterr()
    assert lines(output.err, "error: ") == ["error: COM3: is disconnected"]
    assert lines(output.out, "Wrote:")
    assert out.exists()


def test_second_ctrl_c_loses_nothing(device, tmp_path, capsys, monkeypatch, live_bar):
    """The first ends the run; further ones arrive while the animation is written."""
    board, _, _ = board_of(live_bar)
    monkeypatch.setattr(sources, "open_port", lambda url: board())
    show, write = LiveLines._show, Animations.finish
    over = []

    def shown(self, new):
        show(self, new)
        if not self._all[0].run.animations.is_empty:
            over.append(self._all[0].run.recording)
            os.kill(os.getpid(), signal.SIGINT)

    def written(self):
        os.kill(os.getpid(), signal.SIGINT)
        over.append(over[0].is_closed)  # the readings are closed before slow files
        return write(self)

    monkeypatch.setattr(LiveLines, "_show", shown)
    monkeypatch.setattr(Animations, "finish", written)
    out = tmp_path / "a.npz"
    handler = signal.getsignal(signal.SIGINT)
    assert run(device, "--port", "COM3", "--animation", out, *KNOWN) == 0
    assert signal.getsignal(signal.SIGINT) is handler
    assert over[1:] == [True]
    output = capsys.readouterr()
    assert f"writing {out}" in output.err
    assert lines(output.out, f"Wrote:   {out}: ")
    assert out.exists()
    assert len(list(device.glob("live/*/board.csv"))) == 1


def test_run_that_fails_to_start_leaves_nothing(device, tmp_path, capsys):
    assert run(device, "--port", "/dev/nowhere", "--animation", tmp_path / "a.npz", *KNOWN) == 2
    (line,) = lines(capsys.readouterr().err, "error: ")
    assert "/dev/nowhere" in line
    assert not (device / "live").exists()
    assert not (tmp_path / "a.npz").exists()


@pytest.mark.slow
def test_closed_standard_output_is_not_an_error(device, tmp_path):
    board = recorded(tmp_path / "board.csv", 60.0)
    arguments = ["run", device, "--port", f"replay:{board}", "--json", *KNOWN]
    program = "import sys; from defsense_fab.cli.main import main; sys.exit(main(sys.argv[1:]))"
    with subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert json.loads(process.stdout.readline())["port"] == f"replay:{board}"
        process.stdout.close()
        errors = process.stderr.read()
        assert process.wait(200) == 0
    assert "error" not in errors.lower()
    assert "Traceback" not in errors


def test_invalid_controls_are_reported(device, tmp_path):
    (device / "live.toml").write_text('[controls]\nup = "nothing_such + 1"\n')
    board = recorded(tmp_path / "board.csv", 2.0)
    port, settings = f"replay:{board}", read_settings(device)
    with raises(ControlError, "unknown-name", control="up"):
        prepare_run(live_device(device / "model.json", device), port, settings=settings)
    alone = tmp_path / "alone" / "model.json"
    alone.parent.mkdir()
    shutil.copy(device / "model.json", alone)
    with raises(LiveError, "not-built"):
        prepare_run(live_device(alone), port, settings=settings)


def test_a_useless_model_is_noted_at_the_start(device, tmp_path):
    path = device / "model.json"
    model = load_model(path)
    judgment = {"code": "useless-model", "message": "the model is useless.", "error": 9.0}
    write_model(path, replace(model, metadata={**model.metadata, "usefulness": judgment}))
    board = recorded(tmp_path / "board.csv", 2.0)
    options = RunOptions(reference=tuple(REFERENCE), rest=tuple(R0))
    live = prepare_run(live_device(path, device), f"replay:{board}", options)
    live.close()
    assert live.notes[0].code == "useless-model"
    assert str(live.notes[0]) == judgment["message"]
    assert live.notes[0].data["error"] == 9.0


def test_button_controls_the_recording_of_the_flag(device, tmp_path):
    """The panel shows notes and latency of the loop."""
    board, out = recorded(tmp_path / "board.csv", 2.0), tmp_path / "a.npz"
    options = RunOptions(reference=tuple(REFERENCE), rest=tuple(R0), animation=out)
    live = prepare_run(live_device(device / "model.json", device), f"replay:{board}", options)
    actions = panel_actions(live.loop.decoder, live.animations, None)
    assert actions.is_recording()
    with raises(LiveError, "recording-active"):
        live.animations.start(tmp_path / "b.npz")
    live.animations.discard()
    assert not actions.is_recording()
    connect_panel(actions, live.loop)
    assert actions.latency() == ""
    assert tuple(actions.notes()) == live.loop.status.notes
    live.close()


@pytest.mark.parametrize(
    ("path", "folder"),
    [(".", "2"), ("..", "../2"), ("/", "/2"), ("rec", "rec-2"), ("a/rec.v1", "a/rec.v1-2")],
)
def test_each_device_has_its_own_folder(path, folder):
    assert own_folder(Path(path), 0) == Path(path)
    assert own_folder(Path(path), 1) == Path(folder)
    assert own_folder(None, 1) is None


def test_each_device_has_its_own_file():
    assert own_file(Path("a/x.glb"), 0) == Path("a/x.glb")
    assert own_file(Path("a/x.glb"), 2) == Path("a/x-3.glb")
    assert own_file(Path("."), 1) == Path("-2")


def test_board_with_wifi_is_run(device, tmp_path, capsys, monkeypatch):
    """Its packets are counted, the recording names the board, and a port without a key is noted."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))
    with FakeBoard(key=bytes(16)) as board:
        out = tmp_path / "live"
        words = ("--port", f"{board.url}?key=none", "--record", out, "--json", "--seconds", "3")
        assert run(device, *words, *KNOWN) == 0
    output = capsys.readouterr()
    rows = [json.loads(line) for line in output.out.splitlines()]
    assert rows[-1 if "network" in rows[-1] else -2]["network"]["rejected"] == 0
    assert any("?key=none" in line for line in lines(output.err, "note: "))
    (start,) = [line for line in (out / "board.csv").read_text().splitlines() if "start" in line]
    assert json.loads(start[1:])["board_id"] == BOARD_ID
