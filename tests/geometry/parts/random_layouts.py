"""Seeded random layouts: planes at any angle, cords that curve, some of them impossible."""

import numpy as np

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.kernels.cutting_tools import axes_from_normal
from defsense_fab.optimization.limits.verification import verify


def random_layout(surface, limits, seed):
    """One to four cords in a body; three of four are drawn until they fit on their own."""
    rng = np.random.default_rng(seed)
    body = triangle_kernel.to_manifold(surface, "the body")
    axis = np.eye(3)[np.ptp(surface.bounds, axis=0).argmax()]
    out = []
    for k in range(rng.integers(1, 5)):
        careful = rng.random() < 0.75
        plane = None
        if out and rng.random() < 0.3:  # in the plane of the last one
            plane = out[-1].plane
        for _ in range(40 if careful else 1):
            sensor = _cord(body, surface, axis, limits, plane, rng, f"c{k + 1}")
            if sensor is not None and not (
                careful and verify([*out, sensor], surface, limits).violations
            ):
                out.append(sensor)
                break
    return out


def _cord(body, surface, axis, limits, plane, rng, name):
    if plane is None:
        low, high = surface.bounds
        origin = low + rng.uniform(0.2, 0.8, 3) * (high - low)
        normal = rng.normal(size=3)
        if rng.random() < 0.7:  # along the body
            normal -= (normal @ axis) * axis * rng.uniform(0.7, 1.0)
        normal /= np.linalg.norm(normal)
        plane = Plane(origin, axes_from_normal(normal))
    turned = body.transform(np.column_stack([plane.axes.T, -plane.axes.T @ plane.origin]))
    section = turned.slice(0.0)
    inner = section.offset(-limits.depth * rng.uniform(1.0, 2.0))
    loops = [np.asarray(p) for p in inner.to_polygons() if len(p) > 2]
    if not loops:
        return None
    loop = max(loops, key=len)
    closed = np.concatenate([loop, loop[:1]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = rng.uniform(0, along[-1], 2)
    a, b = (np.array([np.interp(t, along, closed[:, i]) for i in range(2)]) for t in at)
    length = float(np.linalg.norm(b - a))
    if length < 15:
        return None
    side = np.array([a[1] - b[1], b[0] - a[0]]) / length
    t = np.linspace(0, 1, int(rng.integers(5, 9)))
    wave = np.sin(np.pi * t) * rng.normal() + np.sin(2 * np.pi * t) * rng.normal()
    points = a + t[:, None] * (b - a) + 0.06 * length * wave[:, None] * side
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset())
