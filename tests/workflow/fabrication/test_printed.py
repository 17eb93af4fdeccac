"""What a maker should know about printed traces."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import parse_device
from defsense_fab.sensing.built_cord import BuiltCord, CordReading
from defsense_fab.store.traces import TraceRecord
from defsense_fab.workflow.fabrication.printed import printing_notes, trace_warming
from tests.support.places import BAR

LINE = np.linspace([10.0, 0, 0], [130, 0, 0], 41)


def printed(**cord):
    text = (BAR / "device.toml").read_text("utf-8")
    values = "".join(f"{key} = {value}\n" for key, value in cord.items())
    table = f'[cord]\nprocess = "printed"\ntrace = "eel"\n{values}\n'
    text = text[: text.index("[cord]")] + table
    text += '[fabrication]\nprocess = "fdm-tpu"\n\n[design]\nsensors = 1\n'
    return parse_device(text, BAR)


def record_of(device, line):
    ohm = CordReading.from_device(device).resistance(BuiltCord(line, 0.0, None))
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    return TraceRecord("a", "a.stl", line, line[[0, -1]], 100.0, length, ohm, (ohm, ohm), ohm)


def warming_notes(device, line):
    return [note for note in printing_notes(device, (record_of(device, line),)) if "warms" in note]


def test_the_readout_does_not_warm_traces_of_kilohms():
    """A level trace of 120 mm and 15 kohm, by the law of a hollow cylinder in W, m and K."""
    device = printed()
    record = record_of(device, LINE)
    power = 2.5**2 / 15_000 / 0.12
    inner, wall = np.sqrt(0.96e-6 / np.pi), 1e-3 * device.fabrication.wall
    conduction = np.log(1 + wall / inner) / (2 * np.pi * 0.19)
    radiation = 1 / (2 * np.pi * (inner + wall) * 5.135)
    assert trace_warming(device, record) == pytest.approx(
        power * (conduction + radiation), rel=1e-3
    )
    assert trace_warming(device, record) == pytest.approx(0.065, abs=0.005)
    assert warming_notes(device, LINE) == []


def test_a_trace_that_conducts_well_is_warmed_and_named():
    device = printed(resistivity=5.0)
    (note,) = warming_notes(device, LINE)
    assert "trace a" in note
    assert warming_notes(device, np.concatenate([LINE, 10 * LINE[::-1]])) == []  # longer


def test_a_steep_part_is_the_warmest():
    device = printed()
    steep = np.concatenate([LINE, LINE[-1] + np.linspace([0.0, 0, 1], [0, 0, 10], 10)])
    level = record_of(device, LINE)
    same = replace(record_of(device, steep), resistance=level.resistance)
    assert trace_warming(device, same) > 1.5 * trace_warming(device, level)
