"""Check the warning about too few cords with floors of real devices."""

from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.optimization.studies.risks import check_cord_count


@pytest.mark.parametrize(
    ("cords", "floors", "unseen", "free", "advised"),
    [
        (1, (7.6, 2.1), 9.46, 9.4, 2),  # a bend and a twist by one cord
        (1, (7.6, 5.3, 0.1), 9.0, 8.9, 3),  # three poses by one cord
        (3, (1.22, 0.29), 0.49, 0.15, None),  # `bar`: what is left is noise
        (3, (1.22, 0.29), 0.6, 0.5, None),  # a decoder that is below the floor
        (1, (2.5, 0.07), 2.6, 0.1, None),  # one bend: the affine map is in want, not the cord
        (3, (0.5, 0.16), 2.23, 1.97, None),  # `cube`: not for want of signals
        (3, (1.28, 0.94), 1.08, 0.94, None),  # more cords would not do it
    ],
)
@pytest.mark.parametrize(("states", "how"), [(20, "held out"), (20, "none"), (3, "held out")])
def test_too_few_cords_give_a_warning(cords, floors, unseen, free, advised, states, how):
    """Floors of three states, which any two signals reach, and fitted errors give no warning."""
    problem = SimpleNamespace(
        markers=np.zeros((states, 1, 3)),
        floor=lambda n: floors[min(n - cords, len(floors) - 1)],
    )
    prediction = SimpleNamespace(noise=(0.002,) * cords, floor=floors[0], unseen=unseen, how=how)
    risks = check_cord_count(problem, prediction, free)
    assert len(risks) == (advised is not None and states == 20 and how == "held out")
    assert [(r.code, r.data) for r in risks] == [("too-few-cords", {"cords": advised})] * len(risks)
