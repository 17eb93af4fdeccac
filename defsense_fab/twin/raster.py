"""Compiled loops that fill pixels: exact areas of polygons, a depth buffer, the sensor's noise.

Pixels are squares around whole numbers. A polygon's cover of each pixel is summed up from its edges
(the signed area method of font rasterisers): every edge adds the area to its right in the pixels it
crosses, and a running sum along the row carries it on. No sampling: the areas are exact.
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def _add_edge(sums, x0, y0, x1, y1, value, cover):  # type: ignore[no-untyped-def]
    """Add an edge in px from the buffer's corner to sums (h, w + 1, 2): it may leave the buffer."""
    sign = 1.0
    if y0 > y1:
        x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
    h, w = sums.shape[0], sums.shape[1] - 1
    if y1 <= 0.0 or y0 >= h or y0 == y1:
        return
    slope = (x1 - x0) / (y1 - y0)
    top, foot = max(y0, 0.0), min(y1, float(h))
    for row in range(int(top), min(int(np.ceil(foot)), h)):
        low, high = max(y0, float(row)), min(y1, row + 1.0)
        a = min(max(x0 + slope * (low - y0), 0.0), float(w))
        b = min(max(x0 + slope * (high - y0), 0.0), float(w))
        if a > b:
            a, b = b, a
        d = sign * (high - low)
        i, j = min(int(a), w - 1), min(int(np.ceil(b)), w)
        if j <= i + 1:
            part = d * (0.5 * (a + b) - i)
            sums[row, i, 0] += value * (d - part)
            sums[row, i, 1] += cover * (d - part)
            sums[row, i + 1, 0] += value * part
            sums[row, i + 1, 1] += cover * part
            continue
        done = 0.0  # of d: what has been given to pixels so far
        for k in range(i, j):  # the area right of the edge in pixel k
            left, right = max(a, float(k)), min(b, k + 1.0)
            before = d * (left - a) / (b - a)
            within = d * (right - left) / (b - a)
            area = before + within * (k + 1.0 - 0.5 * (left + right))
            sums[row, k, 0] += value * (area - done)
            sums[row, k, 1] += cover * (area - done)
            done = area
        sums[row, j, 0] += value * (d - done)
        sums[row, j, 1] += cover * (d - done)


@numba.njit(cache=True, nogil=True)
def paint(edges, weights, plane, scale, box, rays, depth, slack, inner, seen, left):  # type: ignore[no-untyped-def]
    """Paint one flat thing behind what is there already.

    `edges` (k, 2, 2) px; `weights` (k, 2); `plane` (4,): n and d of n . X = d in the camera's
    frame; values are `scale`[0] + `scale`[1] * value; `box` (4,) px x0, y0, x1, y1 of the canvas;
    `rays` (h, w, 2), `depth` (h, w) mm of the body, `seen` and `left` (h, w): the light so far
    and the part that nothing has covered yet; `inner` (4,): the image in the canvas. Returns the
    area in the image that is seen, px.
    """
    x0, y0, x1, y1 = box
    sums = np.zeros((y1 - y0, x1 - x0 + 1, 2))
    for k in range(len(edges)):
        _add_edge(
            sums, edges[k, 0, 0] - x0, edges[k, 0, 1] - y0, edges[k, 1, 0] - x0,
            edges[k, 1, 1] - y0, weights[k, 0], weights[k, 1],
        )  # fmt: skip
    total = 0.0
    for i in range(y0, y1):
        value = cover = 0.0
        inside = inner[1] <= i < inner[3]
        for j in range(x0, x1):
            value += sums[i - y0, j - x0, 0]
            cover += sums[i - y0, j - x0, 1]
            if cover < 1e-9 or left[i, j] <= 0.0:
                continue
            if depth[i, j] < np.inf:
                facing = plane[0] * rays[i, j, 0] + plane[1] * rays[i, j, 1] + plane[2]
                if abs(facing) * depth[i, j] + slack < abs(plane[3]):
                    continue
            part = min(cover, 1.0) * left[i, j]
            seen[i, j] += left[i, j] * (scale[0] * min(cover, 1.0) + scale[1] * value)
            left[i, j] -= part
            if inside and inner[0] <= j < inner[2]:
                total += part
    return total


@numba.njit(cache=True, nogil=True)
def fill_depth(corners, faces, points, skin, shade, box, depth, base):  # type: ignore[no-untyped-def]
    """Draw triangles `faces` (m, 3) where pixel centres are in them: corners (n, 2) px of the
    canvas, `points` (n, 3) mm in the camera's frame. Fills `depth` and the flat shaded `base`
    (h, w) within `box`; triangles that face away are drawn by their depth like the others."""
    x0, y0, x1, y1 = box
    for f in range(len(faces)):
        a, b, c = faces[f]
        ax, ay, bx, by = corners[a, 0], corners[a, 1], corners[b, 0], corners[b, 1]
        cx, cy = corners[c, 0], corners[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not abs(area) > 1e-9:  # NaN too: behind the camera
            continue
        p, q, r = points[a], points[b], points[c]
        n0 = (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1])
        n1 = (q[2] - p[2]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[2] - p[2])
        n2 = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        size = np.sqrt((n0 * n0 + n1 * n1 + n2 * n2) * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]))
        facing = abs(n0 * p[0] + n1 * p[1] + n2 * p[2]) / size
        grey = skin * (1.0 - shade + shade * facing)
        iz0, iz1, iz2 = 1.0 / p[2], 1.0 / q[2], 1.0 / r[2]
        low = max(int(np.ceil(min(ay, by, cy))), y0)
        high = min(int(np.floor(max(ay, by, cy))), y1 - 1)
        start = max(int(np.ceil(min(ax, bx, cx))), x0)
        stop = min(int(np.floor(max(ax, bx, cx))), x1 - 1)
        for i in range(low, high + 1):
            for j in range(start, stop + 1):
                u = ((bx - j) * (cy - i) - (by - i) * (cx - j)) / area
                v = ((cx - j) * (ay - i) - (cy - i) * (ax - j)) / area
                w = 1.0 - u - v
                if u >= 0.0 and v >= 0.0 and w >= 0.0:
                    z = 1.0 / (u * iz0 + v * iz1 + w * iz2)
                    if z < depth[i, j]:
                        depth[i, j] = z
                        base[i, j] = grey


@numba.njit(cache=True, nogil=True)
def develop(light, gain, read, shot, noise, start, sign, out):  # type: ignore[no-untyped-def]
    """Grey levels `out` (h, w) uint8 from `light` (h, w) and the `gain` (h, w) of each pixel, with
    a `noise` (n,) of unit variance from `start` on: variance read^2 + shot * level."""
    h, w = out.shape
    floor = np.float32(read * read)
    shot = np.float32(shot)
    sign = np.float32(sign)
    for i in range(h):
        at = start + i * w
        for j in range(w):
            level = light[i, j] * gain[i, j]
            level += sign * noise[at + j] * np.sqrt(floor + shot * max(level, np.float32(0.0)))
            out[i, j] = np.uint8(
                min(max(level + np.float32(0.5), np.float32(0.0)), np.float32(255.0))
            )
