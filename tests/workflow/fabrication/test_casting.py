"""Silicone, moulds and advice as a maker reads them."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device, parse_device
from defsense_fab.core.device.materials import default_material, find_silicone
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.geometry.moulds.records import Mould
from defsense_fab.geometry.printing.overhangs import Overhang
from defsense_fab.optimization.prediction.as_built import mould_rules
from defsense_fab.workflow.build.stages import STAGES
from defsense_fab.workflow.fabrication.casting import casting, notes
from defsense_fab.workflow.fabrication.printing import on_plates, print_advice
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.places import DEVICES

BAR = DEVICES / "bar"


def device(fabrication, material=None):
    name = "dragon-skin-30" if "cast" in fabrication else "ninjaflex-85a"
    material = material or f'name = "{name}"'
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace('process = "fdm-tpu"', fabrication)
    return parse_device(text.replace('name = "ninjaflex-85a"', material), BAR)


def mould(volume, strain=0.0):
    at = np.array([1.0, 2, 3]) if strain else None
    up, none = np.array([0, 0, 1.0]), np.zeros((0, 3))
    return Mould("1-top", (), up, np.zeros(3), none, volume, 2 * volume, strain, at, ())


def test_masses_are_those_of_the_mixtures():
    cast = device('process = "cast-silicone"\ncopies = 2')
    mixture = casting(cast, [mould(40_000.0), mould(10_000.0)])
    assert mixture.volume == 100_000
    assert mixture.mass_a == mixture.mass_b == pytest.approx(110 * 1.08 / 2)
    assert (mixture.pot_life, mixture.cure, mixture.shrinkage) == (45, 16, 0.001)
    text = " ".join(mixture.steps)
    # A mixture can be poured for less time than a cast takes: each is mixed separately.
    for amount in ("30 g of part A", "30 g of part B", "55 cm3", "2 devices", "45 min", "16 h"):
        assert amount in text
    ten = casting(device('process = "cast-silicone"', 'name = "smooth-sil-950"'), [mould(1000.0)])
    assert ten.mass_a == pytest.approx(10 * ten.mass_b)
    assert ten.mass_a + ten.mass_b == pytest.approx(1.1 * 1.24)


def test_shrinkage_is_that_of_the_device_or_of_its_silicone():
    assert mould_rules(device('process = "cast-silicone"')).shrinkage == 0.001
    given = device('process = "cast-silicone"\nshrinkage = 0.02\nmould_wall = 7')
    assert (mould_rules(given).shrinkage, mould_rules(given).wall) == (0.02, 7)
    custom = device('process = "cast-silicone"', "young_modulus = 1.0\npoisson_ratio = 0.48")
    assert mould_rules(custom).shrinkage == 0
    assert "shrinkage = 0.002" in next(iter(notes(custom, [])))
    assert "7%" in next(iter(notes(given, [mould(1.0, 0.07)])))
    assert notes(given, [mould(1.0, 0.004)]) == {}


def test_every_process_is_read_and_advises():
    for name, row in read_rows("printers.csv").items():
        printed = device(f'process = "{name}"', f'name = "{default_material(name)}"')
        advice = " ".join(print_advice(printed, {}))
        assert "support" in advice or "sealed" in advice
        assert row["source"]
        assert printed.fabrication.bed == tuple(float(row[f"bed_{c}"]) for c in "xyz")
    for name in read_rows("silicones.csv"):
        assert name in read_rows("materials.csv")
        assert find_silicone(name).shrinkage < 0.01


@pytest.mark.parametrize(
    ("process", "material", "is_advised"),
    [
        ("fdm-tpu", "tpu-85a", True),
        ("sla-elastic", "formlabs-elastic-50a", True),
        ("sls-tpu", "eos-tpu-1301", False),
        ("cast-silicone", "dragon-skin-30", True),
    ],
)
def test_advice_names_exactly_the_parts_that_need_supports(process, material, is_advised):
    printed = device(f'process = "{process}"', f'name = "{material}"')
    overhang = Overhang(468.0, 84.0, 30_000.0, np.zeros(3))
    without, advised = print_advice(printed, {}), print_advice(printed, {"3-right": overhang})
    assert not any("3-right" in sentence for sentence in without)
    named = [s for s in advised if "3-right" in s and "468 mm2" in s and "84 mm" in s]
    assert bool(named) == is_advised
    assert (advised != without) == is_advised
    assert not any("No p" in sentence for sentence in advised)


@pytest.mark.parametrize(
    ("cut_area", "face"), [(0.0, None), (468.0, "cut face"), (200.0, "skin and cut face")]
)
def test_advice_names_the_face_that_needs_supports(cut_area, face):
    printed = device('process = "fdm-tpu"', 'name = "tpu-85a"')
    overhang = Overhang(468.0, 84.0, 30_000.0, np.zeros(3), cut_area)
    (advice,) = [s for s in print_advice(printed, {"3-right": overhang}) if "3-right" in s]
    assert ("supports on the skin" in advice) == (face is None)
    assert (f"of its {face}," in advice) == (face is not None)


def test_custom_process_gets_the_advice_for_all_processes():
    tpu = device('process = "fdm-tpu"', 'name = "tpu-85a"')
    custom = replace(tpu, fabrication=replace(tpu.fabrication, process="belt-tpu"))
    assert print_advice(custom, {}) == print_advice(tpu, {})[:1]


@pytest.mark.parametrize(
    ("fabrication", "material", "code", "key"),
    [
        (
            'process = "cast-silicone"',
            'name = "ninjaflex-85a"',
            "material-not-for-process",
            "material.name",
        ),
        (
            'process = "cast-silicone"\nlimit_cuts = true',
            None,
            "key-not-applicable",
            "fabrication.limit_cuts",
        ),
        (
            'process = "fdm-tpu"\nmould_wall = 4',
            None,
            "key-not-applicable",
            "fabrication.mould_wall",
        ),
        ('process = "cast-silicone"\nshrinkage = 2', None, "out-of-range", "fabrication.shrinkage"),
        ('process = "fdm-tpu"\nbed = [220, 220]', None, "wrong-shape", "fabrication.bed"),
        ('process = "fdm-tpu"\nbed = [220, 220, 5]', None, "out-of-range", "fabrication.bed"),
        ('process = "fdm-tpu"\ncopies = 2.5', None, "value-type", "fabrication.copies"),
        ('process = "fdm-tpu"\ncopies = 400', None, "out-of-range", "fabrication.copies"),
    ],
)
def test_settings_that_cannot_be_are_refused(fabrication, material, code, key):
    with raises(DeviceError, code, key=key):
        device(fabrication, material)


def test_copies_lie_on_the_plates_and_do_not_move_the_cords():
    one = device('process = "fdm-tpu"')
    three = device('process = "fdm-tpu"\ncopies = 3\nbed = [200, 180, 100]')
    parts = {n: box_surface([0, 0, 0], [90, 40, 10]) for n in ("1-a", "2-b")}
    pins = {"pin-5x11.9": (box_surface([0, 0, 0], [5, 5, 12]), 2, {})}
    placed, bound = on_plates(three, parts, pins)
    assert sorted(placed) == sorted(
        [f"{p}{k}" for p in parts for k in ("", "_2", "_3")]
        + [f"pin-5x11.9_{k}" for k in range(1, 7)]
    )
    assert 1 == bound <= 1 + max(p.plate for p in placed.values())
    cast = replace(three, fabrication=replace(three.fabrication, kind="cast"))
    assert len(on_plates(cast, parts, pins)[0]) == 2 + 6  # moulds once, pins for every device
    optimize = next(s for s in STAGES if s.name == "optimize")
    assert optimize.inputs(one) == optimize.inputs(three)
    assert load_device(BAR).fabrication.copies == 1
