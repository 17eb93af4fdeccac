"""Pictures of steps show the whole body, with labels next to it."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from defsense_fab.report.guide import drawing as module
from defsense_fab.report.guide.drawing import Drawing
from defsense_fab.report.pictures import views
from tests.conftest import box_surface

FRONT = views.looking(np.array([0.1, -1.0, 0.2]), np.eye(3)[2])


def pixels(drawing):
    data = base64.b64decode(drawing.png().partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


@pytest.mark.parametrize("size", [(10, 10, 200), (200, 10, 10), (50, 50, 50)])
def test_a_body_of_any_shape_fits(size):
    drawing = Drawing(FRONT)
    drawing.part(box_surface([0, 0, 0], size), "#00798c")
    image = pixels(drawing)
    drawn = (np.ptp(image, axis=2) > 25).any
    rows, columns = np.flatnonzero(drawn(axis=1)), np.flatnonzero(drawn(axis=0))
    # The ratio of height to width is that of the body: nothing is cut off.
    corners = FRONT.flat(box_surface([0, 0, 0], size).vertices)
    wide, high = np.ptp(corners, axis=0)
    assert np.ptp(rows) / np.ptp(columns) == pytest.approx(high / wide, rel=0.03, abs=0.02)
    assert max(np.ptp(rows), np.ptp(columns)) > 500  # it fills the picture


def test_labels_are_next_to_the_body():
    drawing = Drawing(FRONT)
    drawing.part(box_surface([0, 0, 0], [50.0, 50, 50]), "#00798c", name="cube")
    drawing.label("cube", "cube")
    for k in range(6):
        drawing.label(
            np.array([40.0, 0.0, 20.0 + k]), f"place {k} with a long name that is wrapped"
        )
    plain = Drawing(FRONT)
    plain.part(box_surface([0, 0, 0], [50.0, 50, 50]), "#00798c")
    body, labelled = pixels(plain), pixels(drawing)
    left = module.COLUMN_WIDTH_PX
    middle = labelled[:, left : left + body.shape[1]]
    dark = (middle.max(axis=2) < 60).sum()
    assert dark < 0.002 * middle[..., 0].size  # no letters over the body
    text = (labelled.max(axis=2) < 60)[:, left + body.shape[1] :]
    assert text.sum() > 500
    assert not text[:, -2:].any()  # not cut off at the edge


@pytest.mark.parametrize(("count", "thick"), [(10, 4.0), (14, 10.0), (60, 200.0)])
def test_no_label_of_a_flat_body_is_cut_off(count, thick, monkeypatch):
    drawing = Drawing(FRONT)
    drawing.part(box_surface([0, 0, 0], [200.0, 10, thick]), "#00798c")
    for k in range(count):
        drawing.label(np.array([200.0 * k / (count - 1), 0.0, 0.0]), f"place {k}")
    written = []
    monkeypatch.setattr(module, "_write_label", lambda *given: written.append(given))
    drawing.png()
    assert len(written) == count
    heights = {True: [], False: []}
    for page, _, _, end, left in written:
        assert module.LINE_HEIGHT_PX / 2 <= end[1] <= page.size[1] - module.LINE_HEIGHT_PX / 2
        heights[bool(left)].append(end[1])
    assert all((np.diff(np.sort(h)) >= module.LINE_HEIGHT_PX).all() for h in heights.values())


def test_a_focus_enlarges_its_surroundings():
    near = Drawing(FRONT, (np.zeros(3), 20.0))
    near.part(box_surface([0, 0, 0], [500.0, 50, 50]), "#00798c")
    near.ball(np.zeros(3), 5.0, "#c1121f")
    image = pixels(near)
    red = (image[..., 0] > 150) & (image[..., 1] < 80)
    assert np.ptp(np.flatnonzero(red.any(axis=0))) > 60  # of 640 pixels; 13 without the focus


def test_long_names_are_wrapped_at_hyphens():
    drawing = Drawing(FRONT)
    drawing.part(box_surface([0, 0, 0], [50.0, 50, 50]), "#00798c")
    drawing.label(np.array([50.0, 0, 0]), "3-second-from-right-of-the-middle")
    image = pixels(drawing)
    assert (image[:, [0, -1]] > 200).all()
