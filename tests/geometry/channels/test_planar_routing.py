"""Routes of runs and turns, and the search for one."""

import numpy as np
import pytest

from defsense_fab.geometry.channels.planar_routing import HEADINGS, Grid, PlanarRoute, find_route

CELL = 0.25


def grid(room, goal, size=(40.0, 20.0)):
    x, y = np.meshgrid(*(np.arange(0, s + CELL / 2, CELL) for s in size), indexing="ij")
    return Grid(np.zeros(2), CELL, room(x, y), goal(x, y))


def walls(x, y):
    return np.minimum(np.minimum(x, 40 - x), np.minimum(y, 20 - y)) - 1


def first_moves(start, heading, radius=2.0):
    return [
        PlanarRoute(np.array(start, float), heading, radius, (side,) * n)
        for side in (1, -1)
        for n in (3, 6, 9, 12)
    ]


def test_route_consists_of_runs_and_turns_of_its_radius():
    route = PlanarRoute(np.array([1.0, 2.0]), 0.3, 2.5, (1,) * 6 + (0,) * 5 + (-1,) * 12 + (0,) * 2)
    fine = route.sample(0.05)
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    assert steps.sum() == pytest.approx(route.length, rel=1e-3)
    assert steps.max() <= 0.05 + 1e-9
    assert route.length == pytest.approx(25 * 2.5 * 2 * np.pi / HEADINGS)
    assert route.end_heading == pytest.approx(0.3 - np.pi / 2)
    assert fine[-1] == pytest.approx(route.arcs[-1, 2])
    assert route.arcs[1:, 0] == pytest.approx(route.arcs[:-1, 2])
    # A quarter turn to the left ends one radius ahead and one to the left.
    ahead, left = np.array([np.cos(0.3), np.sin(0.3)]), np.array([-np.sin(0.3), np.cos(0.3)])
    assert route.arcs[0, 2] == pytest.approx(route.start + 2.5 * ahead + 2.5 * left)
    for a, middle, b in route.arcs[[0, 2]]:
        center = np.linalg.solve(2 * np.array([middle - a, b - a]),
                                 [middle @ middle - a @ a, b @ b - a @ a])  # fmt: skip
        assert np.linalg.norm(a - center) == pytest.approx(2.5)
    # The sparse line runs along the same way.
    away = np.linalg.norm(fine[:, None] - route.polyline[None], axis=2).min(axis=0)
    assert away.max() < 0.03


def test_search_avoids_obstacles():
    def room(x, y):
        block = np.hypot(x - 20, y - 10) - 6
        return np.minimum(walls(x, y), block)

    route = find_route(
        first_moves([5, 10], np.pi), grid(room, lambda x, y: (x > 36) & (abs(y - 10) < 2))
    )
    points = route.sample(0.1)
    assert np.hypot(points[:, 0] - 20, points[:, 1] - 10).min() >= 6
    assert walls(points[5:, 0], points[5:, 1]).min() >= 0
    assert points[-1, 0] > 35.5
    straight = np.hypot(31, 0)
    assert straight < route.length < 1.6 * straight


def test_search_ends_without_a_route():
    def shut(x, y):
        return np.minimum(walls(x, y), abs(x - 20) - 1)

    assert find_route(first_moves([5, 10], np.pi), grid(shut, lambda x, y: x > 36)) is None
    nowhere = grid(walls, lambda x, y: np.zeros_like(x, bool))
    assert find_route(first_moves([5, 10], np.pi), nowhere) is None
    assert find_route([], grid(walls, lambda x, y: x > 36)) is None
