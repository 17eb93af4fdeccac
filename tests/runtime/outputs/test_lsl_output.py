"""The Lab Streaming Layer by its own inlet, in the same machine."""

import uuid

import numpy as np
import pylsl
import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs import lsl_output
from defsense_fab.runtime.outputs.lsl_output import LslOutput, SampleClock, sample
from defsense_fab.runtime.outputs.settings import LslSettings
from tests.errors import raises
from tests.runtime.live_frames import frame, frame_before_rest


def test_a_stream_arrives():
    """Channels with their names and units, values, and the times of the samples."""
    name = f"bar {uuid.uuid4().hex[:8]}"
    output = LslOutput(LslSettings(stream=name))
    assert output.about == "lsl: the stream begins when the resistances at rest are known"
    output.send(frame(0))
    assert output.about == f"lsl: stream {name!r} of 3 channels"
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


def test_strangers_do_not_write_to_the_terminal(monkeypatch, tmp_path):
    """Unless there is a configuration of the library, which then decides."""
    set_to = []
    monkeypatch.setattr(pylsl.util, "set_config_content", set_to.append)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LSLAPICFG", raising=False)
    lsl_output._keep_quiet()
    assert set_to == ["[log]\nlevel = -2\n"]
    (tmp_path / "lsl_api.cfg").touch()
    lsl_output._keep_quiet()
    assert len(set_to) == 1


def test_all_channels():
    channels, values = sample(frame(1, count=2), LslSettings.SENDS)
    assert [c[0] for c in channels] == [
        "bend", "twist", "bend.confidence", "twist.confidence", "a", "b",
        "0.x", "0.y", "0.z", "1.x", "1.y", "1.z", "quality",
    ]  # fmt: skip
    assert len(values) == len(channels)
    assert channels[6][1:] == ("millimeters", "PositionX")


def test_times_of_samples():
    """Late arrivals do not move the times; they never go back."""
    rng, clock = np.random.default_rng(0), SampleClock()
    sampled = 0.01 * np.arange(3000)
    late = 0.002 + rng.exponential(0.01, 3000)
    got = np.array([clock(s, s + 500 + d) for s, d in zip(sampled, late, strict=True)])
    off = got - (sampled + 500)
    assert (np.diff(got) >= 0).all()
    assert off[500:] == pytest.approx(0.002, abs=1e-3)
    assert off.std() < 0.2 * late.std()


def test_a_clock_that_drifts_or_is_reset():
    clock = SampleClock()
    sampled = 0.01 * np.arange(10_000)
    got = [clock(s, s * 1.0001 + 3) for s in sampled]
    assert got[-1] == pytest.approx(sampled[-1] * 1.0001 + 3, abs=0.005)
    end = sampled[-1] * 1.0001 + 3
    again = [clock(s, end + 1 + s) for s in sampled[:100]]
    assert again == pytest.approx(end + 1 + sampled[:100])


def test_a_stream_whose_channels_change():
    output = LslOutput(LslSettings(stream=uuid.uuid4().hex))
    output.send(frame(1))
    output.send(frame(2, controls={"bend": 1.0}))
    assert output.about.endswith("of 2 channels")
    output.send(frame(3, time=float("nan"), controls={"bend": float("nan")}))
    output.close()


def begun(output):
    return "of " in output.about


def test_a_stream_begins_with_its_controls():
    """A receiver of one that begins anew would have to look for it again."""
    output = LslOutput(LslSettings(stream=uuid.uuid4().hex))
    output.send(frame_before_rest(1))
    assert not begun(output)
    output.send(frame(2, quality=Quality.LOST))
    assert output.about.endswith("of 3 channels")
    output.close()


def test_a_stream_of_a_device_without_poses():
    """It has no controls, then or later."""
    name = uuid.uuid4().hex
    output = LslOutput(LslSettings(stream=name, send=("controls", "markers", "quality")))
    output.send(frame_before_rest(1))
    assert not begun(output)
    output.send(frame_before_rest(2, quality=Quality.UNTRAINED))
    output.send(frame_before_rest(3))
    assert output.about.endswith("of 10 channels")
    output.close()


def test_a_stream_without_controls_waits_for_nothing():
    output = LslOutput(LslSettings(stream=uuid.uuid4().hex, send=("signals", "quality")))
    output.send(frame_before_rest(1))
    assert output.about.endswith("of 3 channels")
    output.close()


def test_a_stream_of_nothing():
    output = LslOutput(LslSettings(send=("controls", "confidence")))
    with raises(OutputError, "nothing-to-send", send=("controls", "confidence")):
        output.send(frame_before_rest(1, quality=Quality.TRUSTED))
