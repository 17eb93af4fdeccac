"""A thin sheet with rounded corners; its front edge is at low y."""

from typing import Annotated

from build123d import Axis, Box, Pos, fillet


def body(
    side: Annotated[float, (100, 200)] = 150.0,
    thickness: Annotated[float, (8, 16)] = 10.0,
    corner: Annotated[float, (2, 30)] = 12.0,
):
    sheet = Pos(side / 2, side / 2, 0) * Box(side, side, thickness)
    return fillet(sheet.edges().filter_by(Axis.Z), corner)
