"""Three organ pipes on a foot that one hand holds; the other hand moves the band around them."""

from typing import Annotated

from build123d import Axis, Box, Cylinder, Pos, fillet

FOOT, BAND = 32.0, 16.0  # mm: their heights


def body(
    radius: Annotated[float, (10, 20)] = 12.0,
    length: Annotated[float, (100, 200)] = 125.0,
    bore: Annotated[float, (0, 8)] = 6.0,
):
    spacing = 1.5 * radius
    width, depth = 2 * spacing + 2 * radius, 2 * radius
    foot = Pos(0, 0, FOOT / 2) * Box(width + 6, depth + 6, FOOT)
    band = Pos(0, 0, length - BAND / 2) * Box(width + 2, depth + 2, BAND)
    organ = fillet(foot.edges().filter_by(Axis.Z), 10) + fillet(band.edges().filter_by(Axis.Z), 10)
    for x, extra_height in ((-spacing, 6), (0, 24), (spacing, 14)):
        organ += Pos(x, 0, (length + extra_height) / 2) * Cylinder(radius, length + extra_height)
        if bore:
            organ -= Pos(x, 0, length + extra_height) * Cylinder(bore, 2 * extra_height)
    return organ
