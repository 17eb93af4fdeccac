"""Names of sensors that are added without one."""

from itertools import islice

from defsense_fab.core.device.sensor_tables import new_sensor_names


def test_names_are_letters_that_no_other_sensor_has():
    assert list(islice(new_sensor_names([]), 3)) == ["A", "B", "C"]
    assert list(islice(new_sensor_names(["B", "left", "a"]), 2)) == ["C", "D"]


def test_names_continue_after_z():
    names = list(islice(new_sensor_names([]), 100))
    assert names[25:29] == ["Z", "AA", "AB", "AC"]
    assert len(set(names)) == 100
