"""A cord keeps its color while other cords change."""

from __future__ import annotations

from defsense_fab.studio.session.cord_colors import CORD_COLORS, CordColors

FIRST, SECOND, THIRD, FOURTH = CORD_COLORS[:4]


def test_other_cords_keep_their_colors_when_one_is_deleted():
    colors = CordColors()
    assert list(colors.of(["a", "b", "c"]).values()) == [FIRST, SECOND, THIRD]
    assert colors.of(["b", "c"]) == {"b": SECOND, "c": THIRD}


def test_a_restored_cord_gets_its_color_back():
    colors = CordColors()
    colors.of(["a", "b"])
    colors.of(["b"])
    assert colors.of(["a", "b"])["a"] == FIRST


def test_a_new_cord_gets_a_color_that_no_other_has():
    colors = CordColors()
    colors.of(["a", "b"])
    colors.of(["b"])
    assert colors.of(["b", "new"])["new"] == FIRST
    assert colors.of(["a", "b", "new"])["a"] == THIRD


def test_a_renamed_cord_keeps_its_color():
    colors = CordColors()
    colors.of(["a", "b"])
    assert colors.of(["a", "long"]) == {"a": FIRST, "long": SECOND}


def test_colors_repeat_when_there_are_more_cords():
    names = [f"cord {k}" for k in range(len(CORD_COLORS) + 1)]
    colors = list(CordColors().of(names).values())
    assert colors[:-1] == list(CORD_COLORS)
    assert colors[-1] == FIRST
