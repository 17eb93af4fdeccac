"""The exact solid of the bar."""

import pytest


@pytest.fixture(scope="session")
def bar_solid():
    """The TopoDS_Solid whose facets are those of `bar`."""
    import build123d as bd

    from defsense_fab.geometry.kernels import occ

    return occ.solids_of(bd.Pos(75, 0, 0) * bd.Box(150, 30, 30))[0]
