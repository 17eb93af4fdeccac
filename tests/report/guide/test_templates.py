"""Templates are printed at 1:1, and tables show which of two numbers is greater."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.geometry.parts.records import Check
from defsense_fab.report.guide.steps import guide_steps
from defsense_fab.report.guide.tables import guide_checks
from defsense_fab.report.guide.template_pages import CordStrip, page_of, write_templates
from defsense_fab.report.guide.templates import cord_templates, face_template
from defsense_fab.store.layout import PlaneRecord

from .blocks import blocks

DPI = 254.0  # ten pixels per mm


def layout_of(device):
    return SimpleNamespace(
        sensors=[
            SimpleNamespace(
                name=s["name"],
                points=np.asarray(s["points"]),
                plane=PlaneRecord(np.zeros(3), np.asarray(s["plane"]["normal"]), np.eye(3)[0]),
            )
            for s in device.layout["sensors"]
        ]
    )


@pytest.fixture(scope="module")
def device():
    return blocks(1, 1, ends=[["bend", "outside"]])


@pytest.fixture(scope="module")
def joint(device):
    steps = guide_steps(device.device, device.manifest, device.parts)
    return next(s.joint for s in steps if s.joint)


@pytest.fixture(scope="module")
def strips(device):
    return cord_templates(device.device, device.manifest)


@pytest.fixture(scope="module")
def face(device, joint):
    layout = layout_of(device)
    return face_template(
        joint, "Step 4: the face", device.device, layout, device.manifest, device.parts
    )


@pytest.fixture(scope="module")
def pages(strips, face, tmp_path_factory):
    """Sizes (points) and pixels of the pages."""
    pdfium = pytest.importorskip("pypdfium2")
    path = tmp_path_factory.mktemp("paper") / "templates.pdf"
    write_templates(path, "blocks", strips, [face])
    document = pdfium.PdfDocument(path)
    pages = []
    for page in document:
        pixels = np.asarray(page.render(scale=DPI / 72, grayscale=True).to_numpy())
        pages.append((page.get_size(), pixels.reshape(pixels.shape[:2])))
        page.close()
    document.close()
    return pages


def dark_lengths(row, max_brightness=100):
    """Return the lengths in pixels of the dark runs of a row."""
    edges = np.diff(np.concatenate([[0], (row < max_brightness).astype(int), [0]]))
    return np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)


def test_pages_fit_a4_and_letter(pages):
    for (width, height), _ in pages:
        assert width <= min(210 / 25.4 * 72, 612) + 0.1
        assert height <= min(297 / 25.4 * 72, 792) + 0.1


def test_ruler_and_cord_have_their_true_lengths(pages, device):
    lengths = np.array([n for row in pages[0][1] for n in dark_lengths(row) if n > 300])
    assert np.abs(lengths - 1000).min() <= 3  # 100 mm
    cord = device.manifest.cords[0]
    between_ferrules = 10 * (cord.unstretched - 7.0)
    assert np.abs(lengths - between_ferrules).min() <= 5


def test_face_has_its_true_size(face, device):
    edges = np.linalg.norm(face.outline[:, 1] - face.outline[:, 0], axis=1)
    assert edges.sum() == pytest.approx(4 * 60.0, abs=0.01)
    (cord,) = face.cords
    (first, _), (second, _) = cord.ferrules
    assert np.linalg.norm(second - cord.line[-1]) == pytest.approx(20.0, abs=0.01)  # its lead
    assert np.linalg.norm(first - cord.line[0]) == pytest.approx(11.0 - 3.5, abs=0.01)
    length = np.linalg.norm(np.diff(cord.line, axis=0), axis=1).sum()
    assert length == pytest.approx(device.manifest.cords[0].channel_length, abs=0.2)
    assert {letter for letter, _, _ in face.pins} == {"a", "b"}


def test_face_is_not_mirrored(face, joint, device):
    """A pin is on the same side of the cord as in the device."""

    def orientation(a, b, c, up):
        return float(np.sign(np.cross(b - a, c - a) @ up))

    line = np.asarray(device.layout["sensors"][0]["points"])
    flat = [np.append(p, 0) for p in (*face.cords[0].line[[0, -1]], face.pins[0][1])]
    assert orientation(*flat, np.array([0, 0, 1.0])) == orientation(
        line[0], line[-1], joint.pins[0].center, joint.opens
    )


def test_cords_longer_than_a_page_continue_in_rows(strips):
    (strip,) = strips
    long = CordStrip(replace(strip, length=500.0, mark=480.0), 182.0)
    assert np.diff(long.row_starts) == pytest.approx([172.0, 172.0])
    assert long.wrap()[1] > CordStrip(strip, 182.0).wrap()[1]


@pytest.mark.parametrize(
    ("size", "page"),
    [
        ((150, 50), "portrait"),
        ((200, 50), "landscape"),
        ((50, 200), "portrait"),
        ((300, 300), None),
    ],
)
def test_wide_faces_are_on_wide_pages(face, size, page):
    assert page_of(replace(face, size=np.array(size, float))) == page


def test_a_wide_face_has_a_wide_page(strips, face, tmp_path):
    wide = replace(face, size=np.array([200.0, 50.0]))
    write_templates(tmp_path / "templates.pdf", "blocks", strips, [face, wide, face])
    pdfium = pytest.importorskip("pypdfium2")
    pages = pdfium.PdfDocument(tmp_path / "templates.pdf")
    sizes = [page.get_size() for page in pages]
    assert [width > height for width, height in sizes].count(True) == 1
    assert not sizes[-1][0] > sizes[-1][1]


def test_equal_templates_give_equal_bytes_without_faces_that_do_not_fit(strips, face, tmp_path):
    large = replace(face, size=np.array([300.0, 300.0]))
    for name in ("a.pdf", "b.pdf"):
        write_templates(tmp_path / name, "blocks", strips, [face, large])
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


@pytest.mark.parametrize(
    ("value", "limit", "at_least", "measured", "bound", "passed"),
    [
        (1.19961, 1.2, True, "1.1996 mm", "at least 1.2 mm", "no"),
        (1.19961, 1.18, True, "1.2 mm", "at least 1.18 mm", "yes"),
        (0.0199, 0.02, False, "0.0199 mm", "at most 0.02 mm", "yes"),
        (0.0, 0.02, False, "0 mm", "at most 0.02 mm", "yes"),
        (27.6519, 0.76, True, "27.65 mm", "at least 0.76 mm", "yes"),
    ],
)
def test_a_measurement_and_its_limit_are_comparable(
    value, limit, at_least, measured, bound, passed
):
    checks = (Check("wall", value, limit, "mm", "(0, 0, 0)", at_least=at_least),)
    (row,) = guide_checks(SimpleNamespace(checks=checks)).rows
    assert row == ("wall", measured, bound, passed, "(0, 0, 0)")


def test_shares_are_percentages():
    checks = (Check("part: share thinner than 0.8 mm", 0.0123, 0.5, "", ""),)
    (row,) = guide_checks(SimpleNamespace(checks=checks)).rows
    assert row[1:4] == ("1.23 %", "at most 50 %", "yes")
