"""What `build` says of a layout below its table."""

import pytest

from defsense_fab.cli.design.build import _begun_better, _cost_of_affine


def layout(kept="affine", how="held out", initial=1.0, taken=0.9):
    return {
        "unseen": {"affine": taken, "quadratic": 0.4, "kernel": 0.6},
        "prediction": {"decoder": kept, "how": how, "unseen": taken},
        "initial": {"unseen": initial},
    }


def test_what_the_affine_map_costs_is_told_where_it_is_kept():
    (said,) = _cost_of_affine(layout())
    assert "affine map has 0.90 mm and quadratic 0.40 mm" in said
    assert _cost_of_affine(layout("kernel")) == []
    assert _cost_of_affine(layout(how="none")) == []
    assert _cost_of_affine(layout(taken=0.3)) == []


@pytest.mark.parametrize(("initial", "told"), [(1.0, 0), (0.9, 0), (0.8996, 0), (0.89, 1)])
def test_a_search_that_ends_worse_than_it_began_says_so(initial, told):
    said = _begun_better(layout(initial=initial))
    assert len(said) == told
