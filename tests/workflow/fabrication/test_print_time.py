"""The estimated time to print the parts of a device."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device import FabricationSpec
from defsense_fab.core.device.device_file import load_device, parse_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.store.printed_pieces import PrintedPiece
from defsense_fab.workflow.fabrication.print_time import (
    LAYER_S,
    pieces_on_plate,
    print_hours,
)
from defsense_fab.workflow.fabrication.printing import print_advice
from tests.report.guide.blocks import blocks
from tests.support.errors import raises
from tests.support.places import BAR

SPEC = FabricationSpec("fdm-tpu", 0.2, 1.2, 20.0, (220.0, 220.0, 250.0), layer=0.25, rate=2.0)


def test_the_time_is_that_of_the_volume_and_of_each_layer():
    pieces = [PrintedPiece(7200.0, 10.0), PrintedPiece(0.0, 0.3)]
    assert print_hours(SPEC, pieces) == pytest.approx(1 + (40 + 2) * LAYER_S / 3600)
    faster = print_hours(replace(SPEC, rate=4.0), pieces)
    assert faster == pytest.approx(0.5 + (40 + 2) * LAYER_S / 3600)
    assert print_hours(SPEC, []) == 0


@pytest.mark.parametrize("changes", [{"rate": None}, {"kind": "cast"}])
def test_other_processes_have_no_estimate(changes):
    assert print_hours(replace(SPEC, **changes), [PrintedPiece(1000.0, 1.0)]) is None


def test_every_row_that_extrudes_soft_filament_has_a_rate_and_its_source():
    for row in read_rows("printers.csv").values():
        is_filament = row["name"].startswith("fdm")
        assert bool(row["rate"]) == is_filament
        if is_filament:
            assert "rate:" in row["source"]
            speed = float(row["rate"]) / (float(row["line"]) * float(row["layer"]))
            assert 15 <= speed <= 30  # mm/s, of soft filament


def test_the_advised_speed_is_that_of_the_rate():
    device = load_device(BAR)
    spec = replace(device.fabrication, line=0.5, layer=0.2, rate=1.5)
    advice = " ".join(print_advice(replace(device, fabrication=spec), {}))
    assert "15 mm/s" in advice
    assert "1.5 mm3/s" in advice


def test_a_device_may_state_its_rate():
    text = (BAR / "device.toml").read_text("utf-8")
    process = 'process = "fdm-tpu"'
    assert load_device(BAR).fabrication.rate == 2.0
    faster = parse_device(text.replace(process, f"{process}\nrate = 3.5"), BAR)
    assert faster.fabrication.rate == 3.5
    with raises(DeviceError, "out-of-range"):
        parse_device(text.replace(process, f"{process}\nrate = 0"), BAR)


def test_a_plate_has_all_its_pieces():
    manifest = blocks(1, 2).manifest
    (plate,) = manifest.plates
    pin = manifest.pins[0]
    bounds = np.array([[0.0, 0, 0], [5, 5, pin.length]])
    plate = replace(plate, parts={**plate.parts, f"{pin.name}_1": bounds})
    pieces = pieces_on_plate(manifest, plate)
    assert len(pieces) == len(manifest.parts) + 1
    assert sum(p.volume for p in pieces[:-1]) == pytest.approx(manifest.body_volume)
    assert pieces[-1].volume == pytest.approx(np.pi / 4 * pin.diameter**2 * pin.length)
    assert pieces[-1].height == pin.length
