"""Live samples of a sensor that is no device: lines of text, and decoding with gaps."""

from __future__ import annotations

import io
import time

import numpy as np
import pytest

from defsense_fab.capture.readout.source import Event, RecordingEnd, StampedSample
from defsense_fab.core.errors import LiveError
from defsense_fab.decoding.quantities import Readings
from defsense_fab.runtime.frames.fixed_decoder import FixedDecoder, target_values
from defsense_fab.runtime.frames.live_decoder import Reading
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.live.live_loop import LiveLoop, Receivers
from defsense_fab.runtime.outputs.osc_output import encode_message, frame_messages
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.recordings.table_dataset import table_dataset
from defsense_fab.workflow.run.target_sources import TextLines, open_target_source
from tests.runtime.live.test_live_loop import Kept
from tests.support.errors import raises
from tests.training.recordings.tables import ohms, write_pair

OHM = Readings(("ohm", "ohm"), np.array([1.0, 1.0]), np.array([1.0, 1.0]), "")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    signals, targets = write_pair(tmp_path_factory.mktemp("tables"), seconds=40)
    return train(table_dataset([signals], [targets]), TrainOptions(memory=False)).model


def read_all(source: TextLines) -> list[StampedSample]:
    items, end = [], time.monotonic() + 120
    while time.monotonic() < end:
        try:
            items += source.drain()
        except RecordingEnd:
            return items
        time.sleep(0.005)
    raise AssertionError("the text does not end")


def test_lines_of_text_are_samples_in_the_order_of_the_channels():
    text = "time_ms,b_kohm,extra,a_ohm\n100,2,0,3\n\nnot a sample\n200,,0,x\n300,4,0,5\n"
    source = TextLines(io.StringIO(text), ("a", "b"), OHM)
    assert source.start().channels == 2
    items = read_all(source)
    assert [item.device_us for item in items] == [100_000, 200_000, 300_000]
    values = np.array([item.sample.counts for item in items])
    np.testing.assert_array_equal(values, [[3, 2000], [np.nan, np.nan], [5, 4000]])
    assert source.statistics.bad == 1


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "header-missing"),
        ("time,a_ohm\n", "channels-differ"),
        ("a_pF,b_pF\n", "units-differ"),
        ("a,b\n", "units-differ"),
    ],
)
def test_texts_without_the_channels_are_refused(text, code):
    with raises(LiveError, code):
        TextLines(io.StringIO(text), ("a", "b"), OHM).start()


def test_lines_that_are_no_samples_are_reported():
    source, events = TextLines(io.StringIO("a_ohm,b_ohm\n1\n2,3\nend\n"), ("a", "b"), OHM), []
    source.sink = events.append
    source.start()
    read_all(source)
    reports = [e.data for e in events if isinstance(e, Event)]
    assert reports == [{"line": "1", "count": 1}]
    assert source.statistics.bad == 2


def test_all_lines_are_decoded_however_fast_they_come(model):
    times = np.arange(0, 40, 0.02)
    rows = (f"{t:.2f},{a:.6f},{b:.6f}" for t, (a, b) in zip(times, ohms(times, 0), strict=True))
    text = "\n".join([f"time,{','.join(f'{n}_ohm' for n in model.channels)}", *rows])
    source, kept = TextLines(io.StringIO(text), model.channels, model.readings), Kept()
    loop = LiveLoop(
        source,
        FixedDecoder(model, model.readings),
        model.channels,
        None,
        receivers=Receivers(every=[kept]),
        decodes_all=True,
    )
    loop.start()
    with pytest.raises(RecordingEnd):
        loop.wait(60)
    loop.close()
    assert [f.time for f in kept.frames] == pytest.approx(times)
    assert loop.status.skipped == 0


def test_a_clock_that_goes_back_restarts_the_decoder(model):
    decoder, fresh = (FixedDecoder(model, model.readings) for _ in range(2))
    times = np.arange(0, 2, 0.02)
    values = ohms(times, 0)
    for t, v in zip(times, values, strict=True):
        decoder(Reading(10 + float(t), v, 0.0))
    assert decoder(Reading(11.9, values[0], 0.0)) is None  # late by less than a restart
    again, first = (d(Reading(0.0, values[0], 0.0)) for d in (decoder, fresh))
    np.testing.assert_array_equal(again.markers, first.markers)
    assert "clock-restarted" in [note.code for note in again.notes]
    assert first.notes == ()


def test_boards_give_ohm_only():
    counts = Readings(("counts",), np.ones(1), np.ones(1), "")
    assert open_target_source("/dev/ttyUSB0", None, ("a", "b"), OHM) is None
    with raises(LiveError, "units-differ", units=("counts",)):
        open_target_source("/dev/ttyUSB0", None, ("a",), counts)


def test_samples_with_gaps_are_decoded_without_the_channel_or_repeated(model):
    decoder = FixedDecoder(model, model.readings)
    times = np.arange(0, 4, 0.04)
    values = ohms(times, 0)
    expected = model.decode(times, model.readings.signals(values), times).points
    values[50, 0] = np.nan
    values[60] = np.nan
    frames = [decoder(Reading(float(t), v, 0.0)) for t, v in zip(times, values, strict=True)]
    np.testing.assert_allclose(frames[40].markers, expected[40], rtol=1e-9)
    assert frames[49].quality is Quality.TRUSTED
    assert (frames[50].quality, frames[50].lost_channel) == (Quality.FALLBACK, "a")
    assert np.isfinite(frames[50].markers).all()
    assert frames[60].quality is Quality.LOST
    np.testing.assert_array_equal(frames[60].markers, frames[59].markers)
    assert frames[61].quality is Quality.TRUSTED
    assert decoder(Reading(float(times[-1]), values[-1], 0.0)) is None
    with raises(LiveError, "channels-differ", count=1):
        decoder(Reading(9.0, np.ones(1), 0.0))


def test_outputs_name_targets_with_their_units(model):
    decoder = FixedDecoder(model, model.readings)
    frame = decoder(Reading(0.0, ohms(np.zeros(1), 0)[0], 0.0))
    values = target_values(frame)
    assert set(values) == {"angle", "force"}
    assert values["angle"]["unit"] == "deg"
    assert values["angle"]["half_width"] == pytest.approx(frame.radius[0], abs=1e-6)
    x, width = float(frame.markers[0, 0]), float(frame.radius[0])
    message = encode_message(f"/defsense/{model.device}/target/angle", x, width, "deg")
    assert message in frame_messages(frame, frozenset({"markers"}))


def test_streams_name_targets_with_their_units(model):
    pytest.importorskip("pylsl")
    from defsense_fab.runtime.outputs.lsl_output import channel_values

    frame = FixedDecoder(model, model.readings)(Reading(0.0, ohms(np.zeros(1), 0)[0], 0.0))
    channels, numbers = channel_values(frame, ("markers",))
    assert channels == [("angle_deg", "deg", "target"), ("force_N", "N", "target")]
    assert numbers == frame.markers.ravel().tolist()
