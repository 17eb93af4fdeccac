"""Check problems with equal states, infinite values, silent cords or too many features."""

from dataclasses import replace

import numpy as np

from defsense_fab.core.errors import LayoutError
from defsense_fab.optimization.studies.risks import find_risks
from tests.optimization.conftest import search
from tests.support.errors import raises


def test_equal_states_are_refused(problem):
    with raises(LayoutError, "nothing-to-sense"):
        replace(problem, markers=np.zeros_like(problem.markers))


def test_a_field_that_is_not_finite_is_refused(problem):
    fields = problem.fields.copy()
    fields[1, 5, 0] = np.nan
    with raises(LayoutError, "not-finite", quantity="field", state=2):
        replace(problem, fields=fields)
    markers = problem.markers.copy()
    markers[3, 0, 0] = np.inf
    with raises(LayoutError, "not-finite", quantity="markers' displacement", state=3):
        replace(problem, markers=markers)


def test_silent_cords_give_warnings(problem, straight):
    still = replace(problem, fields=np.zeros_like(problem.fields))
    drawn = [straight("a", y=6), straight("b", y=-6)]
    found = search(still, drawn, starts=1, candidates=200)
    warnings = find_risks(still, found.sensors)
    assert [(w.code, w.where) for w in warnings] == [("cord-silent", "a"), ("cord-silent", "b")]
    assert find_risks(problem, [straight("a", y=9, z=9)]) == []


def test_more_features_than_states_give_a_warning(problem):
    few = replace(
        problem, fields=problem.fields[:2], markers=problem.markers[:3], decoder="quadratic"
    )
    found = search(few, extra=3, starts=1, candidates=1500)
    assert np.isfinite(found.rmse)
    assert ("features-exceed-states", {"features": 9}) in [
        (r.code, r.data) for r in find_risks(few, found.sensors)
    ]
