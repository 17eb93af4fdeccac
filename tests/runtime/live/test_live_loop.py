"""The loop from a simulated read-out board to its outputs."""

import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.source import RecordingEnd
from defsense_fab.core.errors import LiveError
from defsense_fab.runtime.frames.live_decoder import LiveDecoder
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.live.live_loop import LiveLoop, Receivers
from defsense_fab.training.data.dataset import Dataset
from defsense_fab.twin.electronics.cords import CUT, CordFault, ReplayedCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.workflow.run.live_device import live_device
from defsense_fab.workflow.run.run import prepare_run
from tests.runtime.live.conftest import NAMES, moved
from tests.support.errors import raises

SPEED = 4.0


class Kept:
    """An output that keeps its frames."""

    name, trouble, news = "kept", None, None

    def __init__(self):
        self.frames, self.closed = [], False
        self._some = threading.Condition()

    def send(self, frame):
        with self._some:
            self.frames.append(frame)
            self._some.notify()

    def until(self, condition, seconds=240.0):
        with self._some:
            assert self._some.wait_for(lambda: any(condition(f) for f in self.frames), seconds), (
                f"{len(self.frames)} frames, none as expected"
            )

    def close(self):
        self.closed = True


def board_of(live_bar, seconds=40.0, faults=(), kind=ReadoutTwin):
    """Return a function that opens a board, its recording and the true levels."""
    run, levels = live_bar.run(seconds, seed=3)
    cords = ReplayedCords(NAMES, run.sample_time, run.ohm, faults)
    reference = np.array([1500.0, 1000.0])
    return partial(kind, cords, reference, speed=SPEED, converter="ads1115"), run, levels


def loop_of(live_bar, board, outputs, recorder=None):
    device = live_device(live_bar.model)
    source = Reader(board, "twin", ReadoutSettings(channels=2, rate=100))
    decoder = LiveDecoder(device.model, None, device.trained_rest)
    receivers = Receivers(outputs, recorder=recorder)
    return LiveLoop(source, decoder, device.board_channels, device.reference, receivers=receivers)


@pytest.mark.slow
def test_frames_with_marker_positions_reach_outputs(live_bar):
    board, run, levels = board_of(live_bar)
    out = Kept()
    loop = loop_of(live_bar, board, [out])
    info = loop.start()
    assert info.channels == 2
    out.until(lambda f: f.time > 25)
    loop.close()
    assert out.closed
    late = [f for f in out.frames if f.time > 12]
    assert {f.quality for f in late} <= {Quality.TRUSTED, Quality.UNTRAINED}
    off = []
    for f in late:
        now = [np.interp(f.time, run.sample_time, x) for x in levels.T]
        true = live_bar.rest_points + moved(live_bar.rest_points, *now)
        off.append(np.linalg.norm(f.markers - true, axis=1))
    assert np.sqrt(np.mean(np.square(off))) < 1.5
    status = loop.status
    assert status.samples >= len(out.frames)
    assert np.isfinite(status.output_latency).all()


@pytest.mark.slow
def test_cut_cord_is_reported_while_the_loop_continues(live_bar):
    board = board_of(live_bar, faults=(CordFault(CUT, (0,), 8.0, 12.0),))[0]
    out = Kept()
    loop = loop_of(live_bar, board, [out])
    loop.start()
    out.until(lambda f: f.quality is not Quality.LOST)
    out.until(lambda f: f.lost_channel == "cord_1" and f.quality is Quality.FALLBACK)
    out.until(lambda f: f.time > 14 and f.lost_channel is None)
    loop.close()


class Gone(ReadoutTwin):
    """A board whose port disappears once, after some samples."""

    gone, received = False, 0  # whether it has disappeared; bytes

    def read(self, size):
        if self.received > 5000 and not Gone.gone:
            Gone.gone = True
            raise OSError("unplugged")
        data = super().read(size)
        self.received += len(data)
        return data


def test_port_that_disappears_and_returns(live_bar):
    out, Gone.gone = Kept(), False
    loop = loop_of(live_bar, board_of(live_bar, kind=Gone)[0], [out])
    loop.start()
    # 5,000 bytes hold fewer than 1,000 samples of two channels.
    out.until(lambda f: f.number > 1000)
    assert Gone.gone
    assert loop.wait(0)
    loop.close()


def test_other_number_of_channels_is_refused(live_bar):
    device = live_device(live_bar.model)
    cords = ReplayedCords(("a",), np.array([0.0, 1.0]), np.full((2, 1), 1000.0))
    source = Reader(lambda: ReadoutTwin(cords), "twin", ReadoutSettings())
    loop = LiveLoop(source, LiveDecoder(device.model), device.board_channels, device.reference)
    with raises(LiveError, "channels-differ", count=1, expected=2):
        loop.start()


def test_recording_is_played_to_its_end(live_bar, tmp_path):
    from defsense_fab.runtime.live.run_files import RawRecording, RunFolder

    board = board_of(live_bar, seconds=10.0)[0]
    out, recording = Kept(), RawRecording(RunFolder(tmp_path / "live"), 2)
    loop = loop_of(live_bar, board, [out], recorder=recording)
    loop.start()
    out.until(lambda f: f.time > 6)
    loop.close()
    device = live_device(live_bar.model)
    run = prepare_run(device, f"replay:{recording.path}")
    run.loop.start()
    with pytest.raises(RecordingEnd):
        run.loop.wait(240.0)
    assert run.loop.status.samples > 100
    run.close()


@pytest.mark.slow
def test_session_is_played_with_its_tracks(live_bar, tmp_path, monkeypatch):
    from defsense_fab.workflow.run import sources

    run, _ = live_bar.run(8.0, 3)
    device = live_device(live_bar.model)
    ids, rest = device.model.ids, device.model.rest_points
    # Another order of channels and markers, and a marker that the model does not have.
    points = np.concatenate([run.points[:, ::-1], run.points[:, :1]], axis=1)
    points[200:260, 0] = np.nan
    recording = replace(
        run, name="s/run-1", ohm=run.ohm[:, ::-1], rest=run.rest[::-1], time=run.time + 5.0,
        sample_time=run.sample_time + 5.0, points=points, sigma=np.full(points.shape, 0.05),
    )  # fmt: skip
    dataset = Dataset(
        "bar", device.model.layout, NAMES[::-1], np.array([*ids[::-1], 900]),
        np.concatenate([rest[::-1], rest[:1]]), (recording,),
    )  # fmt: skip
    for name in ("run-1", "run-7"):
        (tmp_path / "s" / name).mkdir(parents=True)
    monkeypatch.setattr(sources, "manifest_path", lambda f: f if f.name == "s" else None)
    monkeypatch.setattr(sources, "session_dataset", lambda folder: dataset)
    out = Kept()
    play = prepare_run(device, f"replay:{tmp_path / 's'}")
    monkeypatch.setattr(play.loop, "_outputs", (out,))
    play.loop.start()
    with pytest.raises(RecordingEnd):
        play.loop.wait(240.0)
    play.close()
    one_run = prepare_run(device, f"replay:{tmp_path / 's' / 'run-1'}")
    one_run.loop.start()
    one_run.close()
    known = [f for f in out.frames if f.quality is not Quality.LOST and f.time > 4]
    assert len(known) > 50
    for frame in known:
        at = np.argmin(abs(run.time - frame.time))
        own = np.where(np.isfinite(frame.tracks), run.points[at], np.nan)
        assert np.nanmax(np.abs(frame.tracks - own)) < 0.5
        assert frame.tracking_error < 1.0
    blind = [f for f in known if run.time[205] < f.time < run.time[255]]
    assert blind
    assert all(np.isnan(f.tracks[-1]).all() for f in blind)
    with raises(LiveError, "run-not-processed", run="run-7", runs=("run-1",)):
        prepare_run(device, f"replay:{tmp_path / 's' / 'run-7'}")


def test_invalid_ports_are_refused(live_bar, tmp_path):
    device = live_device(live_bar.model)
    for port, code in (
        ("replay:/nowhere/board.csv", "file-not-found"),
        ("twin:speed=3", "unknown-twin-option"),
        ("twin:cords=string", "unknown-twin-option"),
        ("twin:minutes=900", "out-of-range"),
    ):
        with raises(LiveError, code):
            prepare_run(device, port, keeps_readings=False)


def test_full_disk_ends_the_recording_but_not_the_run(live_bar, tmp_path, monkeypatch):
    from defsense_fab.capture.readout.recording import Recorder
    from defsense_fab.core.errors import StorageError
    from defsense_fab.runtime.live.run_files import RawRecording, RunFolder

    recording = RawRecording(RunFolder(tmp_path / "live"), 2)
    board = board_of(live_bar)[0]
    out = Kept()
    loop = loop_of(live_bar, board, [out], recorder=recording)

    add = Recorder.add

    def full(recorder, item):
        if recording.wait_until_started(0):
            raise StorageError("the disk is full", code="disk-full", where=recording.path)
        add(recorder, item)

    monkeypatch.setattr(Recorder, "add", full)
    loop.start()
    out.until(lambda f: f.number > 50)
    assert "disk-full" in [note.code for note in loop.status.notes]
    loop.close()
