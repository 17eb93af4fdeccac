"""The exact solid of the bar."""

import pytest


@pytest.fixture(scope="session")
def bar_solid():
    """The TopoDS_Solid whose facets are those of `bar`."""
    import build123d as bd

    return (bd.Pos(75, 0, 0) * bd.Box(150, 30, 30)).solids()[0].wrapped
