"""Which orders of cuts are compared."""

import math

import pytest

from defsense_fab.geometry.parts import division
from defsense_fab.geometry.parts.division import cut_orders
from defsense_fab.optimize.limits import thin_parts


@pytest.mark.parametrize("planes", range(1, 8))
def test_all_orders_of_few_planes_and_one_of_many(planes):
    orders = cut_orders(planes)
    assert orders[0] == tuple(range(planes))
    assert {tuple(sorted(o)) for o in orders} == {tuple(range(planes))}
    assert len(orders) == len(set(orders)) == (math.factorial(planes) if planes <= 4 else 1)


def test_of_many_planes_those_of_short_cords_are_tried_first():
    assert cut_orders(6, [4, 1]) == [(0, 1, 2, 3, 4, 5), (4, 1, 0, 2, 3, 5)]


def test_optimiser_and_fabrication_compare_the_same_orders():
    assert thin_parts.cut_orders is division.cut_orders is cut_orders
