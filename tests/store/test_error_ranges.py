"""How expected errors are described and compared with measured ones."""

import pytest

from tests.store.layouts import BAND


def test_the_expected_error_is_described_with_its_range_and_the_share_of_tolerances():
    text = BAND.describe_trained()
    for number in ("1.50 mm", "1.00 to 2.00", "1.00 mm of it"):
        assert number in text


@pytest.mark.parametrize(("measured", "is_inside"), [(1.0, True), (1.6, True), (2.1, False)])
def test_a_measured_error_is_compared_with_the_expected_range(measured, is_inside):
    text = BAND.compare_measured(measured)
    assert ("inside" in text) == is_inside
    assert f"{1.5 / measured:.2f}" in text
