"""Compiled loops that fill pixels: exact areas of polygons, a depth buffer, the sensor's noise.

Pixels are squares around whole numbers. A polygon's cover of each pixel is summed up from its edges
(the signed area method of font rasterisers): every edge adds the area to its right in the pixels it
crosses, and a running sum along the row carries it on. No sampling: the areas are exact.
"""

from __future__ import annotations

import numpy as np

from ...core.machine.compiled import compiled


@compiled()
def _add_edge(sums, x0, y0, x1, y1, weight):  # type: ignore[no-untyped-def]
    """Add an edge in px from the buffer's corner to sums (h, w + 1, 3): it may leave the buffer."""
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
            for c in range(3):
                sums[row, i, c] += weight[c] * (d - part)
                sums[row, i + 1, c] += weight[c] * part
            continue
        done = 0.0  # of d: what has been given to pixels so far
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
def paint(edges, weights, plane, scale, box, rays, depth, slack, inner, seen, left):  # type: ignore[no-untyped-def]
    """Paint one flat thing behind what is there already.

    `edges` (k, 2, 2) px; `weights` (k, 3); `plane` (4,): n and d of n . X = d in the camera's
    frame; values are `scale`[0] + `scale`[1] * value; `box` (4,) px x0, y0, x1, y1 of the canvas;
    `rays` (h, w, 2), `depth` (h, w) mm of the body, `seen` and `left` (h, w): the light so far
    and the part that nothing has covered yet; `inner` (4,): the image in the canvas. Returns the
    area in the image, px, that is seen of what the third weights outline.
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
        inside = inner[1] <= i < inner[3]
        for j in range(x0, x1):
            value += sums[i - y0, j - x0, 0]
            cover += sums[i - y0, j - x0, 1]
            core += sums[i - y0, j - x0, 2]
            if cover < 1e-9 or left[i, j] <= 0.0:
                continue
            if depth[i, j] < np.inf:
                facing = plane[0] * rays[i, j, 0] + plane[1] * rays[i, j, 1] + plane[2]
                if abs(facing) * depth[i, j] + slack < abs(plane[3]):
                    continue
            if inside and inner[0] <= j < inner[2]:
                total += min(core, 1.0) * left[i, j]
            seen[i, j] += left[i, j] * (scale[0] * min(cover, 1.0) + scale[1] * value)
            left[i, j] -= min(cover, 1.0) * left[i, j]
    return total


@compiled(error_model="numpy")
def fill_depth(corners, faces, points, skin, shade, box, depth, ground):  # type: ignore[no-untyped-def]
    """Draw the triangles `faces` (m, 3) that face the camera where pixel centres are in them.

    `corners` (n, 2) px of the canvas, `points` (n, 3) mm in the camera's frame; `depth` (h, w) mm
    and `ground` (h, w), flat shaded from the grey level `skin`, are filled within `box`.
    """
    x0, y0, x1, y1 = box
    for f in range(len(faces)):
        a, b, c = faces[f]
        ax, ay, bx, by = corners[a, 0], corners[a, 1], corners[b, 0], corners[b, 1]
        cx, cy = corners[c, 0], corners[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not area < -1e-9:  # from behind, or NaN: behind the camera
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
        # 1 / z is linear in the image: its slopes, and its value at the pixel (0, 0).
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
    """Grey levels `out` (h, w) uint8 from `light`, with `pad` px around the image, and the `gain`
    (h, w) of each pixel, with a `noise` (n,) of unit variance from `start` on: variance
    read^2 + shot * level."""
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
