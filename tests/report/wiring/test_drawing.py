"""Drawings of wirings: their lines connect what the plan connects, and no label is covered."""

from __future__ import annotations

from itertools import combinations, pairwise
from xml.etree import ElementTree

import pytest

from defsense_fab.report.pictures.sheet import extent
from defsense_fab.report.wiring.drawing import draw_wiring
from tests.report.wiring.plans import CASES, join, nets, plan

SVG = "{http://www.w3.org/2000/svg}"


class Drawing:
    """The elements of an SVG file, with numbers."""

    def __init__(self, text):
        root = ElementTree.fromstring(text)
        lines = [
            ([tuple(map(float, p.split(","))) for p in e.get("points").split()], e)
            for e in root.iter(f"{SVG}polyline")
        ]
        self.wires = [points for points, e in lines if e.get("stroke-width") == "2"]
        self.cords = [points for points, e in lines if e.get("stroke-width") == "4"]
        self.dots = [(float(e.get("cx")), float(e.get("cy"))) for e in root.iter(f"{SVG}circle")]
        boxes = [e for e in root.iter(f"{SVG}rect") if e.get("x") and e.get("stroke") != "none"]
        self.boxes = [
            tuple(float(e.get(name)) for name in ("x", "y", "width", "height")) for e in boxes
        ]
        self.texts = [(self.box_of(e), e) for e in root.iter(f"{SVG}text")]
        self.size = float(root.get("width")), float(root.get("height"))

    @staticmethod
    def box_of(text):
        """Return left, top, right and bottom of a text in a wide font."""
        size = int(text.get("font-size"))
        width = extent(text.text, size, text.get("font-weight") == "bold")[0]
        x, baseline = float(text.get("x")), float(text.get("y"))
        left = x - width * {"start": 0, "middle": 0.5, "end": 1}[text.get("text-anchor")]
        return left, baseline - 0.75 * size, left + width, baseline + 0.2 * size


def lies_on(point, line):
    """Return whether a point lies on a line of horizontal and vertical segments."""
    return any(
        min(a[0], b[0]) <= point[0] <= max(a[0], b[0])
        and min(a[1], b[1]) <= point[1] <= max(a[1], b[1])
        for a, b in pairwise(line)
    )


def drawn_nets(drawing):
    """Return the nets that the lines and dots of a drawing connect, as `nets` does of a plan."""
    pairs = []
    for point in {*drawing.dots, *(end for w in drawing.wires for end in (w[0], w[-1]))}:
        on_dot = [n for n, w in enumerate(drawing.wires) if lies_on(point, w)]
        if point not in drawing.dots:
            on_dot = [n for n in on_dot if point in (drawing.wires[n][0], drawing.wires[n][-1])]
        pairs += [(("at", point), ("wire", n)) for n in on_dot]
    places = {}
    blocks = [b for b in drawing.boxes if b[2] >= 130]
    board, *modules = sorted(blocks)
    for (left, top, right, bottom), text in drawing.texts:
        middle = float(text.get("y")) - 0.35 * int(text.get("font-size"))
        for number, (x, y, width, height) in enumerate(
            [board, *sorted(modules, key=lambda b: b[1])]
        ):
            if not (x < left and right < x + width and y < top and bottom < y + height):
                continue
            for dot in drawing.dots:
                is_level = abs(dot[1] - middle) < 1
                if is_level and (
                    (dot[0] == x and text.get("text-anchor") == "start")
                    or (dot[0] == x + width and text.get("text-anchor") == "end")
                ):
                    kind = ("board", 1) if number == 0 else ("ADS1115", number)
                    places[*kind, text.text] = dot
    resistors = sorted((b for b in drawing.boxes if b[3] == 16), key=lambda b: b[1])
    for number, (x, y, width, height) in enumerate(resistors, start=1):
        places["resistor", number, "supply"] = x, y + height / 2
        places["resistor", number, "junction"] = x + width, y + height / 2
    for number, line in enumerate(drawing.cords, start=1):
        places["cord", number, "end"], places["cord", number, "start"] = line[0], line[-1]
    pairs += [(terminal, ("at", point)) for terminal, point in places.items()]
    found = (frozenset(t for t in net if len(t) == 3) for net in join(pairs))
    return {net for net in found if len(net) > 1}


@pytest.mark.parametrize(("board", "converter", "cords"), CASES)
def test_lines_connect_what_the_plan_connects(board, converter, cords):
    wiring = plan(cords, board, converter)
    assert drawn_nets(Drawing(draw_wiring(wiring))) == nets(wiring)


@pytest.mark.parametrize(("board", "converter", "cords"), CASES)
def test_labels_are_inside_and_cover_nothing(board, converter, cords):
    drawing = Drawing(draw_wiring(plan(cords, board, converter)))
    for (left, top, right, bottom), text in drawing.texts:
        assert left >= 0, text.text
        assert top >= 0, text.text
        assert right <= drawing.size[0], text.text
        assert bottom <= drawing.size[1], text.text
        for line in (*drawing.wires, *drawing.cords):
            for (x1, y1), (x2, y2) in pairwise(line):
                is_apart = (
                    max(x1, x2) < left or min(x1, x2) > right
                    or max(y1, y2) < top or min(y1, y2) > bottom
                )  # fmt: skip
                assert is_apart, (text.text, line)
    for (a, first), (b, second) in combinations(drawing.texts, 2):
        is_apart = a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1]
        assert is_apart, (first.text, second.text)


@pytest.mark.parametrize(("board", "converter", "cords"), CASES)
def test_no_wires_lie_on_each_other(board, converter, cords):
    drawing = Drawing(draw_wiring(plan(cords, board, converter)))
    segments = [s for wire in drawing.wires for s in pairwise(wire)]
    for (a, b), (c, d) in combinations(segments, 2):
        for along, across in ((0, 1), (1, 0)):
            if a[across] == b[across] == c[across] == d[across]:
                low = max(min(a[along], b[along]), min(c[along], d[along]))
                high = min(max(a[along], b[along]), max(c[along], d[along]))
                assert low >= high, (a, b, c, d)


def test_names_and_resistors_of_all_cords_are_shown():
    texts = [e.text for _, e in Drawing(draw_wiring(plan(4, "esp32", "ads1115"))).texts]
    assert {"left", "right <a> & b", "cord-3", "470 Ω", "1 kΩ", "2.2 kΩ", "15 kΩ"} <= set(texts)
