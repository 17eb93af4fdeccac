"""States that tell nothing, values that are not finite, silent cords, too many features."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import LayoutError
from defsense_fab.optimize.refinement.refine import optimise
from defsense_fab.optimize.studies.risks import risks


def quiet(fraction, message):
    pass


def test_states_that_are_all_alike_are_refused(problem):
    with pytest.raises(LayoutError, match="leave the markers where they are"):
        replace(problem, markers=np.zeros_like(problem.markers))


def test_a_field_that_is_not_finite_is_named(problem):
    fields = problem.fields.copy()
    fields[1, 5, 0] = np.nan
    with pytest.raises(LayoutError, match="field of state 2 "):
        replace(problem, fields=fields)
    markers = problem.markers.copy()
    markers[3, 0, 0] = np.inf
    with pytest.raises(LayoutError, match="displacement of state 3 "):
        replace(problem, markers=markers)


def test_cords_that_tell_nothing_are_named(problem, straight):
    still = replace(problem, fields=np.zeros_like(problem.fields))
    drawn = [straight("a", y=6), straight("b", y=-6)]
    found = optimise(still, drawn, np.random.default_rng(0), quiet, starts=1, candidates=200)
    warnings = risks(still, found.sensors)
    assert [w.split(":")[0] for w in warnings] == ["cord 'a'", "cord 'b'"]
    assert "changes by 0 over all states" in warnings[0]
    assert risks(problem, [straight("a", y=9, z=9)]) == []


def test_more_features_than_states_are_answered_with_a_warning(problem):
    few = replace(
        problem, fields=problem.fields[:2], markers=problem.markers[:3], decoder="quadratic"
    )
    found = optimise(few, [], np.random.default_rng(0), quiet, extra=3, starts=1, candidates=1500)
    assert np.isfinite(found.rmse)
    assert any("has 9 features for 3 states" in w for w in risks(few, found.sensors))
