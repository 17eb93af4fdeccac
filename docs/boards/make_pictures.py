"""Draw the wirings of the pages on read-out boards.

python docs/boards/make_pictures.py
"""

from pathlib import Path

from defsense_fab.core.device.boards import find_board
from defsense_fab.report.pictures.sheet import COLORS
from defsense_fab.report.wiring.connections import Channel, Wiring
from defsense_fab.report.wiring.drawing import draw_wiring
from defsense_fab.sensing.voltage_divider import choose_reference

HERE = Path(__file__).parent
NAMES = tuple("ABCDE")
REST, HIGHEST = 1150.0, 1400.0  # of a cord, ohm


def example(board, converter, cords):
    """Return a wiring of some cords of the same resistance."""
    place = find_board(board)
    channels = [
        Channel(
            name,
            COLORS[k],
            REST,
            HIGHEST,
            choose_reference(REST, HIGHEST),
            k // 4 + 1 if converter == "ads1115" else 0,
            f"A{k % 4}" if converter == "ads1115" else place.pins[k],
        )
        for k, name in enumerate(NAMES[:cords])
    ]
    return Wiring(place.title, "cord", place, converter, tuple(channels))


def main():
    """Write the drawings next to this file."""
    for name, arguments in {
        "wiring-nano.svg": ("nano", "arduino", 3),
        "wiring-esp32.svg": ("esp32", "ads1115", 5),
    }.items():
        (HERE / name).write_text(draw_wiring(example(*arguments)), encoding="utf-8")


if __name__ == "__main__":
    main()
