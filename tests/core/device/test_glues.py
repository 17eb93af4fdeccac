"""Each material has a glue that fits its assembly."""

from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.glues import find_glue
from defsense_fab.core.device.materials import list_processes
from defsense_fab.core.storage.package_data import read_rows
from tests.support.places import BAR


def device_of(material, process=None, assembly="held"):
    device = load_device(BAR)
    rules = replace(
        device.fabrication,
        process=process or list_processes(material)[0],
        assembly=assembly,
        kind="cast" if "cast" in (process or list_processes(material)[0]) else "print",
    )
    return replace(device, material=replace(device.material, name=material), fabrication=rules)


@pytest.mark.parametrize("material", read_rows("materials.csv"))
@pytest.mark.parametrize("assembly", ["held", "bonded"])
def test_each_material_has_a_glue(material, assembly):
    glue = find_glue(device_of(material, assembly=assembly))
    assert ("silicone" in glue.name) == (
        material in read_rows("silicones.csv") or "silicone" in material
    )
    assert glue.open_minutes / 60 < glue.press_hours <= glue.cure_hours


def test_bonded_cords_leave_time_to_close_the_joint():
    material = "ninjaflex-85a"
    held, bonded = (find_glue(device_of(material, assembly=a)) for a in ("held", "bonded"))
    assert held.open_minutes < 1 < 10 < bonded.open_minutes


@pytest.mark.parametrize(
    ("process", "is_silicone"),
    [("fdm-tpu", False), ("cast-silicone", True), ("my-printer", False), ("my-cast", True)],
)
def test_a_custom_material_is_glued_like_those_of_its_process(process, is_silicone):
    assert ("silicone" in find_glue(device_of("my-rubber", process)).name) == is_silicone
