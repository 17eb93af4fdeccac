"""Draw the wiring of a device as SVG: the board, converters, cords, resistors and rails.

A channel is a row: its reference resistor comes from the supply rail at the left, its cord leads to
the ground rail at the right, and the wire of its pin comes in below them. Wires that cross without
being connected have a gap; connections have a dot.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import ceil

from ...core.device.boards import ADS1115_INPUTS, ADS1115_STRAPS, Board
from ...store.manifest import END_NAMES
from ..pictures.sheet import INK, SOFT, extent, shortened
from .connections import ADDR, BANDS, GND, SCL, SDA, VDD, Channel, Wiring, color_code

_FONT_PX, _TITLE_PX, _SMALL_PX = 14, 18, 12
_SUPPLY_COLOR, _SIGNAL_COLOR = "#b3261e", "#00798c"
_BOARD_FILL, _MODULE_FILL, _MODULE_EDGE, _RESISTOR_FILL = "#e6f1f4", "#eef6ea", "#66a182", "#f4e8d0"
_MARGIN, _TOP = 30.0, 96.0  # of the picture; y of the wire from the supply pin
_ROW, _FIRST_ROW = 56.0, 52.0  # distance of rows; of the first from the supply wire
_PIN_DROP = 18.0  # of a pin's wire below the row of its channel
_LABEL_RISE = 18.0  # of labels above the row
# From the pin of a channel: the supply rail, the resistor, the junction, the cord, the ground rail.
_RAIL_X, _RESISTOR_X, _JUNCTION_X, _CORD_X, _GROUND_X = (
    70.0,
    (100.0, 170.0),
    210.0,
    (250.0, 420.0),
    460.0,
)
_ZIGZAG_PX, _ZIGZAGS = 8.0, 8
_NAME_PX = 190.0  # longest name of a cord
_MODULE_WIDTH, _MODULE_HEIGHT, _MODULE_GAP = 130.0, ADS1115_INPUTS * _ROW + 8, 24.0
_MODULE_PIN, _MODULE_STEP = 66.0, 34.0  # first pin at the left, below the top; distance of pins
_BUS_X, _BUS_STEP = 40.0, 24.0  # of the buses from the board
_STRAP_PX = 14.0

_Point = tuple[float, float]


class _Canvas:
    """SVG elements; later ones cover earlier ones."""

    def __init__(self) -> None:
        self._elements: list[str] = []

    def wire(self, points: Sequence[_Point], color: str = INK, width: float = 2.0) -> None:
        places = " ".join(f"{x:g},{y:g}" for x, y in points)
        line = f'<polyline points="{places}" fill="none"'
        self._elements.append(f'{line} stroke="{color}" stroke-width="{width:g}"/>')

    def gap(self, x: float, y: float) -> None:
        """Erase a vertical wire where a horizontal one crosses it."""
        self.rectangle((x - 3, y - 5), (6, 10), "#ffffff", "none", 0)

    def dot(self, x: float, y: float) -> None:
        self._elements.append(f'<circle cx="{x:g}" cy="{y:g}" r="4" fill="{INK}"/>')

    def rectangle(
        self, at: _Point, size: _Point, fill: str, edge: str = INK, radius: float = 6.0
    ) -> None:
        self._elements.append(
            f'<rect x="{at[0]:g}" y="{at[1]:g}" width="{size[0]:g}" height="{size[1]:g}"'
            f' rx="{radius:g}" fill="{fill}" stroke="{edge}" stroke-width="2"/>'
        )

    def text(
        self, x: float, y: float, text: str, anchor: str = "start", color: str = INK,
        size: int = _FONT_PX, is_bold: bool = False,
    ) -> None:  # fmt: skip
        """Write a line of text, centered vertically at y."""
        weight = ' font-weight="bold"' if is_bold else ""
        self._elements.append(
            f'<text x="{x:g}" y="{y + 0.35 * size:.1f}" text-anchor="{anchor}" fill="{color}"'
            f' font-size="{size}"{weight}>{escape(text)}</text>'
        )

    def as_svg(self, width: float, height: float, title: str) -> str:
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}"'
            f' width="{width:.0f}" height="{height:.0f}" font-family="system-ui, sans-serif">'
            f"<title>{escape(title)}</title>"
            f'<rect width="100%" height="100%" fill="#ffffff"/>\n'
            + "\n".join(self._elements)
            + "\n</svg>\n"
        )


def draw_wiring(wiring: Wiring) -> str:
    """Return the drawing of a device's wiring, as the text of an SVG file."""
    canvas = _Canvas()
    title = shortened(f"{wiring.device}: wiring", 700, _TITLE_PX, True)
    canvas.text(_MARGIN, 34, title, size=_TITLE_PX, is_bold=True)
    board_right = _MARGIN + _board_width(wiring)
    if wiring.module_count:
        pins_x = board_right + _BUS_X + 4 * _BUS_STEP + 40 + _MODULE_WIDTH
        rows = [_module_row(k) for k in range(len(wiring.channels))]
        bottom = _module_top(wiring.module_count) + 20
    else:
        pins_x = board_right
        rows = [_TOP + _FIRST_ROW + k * _ROW for k in range(len(wiring.channels))]
        bottom = rows[-1] + _PIN_DROP + 40
    _draw_rails(canvas, wiring, board_right, pins_x, rows, bottom)
    for channel, y in zip(wiring.channels, rows, strict=True):
        _draw_channel(canvas, channel, pins_x, y, is_last=y == rows[-1])
    if wiring.module_count:
        pins = _draw_modules(canvas, wiring, board_right, pins_x - _MODULE_WIDTH, bottom)
    else:
        pins = [(c.pin, y + _PIN_DROP) for c, y in zip(wiring.channels, rows, strict=True)]
    pins = [(wiring.supply_pin, _TOP), *pins, (wiring.board.ground, bottom)]
    _draw_board(canvas, wiring.board, board_right, pins)
    rest = max(f"{c.rest:.0f} Ω at rest" for c in wiring.channels)
    width = pins_x + _GROUND_X + 16 + max(extent(rest, _FONT_PX)[0], 60) + _MARGIN
    width = max(width, _MARGIN + extent(title, _TITLE_PX, True)[0] + _MARGIN)
    return canvas.as_svg(width, bottom + 40, f"{wiring.device}: wiring")


def format_ohm(ohm: float) -> str:
    """Return a resistance as it is written on drawings, as in "2.2 kΩ"."""
    factor, prefix = next((f, p) for f, p in ((1e6, "M"), (1e3, "k"), (0.0, "")) if ohm >= f)
    return f"{ohm / (factor or 1):.3g} {prefix}Ω"


def _board_width(wiring: Wiring) -> float:
    board = wiring.board
    labels = [wiring.supply_pin, board.ground]
    if wiring.module_count:
        labels += [board.converter_supply, board.sda, board.scl]
    else:
        labels += [c.pin for c in wiring.channels]
    widths = [extent(label, _FONT_PX)[0] + 20 for label in labels]
    return float(ceil(max(150.0, extent(board.title, _FONT_PX, True)[0] + 20, *widths)))


def _module_top(index: int) -> float:
    return _TOP + 34 + index * (_MODULE_HEIGHT + _MODULE_GAP)


def _module_row(channel: int) -> float:
    top = _module_top(channel // ADS1115_INPUTS)
    return top + 30 + channel % ADS1115_INPUTS * _ROW


def _draw_rails(
    canvas: _Canvas, wiring: Wiring, board: float, pins: float, rows: Sequence[float], bottom: float
) -> None:
    """Draw the supply rail at the left of the resistors, and the ground rail at the right."""
    rail, ground = pins + _RAIL_X, pins + _GROUND_X
    canvas.wire([(board, _TOP), (rail, _TOP), (rail, rows[-1])], _SUPPLY_COLOR)
    canvas.text(rail + 12, _TOP, f"+{wiring.supply_volt:g} V", color=_SUPPLY_COLOR)
    canvas.wire([(ground, rows[0]), (ground, bottom), (board, bottom)])
    canvas.text(ground + 12, bottom, "ground")


def _draw_channel(canvas: _Canvas, channel: Channel, pins: float, y: float, is_last: bool) -> None:
    """Draw the row of a channel, whose pin is at x = `pins`."""
    rail, junction, ground = pins + _RAIL_X, pins + _JUNCTION_X, pins + _GROUND_X
    left, right = (pins + x for x in _RESISTOR_X)
    if not is_last:
        canvas.gap(rail, y + _PIN_DROP)
    canvas.wire([(pins, y + _PIN_DROP), (junction, y + _PIN_DROP), (junction, y)], _SIGNAL_COLOR)
    canvas.wire([(rail, y), (left, y)], _SUPPLY_COLOR)
    canvas.rectangle((left, y - 8), (right - left, 16), _RESISTOR_FILL)
    bands = color_code(channel.resistor)
    for number, color in enumerate(bands):
        x = left + 8 + 10 * number + 8 * (number == len(bands) - 1)
        canvas.rectangle((x, y - 6.5), (5, 13), BANDS[color], "none", 0)
    middle = (left + right) / 2
    canvas.text(middle, y - _LABEL_RISE, format_ohm(channel.resistor), "middle")
    start, end = (pins + x for x in _CORD_X)
    canvas.wire([(right, y), (start, y)])
    canvas.wire([(end, y), (ground, y)])
    canvas.wire(_zigzag(start, end, y), channel.color, 4)
    name = shortened(channel.cord, _NAME_PX, _FONT_PX, True)
    canvas.text((start + end) / 2, y - _LABEL_RISE - 2, name, "middle", is_bold=True)
    for x, end_name in zip((end + ground, junction + start), END_NAMES, strict=True):
        canvas.text(x / 2, y - 11, end_name, "middle", SOFT, _SMALL_PX)
    canvas.text(ground + 12, y, f"{channel.rest:.0f} Ω at rest", color=SOFT)
    for x in (rail, junction, ground):
        canvas.dot(x, y)


def _zigzag(start: float, end: float, y: float) -> list[_Point]:
    step = (end - start) / (2 * _ZIGZAGS)
    inner = [
        (start + (k + 0.5) * step, y + (_ZIGZAG_PX if k % 2 else -_ZIGZAG_PX))
        for k in range(2 * _ZIGZAGS)
    ]
    return [(start, y), *inner, (end, y)]


def _module_pins(strap: str) -> list[str]:
    """Return the pins at the left of a module, with ADDR below the pin that it is connected to."""
    pins = [VDD, SDA, SCL, GND]
    pins.insert(pins.index(strap) + 1, ADDR)
    return pins


def _draw_modules(
    canvas: _Canvas, wiring: Wiring, board_right: float, left: float, bottom: float
) -> list[tuple[str, float]]:
    """Draw the ADS1115 with their buses; return the labels and heights of the board's pins."""
    board = wiring.board
    places = []
    for index in range(wiring.module_count):
        top = _module_top(index)
        pins = _module_pins(ADS1115_STRAPS[index][0])
        heights = {pin: top + _MODULE_PIN + k * _MODULE_STEP for k, pin in enumerate(pins)}
        places.append(heights)
        _draw_module(canvas, index, (left, top), heights)
    buses = {
        pin: board_right + _BUS_X + k * _BUS_STEP for k, pin in enumerate((VDD, SDA, SCL, GND))
    }
    colors = {VDD: _SUPPLY_COLOR, SDA: _SIGNAL_COLOR, SCL: _SIGNAL_COLOR, GND: INK}
    is_shared = board.converter_supply == wiring.supply_pin
    first = places[0]
    starts = {SDA: first[SDA], SCL: first[SCL], VDD: _TOP if is_shared else first[VDD]}
    ends = {pin: places[-1][pin] for pin in (VDD, SDA, SCL)} | {GND: bottom}
    starts[GND] = first[GND]
    for pin, x in buses.items():
        canvas.wire([(x, starts[pin]), (x, ends[pin])], colors[pin])
    for index, heights in enumerate(places):
        for pin, x in buses.items():
            y = heights[pin]
            for other, crossed in buses.items():
                if crossed > x and starts[other] < y < ends[other]:
                    canvas.gap(crossed, y)
            canvas.wire([(x, y), (left, y)], colors[pin])
            if 0 < index < len(places) - 1 or starts[pin] < y < ends[pin]:
                canvas.dot(x, y)
    board_pins = {board.sda: SDA, board.scl: SCL}
    if not is_shared:
        board_pins = {board.converter_supply: VDD, **board_pins}
    for pin in board_pins.values():
        y = first[pin]
        for other, crossed in buses.items():
            if crossed < buses[pin] and starts[other] < y < ends[other]:
                canvas.gap(crossed, y)
        canvas.wire([(board_right, y), (buses[pin], y)], colors[pin])
        if len(places) > 1:
            canvas.dot(buses[pin], y)
    if is_shared:
        canvas.dot(buses[VDD], _TOP)
    canvas.dot(buses[GND], bottom)
    return [(label, first[pin]) for label, pin in board_pins.items()]


def _draw_module(canvas: _Canvas, index: int, at: _Point, heights: dict[str, float]) -> None:
    left, top = at
    strap, address = ADS1115_STRAPS[index]
    canvas.rectangle(at, (_MODULE_WIDTH, _MODULE_HEIGHT), _MODULE_FILL, _MODULE_EDGE)
    middle = left + _MODULE_WIDTH / 2
    canvas.text(middle, top + 16, "ADS1115", "middle", is_bold=True)
    canvas.text(middle, top + 34, f"0x{address:X}", "middle", SOFT)
    x = left - _STRAP_PX
    canvas.wire([(left, heights[ADDR]), (x, heights[ADDR]), (x, heights[strap])])
    canvas.dot(x, heights[strap])
    for pin, y in heights.items():
        canvas.text(left + 10, y, pin)
        canvas.dot(left, y)
    right = left + _MODULE_WIDTH
    for number in range(ADS1115_INPUTS):
        y = _module_row(index * ADS1115_INPUTS + number) + _PIN_DROP
        canvas.text(right - 10, y, f"A{number}", "end")
        canvas.dot(right, y)


def _draw_board(
    canvas: _Canvas, board: Board, right: float, pins: Sequence[tuple[str, float]]
) -> None:
    top, bottom = _TOP - 46, pins[-1][1] + 20
    canvas.rectangle((_MARGIN, top), (right - _MARGIN, bottom - top), _BOARD_FILL, _SIGNAL_COLOR)
    canvas.text((_MARGIN + right) / 2, top + 20, board.title, "middle", is_bold=True)
    for label, y in pins:
        canvas.text(right - 10, y, label, "end")
        canvas.dot(right, y)
