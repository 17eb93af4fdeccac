"""The estimated time to print the parts of a device."""

from dataclasses import replace

import pytest

from defsense_fab.core.device.device import FabricationSpec
from defsense_fab.workflow.fabrication.print_time import PART_S, SPEED_MM_S, print_hours

FILAMENT = FabricationSpec("fdm-tpu", 0.2, 1.2, 20.0, (220.0, 220.0, 250.0), line=0.4, layer=0.25)


def test_the_time_is_that_of_the_filament_and_of_each_part():
    hours = print_hours(FILAMENT, 3600 * 0.4 * 0.25 * SPEED_MM_S, 3)
    assert hours == pytest.approx(1 + 3 * PART_S / 3600)
    assert print_hours(replace(FILAMENT, copies=2), 1000.0, 3) == pytest.approx(
        2 * print_hours(FILAMENT, 1000.0, 3)
    )


@pytest.mark.parametrize("changes", [{"process": "polyjet"}, {"kind": "cast"}])
def test_other_processes_have_no_estimate(changes):
    assert print_hours(replace(FILAMENT, **changes), 1000.0, 3) is None
