"""A straight bar along x, centred in y and z."""

import build123d as bd


def body(length=150.0, width=30.0, height=30.0):
    return bd.Pos(length / 2, 0, 0) * bd.Box(length, width, height)
