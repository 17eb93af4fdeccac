"""Streams are received by an inlet of the Lab Streaming Layer on the same machine."""

import uuid

import numpy as np
import pylsl
import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs import lsl_output
from defsense_fab.runtime.outputs.lsl_output import LslOutput, SampleClock, channel_values
from defsense_fab.runtime.outputs.settings import LslSettings
from tests.runtime.live_frames import frame, frame_before_rest
from tests.support.errors import raises


def test_stream_arrives():
    """Channels arrive with names and units, values, and the times of the samples."""
    name = f"bar {uuid.uuid4().hex[:8]}"
    output = LslOutput(LslSettings(stream=name))
    assert output.channels == ()
    output.send(frame(0))
    assert len(output.channels) == 3
    (info,) = pylsl.resolve_byprop("name", name, 1, 20)
    inlet = pylsl.StreamInlet(info, recover=False)
    inlet.open_stream(20)
    before = pylsl.local_clock()
    output.send(frame(1, quality=Quality.FALLBACK))
    values, stamp = inlet.pull_sample(20)
    assert values == [0.25, -0.5, 1.0]
    assert abs(stamp - before) < 20
    found = inlet.info(20)
    assert found.type() == "Deformation"
    channel, rows = found.desc().child("channels").child("channel"), []
    for _ in range(3):
        rows.append(tuple(channel.child_value(k) for k in ("label", "unit", "type")))
        channel = channel.next_sibling()
    assert rows == [
        ("bend", "normalized", "control"),
        ("twist", "normalized", "control"),
        ("quality", "level", "quality"),
    ]
    assert found.desc().child_value("device") == "bar"
    inlet.close_stream()
    output.close()


def test_library_prints_only_errors(monkeypatch, tmp_path):
    """A configuration of the library takes precedence."""
    set_to = []
    monkeypatch.setattr(pylsl.util, "set_config_content", set_to.append)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LSLAPICFG", raising=False)
    lsl_output.silence_warnings()
    assert set_to == ["[log]\nlevel = -2\n"]
    (tmp_path / "lsl_api.cfg").touch()
    lsl_output.silence_warnings()
    assert len(set_to) == 1


def test_all_channels():
    channels, values = channel_values(frame(1, count=2), LslSettings.SENDS)
    assert [c[0] for c in channels] == [
        "bend", "twist", "bend.confidence", "twist.confidence", "a", "b",
        "0.x", "0.y", "0.z", "1.x", "1.y", "1.z", "quality",
    ]  # fmt: skip
    assert len(values) == len(channels)
    assert channels[6][1:] == ("millimeters", "PositionX")


def test_times_of_samples_are_smooth():
    """Late arrivals do not change the times, which never decrease."""
    rng, clock = np.random.default_rng(0), SampleClock()
    sampled = 0.01 * np.arange(3000)
    late = 0.002 + rng.exponential(0.01, 3000)
    got = np.array([clock(s, s + 500 + d) for s, d in zip(sampled, late, strict=True)])
    off = got - (sampled + 500)
    assert (np.diff(got) >= 0).all()
    assert off[500:] == pytest.approx(0.002, abs=1e-3)
    assert off.std() < 0.2 * late.std()


def test_clock_that_drifts_or_is_reset():
    clock = SampleClock()
    sampled = 0.01 * np.arange(10_000)
    got = [clock(s, s * 1.0001 + 3) for s in sampled]
    assert got[-1] == pytest.approx(sampled[-1] * 1.0001 + 3, abs=0.005)
    end = sampled[-1] * 1.0001 + 3
    again = [clock(s, end + 1 + s) for s in sampled[:100]]
    assert again == pytest.approx(end + 1 + sampled[:100])


def test_stream_restarts_when_its_channels_change():
    output = LslOutput(LslSettings(stream=uuid.uuid4().hex))
    output.send(frame(1))
    output.send(frame(2, controls={"bend": 1.0}))
    assert len(output.channels) == 2
    output.send(frame(3, time=float("nan"), controls={"bend": float("nan")}))
    output.close()


def test_stream_starts_with_its_controls():
    """Receivers would lose a stream that restarts."""
    output = LslOutput(LslSettings(stream=uuid.uuid4().hex))
    output.send(frame_before_rest(1))
    assert not output.channels
    output.send(frame(2, quality=Quality.LOST))
    assert len(output.channels) == 3
    output.close()


def test_stream_of_a_device_without_poses():
    """It never has controls."""
    name = uuid.uuid4().hex
    output = LslOutput(LslSettings(stream=name, send=("controls", "markers", "quality")))
    output.send(frame_before_rest(1))
    assert not output.channels
    output.send(frame_before_rest(2, quality=Quality.UNTRAINED))
    output.send(frame_before_rest(3))
    assert len(output.channels) == 10
    output.close()


def test_stream_without_controls_starts_at_once():
    output = LslOutput(LslSettings(stream=uuid.uuid4().hex, send=("signals", "quality")))
    output.send(frame_before_rest(1))
    assert len(output.channels) == 3
    output.close()


def test_stream_without_channels_is_refused():
    output = LslOutput(LslSettings(send=("controls", "confidence")))
    with raises(OutputError, "nothing-to-send", send=("controls", "confidence")):
        output.send(frame_before_rest(1, quality=Quality.TRUSTED))
