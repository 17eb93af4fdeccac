"""Which memory and which differences between units a device's twin has by default."""

from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.filaments import TraceSpec
from defsense_fab.twin.devices.built_unit import BuildingTraits
from defsense_fab.twin.devices.twin_traits import TwinTraits
from defsense_fab.twin.electronics.contact_network import ContactNetwork
from defsense_fab.twin.electronics.hysteretic_memory import HystereticMemory
from defsense_fab.twin.electronics.rubber_cords import MemoryTraits, RubberTraits
from defsense_fab.twin.options import TwinOptions
from tests.support.places import BAR

SPREAD = 0.2


@pytest.fixture(scope="module")
def corded():
    return load_device(BAR)


@pytest.fixture(scope="module")
def printed(corded):
    trace = TraceSpec("eel", 1.2, 0.8, 120.0, 2.0, 3.0, 80.0, SPREAD)
    return replace(corded, cord=replace(corded.cord, trace=trace))


def test_printed_traces_have_the_network_and_the_spread_of_their_filament(corded, printed):
    traits = TwinTraits.for_device(printed)
    assert traits.rubber.memory == ContactNetwork()
    assert (traits.rubber.ohm_spread, traits.building.gauge) == (SPREAD, SPREAD)
    cords = TwinTraits.for_device(corded)
    assert cords.rubber.memory == MemoryTraits()
    assert cords.rubber.ohm_spread == RubberTraits().ohm_spread
    assert cords.building == BuildingTraits()


def test_a_stated_family_overrides_the_default(corded, printed):
    for device in (corded, printed):
        traits = TwinTraits.for_device(device, TwinOptions(cords="hysteretic"))
        assert traits.rubber.memory == HystereticMemory()


def test_memory_of_printed_traces_can_be_disabled(printed):
    traits = TwinTraits.for_device(printed)
    names = ["hysteresis", "relaxation", "mullins"]
    assert {*names, "tunneling", "spread"} <= set(traits.names)
    memory = traits.disable_traits(names).rubber.memory
    assert (memory.direction, memory.opened, memory.settled, memory.broken) == (0, 0, 0, 0)
    assert memory.width == ContactNetwork().width
