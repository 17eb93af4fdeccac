"""Whether it is told that there are too few cords, by floors as devices had them."""

from types import SimpleNamespace

import pytest

from defsense_fab.optimize.studies.risks import too_few


@pytest.mark.parametrize(
    ("cords", "floors", "unseen", "noise_free", "told"),
    [
        (1, (9.0, 0.4), 9.46, 9.4, True),  # a bend and a twist by one cord
        (3, (1.22, 0.29), 0.49, 0.15, False),  # `bar`: what is left is noise
        (3, (0.5, 0.16), 2.23, 1.97, False),  # `cube`: not for want of signals
        (3, (1.28, 0.94), 1.08, 0.94, False),  # one cord more would not do it
    ],
)
def test_too_few_cords_are_told(cords, floors, unseen, noise_free, told):
    problem = SimpleNamespace(floor={cords + 1: floors[1]}.__getitem__)
    prediction = SimpleNamespace(
        noise=(0.002,) * cords,
        floor=floors[0],
        unseen=unseen,
        unseen_noise_free=noise_free,
    )
    said = too_few(problem, prediction)
    assert len(said) == told
    if told:
        assert "1 cord can" in said[0]
        assert "[design] sensors = 2" in said[0]
