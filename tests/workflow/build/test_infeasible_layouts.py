"""A build whose layouts cannot be made stops before the parts, with each layout's reason."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from defsense_fab.core.errors import FabricationError
from defsense_fab.workflow.build.stage_optimize import default_searches, require_feasible_layout
from tests.support.errors import raises

STRAINED, LOOSE = "4-back: is strained by 13 %. Add a cord.", "cup-1: falls apart. Move a plane."


def device(kind="cast", searches=1, propose=2, free=()):
    return SimpleNamespace(
        source=Path("finger"),
        fabrication=SimpleNamespace(kind=kind),
        cord=SimpleNamespace(noun="cord"),
        searches=searches,
        propose=propose,
        sensors=[SimpleNamespace(free=f) for f in free],
    )


def layout(*problems, cords=2):
    return SimpleNamespace(
        weighed=[SimpleNamespace(problem=p) for p in problems], sensors=[None] * cords
    )


@pytest.mark.parametrize("kind", ["cast", "print"])
def test_each_reason_is_in_the_error(kind):
    problems = (STRAINED, LOOSE, STRAINED)
    with raises(
        FabricationError, "no-feasible-layout", problems=list(problems), searches=1, sensors=2
    ) as caught:
        require_feasible_layout(device(kind), layout(*problems))
    text = str(caught.value)
    assert text.count(STRAINED) == text.count(LOOSE) == 1
    assert ("cast" if kind == "cast" else "printed") in text


def test_default_searches_are_in_the_error():
    with raises(FabricationError, "no-feasible-layout", searches=default_searches(3)):
        require_feasible_layout(device(searches=None), layout(STRAINED, LOOSE, cords=3))


def test_drawn_cords_are_to_be_moved():
    drawn = device(propose=0, free=("", ""))
    with raises(FabricationError, "no-feasible-layout") as caught:
        require_feasible_layout(drawn, layout(LOOSE))
    assert "searches" not in caught.value.action


@pytest.mark.parametrize(
    ("kind", "problems"),
    [("cast", (STRAINED, None)), ("print", (LOOSE, None)), ("print", (LOOSE,)), ("cast", ())],
)
def test_other_builds_continue(kind, problems):
    require_feasible_layout(device(kind), layout(*problems))
