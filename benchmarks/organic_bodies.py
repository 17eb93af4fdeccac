"""Generate organic bodies for benchmarks: closed surfaces in mm, unless a body says otherwise.

Implicit fields are blended and meshed by marching cubes. The shapes and the numbers of triangles
are like those of sculpting programs and scanners: even, fine, and with slivers. Some bodies add the
noise and the uneven triangles of a scanner. All are generated with fixed seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.core.mesh import Surface

Field = Callable[[Float], Float]


def meshed(field: Field, low: list[float], high: list[float], step: float) -> Surface:
    """Return the surface where `field` (n, 3) -> (n,) is 0, on a grid of `step` mm."""
    import igl

    axes = [np.arange(a - step, b + 2 * step, step) for a, b in zip(low, high, strict=True)]
    nx, ny, nz = (len(a) for a in axes)
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    values = np.concatenate([field(p) for p in np.array_split(points, 1 + len(points) // 200_000)])
    values = np.where(np.abs(values) < 1e-3 * step, 1e-3 * step, values)  # no facets without area
    vertices, faces, _ = igl.marching_cubes(values, points, nx, ny, nz, 0.0)
    surface = Surface(np.asarray(vertices, float), np.asarray(faces, np.int64))
    turned = surface if surface.volume > 0 else Surface(surface.vertices, surface.faces[:, ::-1])
    return _largest(turned)


def _largest(surface: Surface) -> Surface:
    import igl

    piece = np.asarray(igl.facet_components(surface.faces)[1])
    faces = surface.faces[piece == np.bincount(piece).argmax()]
    return Surface(surface.vertices, faces).compact()[0]


def capsule(a: list[float], b: list[float], r: float, s: float | None = None) -> Field:
    """Return the field of a limb from `a` with radius `r` to `b` with radius `s`."""
    start, end = np.array(a, float), np.array(b, float)
    axis, s = end - start, r if s is None else s

    def field(p: Float) -> Float:
        t = np.clip((p - start) @ axis / (axis @ axis), 0, 1)
        offset = np.linalg.norm(p - start - t[:, None] * axis, axis=1)
        return np.asarray(offset - (r + (s - r) * t))

    return field


def ellipsoid(center: list[float], radii: list[float]) -> Field:
    c, r = np.array(center, float), np.array(radii, float)
    return lambda p: (np.linalg.norm((p - c) / r, axis=1) - 1) * r.min()


def joined(fields: list[Field], k: float) -> Field:
    """Return the union of fields with fillets of about `k` mm."""

    def field(p: Float) -> Float:
        out = fields[0](p)
        for f in fields[1:]:
            other = f(p)
            h = np.clip(0.5 + 0.5 * (out - other) / k, 0, 1)
            out = out + (other - out) * h - k * h * (1 - h)
        return np.asarray(out)

    return field


def path(points: Float, radii: Float) -> list[Field]:
    """Return the union of capsules along points (n, 3) with radii (n,)."""
    return [
        capsule(list(a), list(b), r, s)
        for a, b, r, s in zip(points[:-1], points[1:], radii[:-1], radii[1:], strict=True)
    ]


def bumpy(field: Field, height: float, wave: float, seed: int) -> Field:
    """Add bumps of `height` mm and about `wave` mm in several directions."""
    rng = np.random.default_rng(seed)
    k = rng.normal(size=(8, 3))
    k *= 2 * np.pi / wave / np.linalg.norm(k, axis=1, keepdims=True)
    phase = rng.uniform(0, 2 * np.pi, 8)
    return lambda p: field(p) + height * np.sin(p @ k.T + phase).mean(axis=1) * 2.8


def _armadillo(step: float = 1.02) -> Surface:
    limbs = [
        ellipsoid([0, 0, 75], [27, 24, 34]),
        ellipsoid([0, -8, 122], [15, 17, 16]),
        capsule([0, -20, 120], [0, -34, 114], 8, 5),
        capsule([9, -2, 132], [17, 2, 150], 5, 2.6),
        capsule([-9, -2, 132], [-17, 2, 150], 5, 2.6),
        *path(np.array([[0, 18, 55], [0, 36, 38], [6, 52, 30], [18, 62, 34], [30, 64, 44]], float),
              np.array([12, 9, 7, 5, 3.0])),
    ]  # fmt: skip
    for side in (-1, 1):
        arm = np.array([[22, 0, 98], [44, -4, 100], [58, -16, 112], [64, -24, 124]], float)
        leg = np.array([[14, 0, 52], [22, -8, 32], [20, 2, 10], [22, -12, 5]], float)
        for points, radii in ((arm, [10, 8, 6.5, 6]), (leg, [13, 11, 8, 7])):
            limbs += path(points * [side, 1, 1], np.array(radii, float))
        for k in range(4):
            hand = np.array([64, -24, 124]) * [side, 1, 1]
            limbs.append(
                capsule(list(hand), list(hand + np.array([side * (6 * k - 8), -8, 16])), 3.6, 2.2)
            )
        for k in range(3):
            foot = np.array([22, -12, 5]) * [side, 1, 1]
            limbs.append(
                capsule(list(foot), list(foot + np.array([side * 6 * (k - 1), -16, 0])), 4.5, 3)
            )
    field = bumpy(joined(limbs, 5.0), 0.35, 4.0, 1)
    return meshed(field, [-90, -50, -4], [90, 74, 156], step)


def _rings(points: Float, radius: float, tube: float) -> list[Field]:
    """Return horizontal rings about points (n, 3)."""

    def ring(c: Float) -> Field:
        def field(p: Float) -> Float:
            q = p - c
            return np.asarray(np.hypot(np.hypot(q[:, 0], q[:, 1]) - radius, q[:, 2]) - tube)

        return field

    return [ring(c) for c in points]


def _genus_4() -> Surface:
    centers = np.array([[0, 0, 0], [34, 6, 3], [66, -2, 8], [98, 8, 2]], float)
    return meshed(joined(_rings(centers, 17, 8.5), 4.0), [-30, -30, -14], [130, 40, 24], 1.5)


def _tall() -> Surface:
    t = np.linspace(0, 1, 30)
    spine = np.column_stack([14 * np.sin(4 * t), 10 * np.cos(6 * t) - 10, 260 * t])
    radii = 15 + 4 * np.sin(14 * t)
    return meshed(joined(path(spine, radii), 3.0), [-40, -50, -25], [45, 30, 285], 1.8)


def _flat() -> Surface:
    arms = [ellipsoid([0, 0, 0], [38, 38, 9])]
    for k in range(5):
        a = 2 * np.pi * k / 5
        arms.append(capsule([0, 0, 0], [78 * np.cos(a), 78 * np.sin(a), 0], 10, 6))

    def field(p: Float) -> Float:
        return joined(arms, 12.0)(p * [1, 1, 1.4])

    return meshed(bumpy(field, 0.3, 9.0, 4), [-100, -100, -20], [100, 100, 20], 1.6)


def _octopus() -> Surface:
    parts = [ellipsoid([0, 0, 48], [26, 26, 34])]
    for k in range(8):
        a = 2 * np.pi * k / 8
        s = np.linspace(0, 1, 9)
        reach, height = 18 + 70 * s, 26 - 40 * s + 34 * s**2
        turn = a + 0.7 * s**2
        spine = np.column_stack([reach * np.cos(turn), reach * np.sin(turn), height])
        parts += path(spine, 10 - 6.5 * s)
    return meshed(joined(parts, 4.0), [-100, -100, -2], [100, 100, 92], 1.3)


def _hand() -> Surface:
    parts = [ellipsoid([0, 0, 40], [34, 13, 40]), capsule([0, 0, -10], [0, 0, 20], 20, 22)]
    for k, (x, long) in enumerate([(-26, 50), (-9, 62), (9, 58), (25, 44)]):
        spine = np.array([[x, 0, 66], [1.2 * x, -2 - k, 66 + long / 2], [1.3 * x, -8, 66 + long]])
        parts += path(spine, np.array([9, 8, 6.5]))
    parts += path(
        np.array([[28, 0, 24], [46, -6, 42], [52, -10, 62]], float), np.array([11, 9, 7.0])
    )
    return meshed(joined(parts, 4.0), [-50, -40, -34], [75, 30, 140], 1.7)


def _knot() -> Surface:
    t = np.linspace(0, 2 * np.pi, 61)
    spine = 26 * np.column_stack(
        [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -1.1 * np.sin(3 * t)]
    )
    return meshed(joined(path(spine, np.full(61, 11.0)), 1.0), [-95, -95, -50], [95, 95, 50], 1.7)


def _coral() -> Surface:
    rng = np.random.default_rng(5)
    parts: list[Field] = [ellipsoid([0, 0, 4], [34, 34, 12])]

    def grow(at: Float, along: Float, long: float, r: float, depth: int) -> None:
        end = at + long * along
        parts.append(capsule(list(at), list(end), r, 0.8 * r))
        for _ in range(2 if depth else 0):
            turned = along + 0.75 * rng.normal(size=3)
            turned[2] = abs(turned[2]) + 0.3
            grow(end, turned / np.linalg.norm(turned), 0.85 * long, 0.8 * r, depth - 1)

    grow(np.array([0, 0, 8.0]), np.array([0, 0, 1.0]), 40, 11, 4)
    return meshed(bumpy(joined(parts, 4.0), 0.25, 6.0, 2), [-130, -130, -14], [130, 130, 190], 1.6)


def _scan() -> Surface:
    """Return a figure as from a scanner: with noise, and triangles of uneven size."""
    parts = [
        ellipsoid([0, 0, 40], [34, 22, 44]), ellipsoid([0, -4, 104], [20, 23, 26]),
        capsule([0, -22, 100], [0, -31, 96], 5, 3), capsule([30, 0, 66], [42, -14, 26], 10, 8),
        capsule([-30, 0, 66], [-42, -14, 26], 10, 8),
    ]  # fmt: skip
    solid = meshed(joined(parts, 6.0), [-60, -40, -8], [60, 34, 136], 0.8)
    rng = np.random.default_rng(9)
    return Surface(solid.vertices + rng.normal(scale=0.05, size=solid.vertices.shape), solid.faces)


def _slivers() -> Surface:
    """Return a pear meshed coarsely in one direction: triangles twelve times as long as wide."""
    pear = joined(
        [ellipsoid([0, 0, 30], [34, 34, 32]), capsule([0, 0, 30], [6, 0, 100], 24, 12)], 8
    )

    def squeezed(p: Float) -> Float:
        return pear(p * [1, 1, 12])

    solid = meshed(squeezed, [-40, -40, -0.8], [40, 40, 10], 1.0)
    return Surface(solid.vertices * [1, 1, 12], solid.faces)


def _open() -> Surface:
    """Return a seal with missing triangles in two places."""
    spine = np.array([[0, 0, 14], [40, 0, 26], [90, 0, 24], [140, 4, 12]], float)
    parts = [*path(spine, np.array([10, 24, 20, 6.0])), capsule([0, 0, 14], [-14, 0, 18], 12, 9)]
    solid = meshed(joined(parts, 6.0), [-40, -36, -20], [160, 40, 60], 1.8)
    middle = solid.vertices[solid.faces].mean(1)
    gone = np.linalg.norm(middle - [60, 0, 50], axis=1) < 5
    gone |= np.linalg.norm(middle - middle[middle[:, 0].argmax()], axis=1) < 3
    return Surface(solid.vertices, solid.faces[~gone]).compact()[0]


def _y_up() -> Surface:
    """Return a standing figure as from animation programs: y is up."""
    hand = _hand()
    return Surface(hand.vertices[:, [0, 2, 1]] * [1, 1, -1], hand.faces)


def _limb(rng: np.random.Generator, at: Float, along: Float, long: float, r: float) -> list[Field]:
    """Return a limb of three bent pieces that taper."""
    points = [at]
    for _ in range(3):
        along = along + 0.25 * rng.normal(size=3)
        points.append(points[-1] + long / 3 * along / np.linalg.norm(along))
    return path(np.array(points), r * np.array([1.0, 0.8, 0.65, 0.6]))


def _flap(center: Float, long: float, wide: float, thick: float, turn: Float) -> Field:
    """Return an ear or a fin: a flat ellipsoid along the axes `turn` (3, 3)."""
    radii = np.array([wide / 2, thick / 2, long / 2])

    def field(p: Float) -> Float:
        q = (p - center) @ turn
        k0, k1 = (np.linalg.norm(q / radii**n, axis=1) for n in (1, 2))
        return np.asarray(k0 * (k0 - 1) / np.maximum(k1, 1e-9))

    return field


def animal(seed: int, triangles: int | None = None) -> Surface:
    """Return a random animal of 150 mm with ears, limbs, a tail and fins.

    Every other animal has triangles that are large where the skin is flat, like edited scans; the
    others have even ones.

    Args:
        seed: Seed of all proportions.
        triangles: Number of triangles, about; drawn between 5,000 and 20,000 by default.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    drawn = int(rng.uniform(5_000, 20_000))
    girth = rng.uniform(0.75, 1.25)
    trunk = np.array([42, 19 * girth, 20 * girth]) * rng.uniform(0.9, 1.1, 3)
    head = np.array([trunk[0] + 12, 0, 16 + 8 * rng.uniform()])
    size = rng.uniform(12, 19)
    parts = [
        ellipsoid([0, 0, 0], list(trunk)),
        ellipsoid(list(head), list(size * rng.uniform(0.8, 1.15, 3))),
        capsule([0.6 * trunk[0], 0, 4], list(head), 0.7 * size, 0.6 * size),
        capsule(list(head), list(head + np.array([1.3 * size, 0, -5])), 0.5 * size, 0.35 * size),
        *_limb(rng, np.array([-0.85 * trunk[0], 0, 4]), np.array([-1, 0, rng.normal()]),
               rng.uniform(30, 60), rng.uniform(4, 8)),
    ]  # fmt: skip
    for side in (-1, 1):
        ear = Rotation.from_rotvec([0.4 * side * rng.uniform(), 0, rng.normal(scale=0.5)])
        long = rng.uniform(14, 30)
        at = head + np.array([-2, side * 0.65 * size, 0.6 * size + 0.25 * long])
        parts.append(_flap(at, long, rng.uniform(9, 16), rng.uniform(3, 5), ear.as_matrix()))
        for end in (-0.55, 0.55):
            hip = np.array([end * trunk[0], side * 0.55 * trunk[1], -0.5 * trunk[2]])
            down = np.array([0.1 * rng.normal(), 0.15 * side, -1.0])
            parts += _limb(rng, hip, down, rng.uniform(28, 50), rng.uniform(6, 9.5))
    for _ in range(rng.integers(1, 4)):
        fin = Rotation.from_rotvec([0.2 * rng.normal(), 0, np.pi / 2 + 0.2 * rng.normal()])
        at = np.array([rng.uniform(-0.6, 0.6) * trunk[0], 0, trunk[2] + 2])
        shape = rng.uniform(18, 32), rng.uniform(14, 26), rng.uniform(3, 5)
        turn = fin.as_matrix()[:, [1, 0, 2]] * [1, -1, 1]
        parts.append(_flap(at, shape[0], shape[1], shape[2], turn @ np.diag([-1.0, -1, 1])))
    field = bumpy(joined(parts, 3.5), 0.3, rng.uniform(5, 12), seed)
    count = triangles or drawn
    even = meshed(field, [-125, -60, -90], [110, 60, 90], 1.6)
    step = 1.6 * np.sqrt(len(even.faces) / (count if seed % 2 else 3 * count))
    solid = meshed(field, [-125, -60, -90], [110, 60, 90], float(step))
    if not seed % 2:
        solid = _thinned(solid, count)
    return Surface(solid.vertices * 150 / np.ptp(solid.bounds, axis=0).max(), solid.faces)


def _thinned(surface: Surface, count: int) -> Surface:
    """Return the surface with `count` triangles, large where it is flat."""
    import igl

    vertices, faces, *_ = igl.qslim(
        np.asfortranarray(surface.vertices), np.asfortranarray(surface.faces, np.int32), count
    )
    return Surface(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64))


#: Each body's maker, by name.
BODIES: dict[str, Callable[[], Surface]] = {
    "armadillo": _armadillo, "genus-4": _genus_4, "tall": _tall, "flat": _flat,
    "octopus": _octopus, "hand": _hand, "knot": _knot, "coral": _coral, "scan": _scan,
    "slivers": _slivers, "open": _open, "y-up": _y_up,
}  # fmt: skip


def write_stl(surface: Surface, path: Path) -> None:
    """Write a binary STL file."""
    import trimesh

    path.write_bytes(
        trimesh.Trimesh(surface.vertices, surface.faces, process=False).export(file_type="stl")
    )
