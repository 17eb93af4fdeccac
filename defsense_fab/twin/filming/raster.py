"""Compiled loops over pixels: exact areas of polygons, a depth buffer and the sensor's noise.

Pixels are squares around whole numbers. The share of each pixel that a polygon covers is summed
over its edges, as font rasterizers do (the signed area method): every edge adds the area to its
right in the pixels that it crosses, and a running sum along the row adds it to the pixels further
right. The areas are exact: nothing is sampled.
"""

from __future__ import annotations

import numpy as np

from ...core.machine.compiled import compiled


@compiled()
def _add_edge(sums, x0, y0, x1, y1, weight):  # type: ignore[no-untyped-def]
    """Add an edge, in px from the buffer's corner, to the sums (h, w + 1, 3).

    The edge may leave the buffer.
    """
    sign = 1.0
    if y0 > y1:
        x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
    h, w = sums.shape[0], sums.shape[1] - 1
    if y1 <= 0.0 or y0 >= h or y0 == y1:
        return
    slope = (x1 - x0) / (y1 - y0)
    top, bottom = max(y0, 0.0), min(y1, float(h))
    for row in range(int(top), min(int(np.ceil(bottom)), h)):
        low, high = max(y0, float(row)), min(y1, row + 1.0)
        a = min(max(x0 + slope * (low - y0), 0.0), float(w))
        b = min(max(x0 + slope * (high - y0), 0.0), float(w))
        if a > b:
            a, b = b, a
        d = sign * (high - low)
        i, j = min(int(a), w - 1), min(int(np.ceil(b)), w)
        if j <= i + 1:
            part = d * (0.5 * (a + b) - i)
            for c in range(3):
                sums[row, i, c] += weight[c] * (d - part)
                sums[row, i + 1, c] += weight[c] * part
            continue
        done = 0.0  # share of d that was added to pixels so far
        for k in range(i, j):  # the area right of the edge in pixel k
            left, right = max(a, float(k)), min(b, k + 1.0)
            before = d * (left - a) / (b - a)
            within = d * (right - left) / (b - a)
            area = before + within * (k + 1.0 - 0.5 * (left + right))
            for c in range(3):
                sums[row, k, c] += weight[c] * (area - done)
            done = area
        for c in range(3):
            sums[row, j, c] += weight[c] * (d - done)


@compiled()
def paint(edges, weights, plane, scale, box, rays, depth, slack, inner, light, uncovered):  # type: ignore[no-untyped-def]
    """Paint a flat primitive behind what is painted already.

    Args:
        edges: Edges (k, 2, 2) px from the corner of the canvas.
        weights: Weights (k, 3) of the edges: in the value, the cover and the cover of the pattern.
        plane: Plane (4,): n and d of n . X = d in the camera's frame.
        scale: Grey levels are scale[0] + scale[1] * value.
        box: Bounding box (4,) px: x0, y0, x1, y1 on the canvas.
        rays: Undistorted pixels (h, w, 2) at depth one.
        depth: Depth (h, w) of the body, mm.
        slack: Depth by which the body must be in front to hide the primitive, mm.
        inner: Box (4,) of the image on the canvas.
        light: Light (h, w) painted so far; changed in place.
        uncovered: Share (h, w) of each pixel that nothing covers yet; changed in place.

    Returns:
        The visible area of the pattern in the image, px.
    """
    x0, y0, x1, y1 = box
    sums = np.zeros((y1 - y0, x1 - x0 + 1, 3))
    for k in range(len(edges)):
        _add_edge(
            sums, edges[k, 0, 0] - x0, edges[k, 0, 1] - y0, edges[k, 1, 0] - x0,
            edges[k, 1, 1] - y0, weights[k],
        )  # fmt: skip
    total = 0.0
    for i in range(y0, y1):
        value = cover = core = 0.0
        in_rows = inner[1] <= i < inner[3]
        for j in range(x0, x1):
            value += sums[i - y0, j - x0, 0]
            cover += sums[i - y0, j - x0, 1]
            core += sums[i - y0, j - x0, 2]
            if cover < 1e-9 or uncovered[i, j] <= 0.0:
                continue
            if depth[i, j] < np.inf:
                facing = plane[0] * rays[i, j, 0] + plane[1] * rays[i, j, 1] + plane[2]
                if abs(facing) * depth[i, j] + slack < abs(plane[3]):
                    continue
            if in_rows and inner[0] <= j < inner[2]:
                total += min(core, 1.0) * uncovered[i, j]
            light[i, j] += uncovered[i, j] * (scale[0] * min(cover, 1.0) + scale[1] * value)
            uncovered[i, j] -= min(cover, 1.0) * uncovered[i, j]
    return total


@compiled(error_model="numpy")
def fill_depth(corners, faces, points, skin, shade, box, depth, ground):  # type: ignore[no-untyped-def]
    """Draw the triangles that face the camera at the pixel centers that they contain.

    Args:
        corners: Vertices (n, 2) px of the canvas.
        faces: Triangles (m, 3).
        points: Vertices (n, 3) mm in the camera's frame.
        skin: Grey level of a triangle that faces the camera.
        shade: Share by which triangles seen at a slant are darker.
        box: The box of the canvas to fill.
        depth: Depth (h, w) mm; changed in place.
        ground: Grey levels (h, w), flat shaded; changed in place.
    """
    x0, y0, x1, y1 = box
    for f in range(len(faces)):
        a, b, c = faces[f]
        ax, ay, bx, by = corners[a, 0], corners[a, 1], corners[b, 0], corners[b, 1]
        cx, cy = corners[c, 0], corners[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not area < -1e-9:  # seen from behind, or NaN for points behind the camera
            continue
        low = max(int(np.ceil(min(ay, by, cy))), y0)
        high = min(int(np.floor(max(ay, by, cy))), y1 - 1)
        if low > high:
            continue
        p, q, r = points[a], points[b], points[c]
        n0 = (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1])
        n1 = (q[2] - p[2]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[2] - p[2])
        n2 = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        size = np.sqrt((n0 * n0 + n1 * n1 + n2 * n2) * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]))
        facing = abs(n0 * p[0] + n1 * p[1] + n2 * p[2]) / size
        grey = skin * (1.0 - shade + shade * facing)
        # 1 / z is linear in the image: its slopes and its value at the pixel (0, 0).
        i0, i1, i2 = 1.0 / p[2], 1.0 / q[2], 1.0 / r[2]
        across = ((i1 - i0) * (cy - ay) - (i2 - i0) * (by - ay)) / area
        down = ((i2 - i0) * (bx - ax) - (i1 - i0) * (cx - ax)) / area
        origin = i0 - across * ax - down * ay
        for i in range(low, high + 1):
            start, stop = np.inf, -np.inf
            for k in range(3):  # where the row crosses the sides
                ux, uy = (ax, ay) if k == 0 else (bx, by) if k == 1 else (cx, cy)
                vx, vy = (bx, by) if k == 0 else (cx, cy) if k == 1 else (ax, ay)
                if (uy <= i) == (vy <= i) and uy != i and vy != i:
                    continue
                x = ux + (vx - ux) * (i - uy) / (vy - uy) if uy != vy else ux
                start, stop = min(start, x), max(stop, x)
                if uy == vy:
                    start, stop = min(start, vx), max(stop, vx)
            if start > stop:
                continue
            inverse = origin + down * i
            for j in range(max(int(np.ceil(start)), x0), min(int(np.floor(stop)), x1 - 1) + 1):
                z = 1.0 / (inverse + across * j)
                if z < depth[i, j]:
                    depth[i, j] = z
                    ground[i, j] = grey


@compiled()
def develop(light, pad, gain, read, shot, noise, start, sign, out):  # type: ignore[no-untyped-def]
    """Compute the grey levels of an image, with noise of variance read^2 + shot * level.

    Args:
        light: Light on the canvas.
        pad: Width of the border of the canvas, px.
        gain: Gain (h, w) of each pixel.
        read: Standard deviation of the read noise, grey levels.
        shot: Variance per grey level.
        noise: Bank of noise (n,) of unit variance.
        start: Index of the first value of the bank that is used.
        sign: Sign of the noise, 1 or -1.
        out: Grey levels (h, w) uint8; changed in place.
    """
    h, w = out.shape
    floor, slope, turn = np.float32(read * read), np.float32(shot), np.float32(sign)
    half, low, high = np.float32(0.5), np.float32(0.0), np.float32(255.0)
    for i in range(h):
        a, g, o = light[i + pad][pad : pad + w], gain[i], out[i]
        n = noise[start + i * w : start + (i + 1) * w]
        for j in range(w):  # in single precision and without branches: eight at a time
            level = a[j] * g[j]
            level = level + turn * n[j] * np.sqrt(floor + slope * level) + half
            level = level if level > low else low
            level = level if level < high else high
            o[j] = np.uint8(np.int32(level))
