"""What is printed: templates at 1:1, tables whose numbers hold their limits, pages for A4 and
Letter."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.geometry.parts.records import Check
from defsense_fab.report.guide import pdf
from defsense_fab.report.guide.assembly.steps import guide_steps
from defsense_fab.report.guide.guide import AssemblyStep, Guide, IllustratedPassage
from defsense_fab.report.guide.tables import GuideTable, guide_checks
from defsense_fab.report.guide.template_pages import CordStrip, CutFace
from defsense_fab.report.guide.templates import cord_templates, face_template
from defsense_fab.store.layout import PlaneRecord

from .blocks import blocks

DPI = 254.0  # ten pixels a mm


def layout_of(some):
    return SimpleNamespace(sensors=[
        SimpleNamespace(
            name=s["name"], points=np.asarray(s["points"]),
            plane=PlaneRecord(np.zeros(3), np.asarray(s["plane"]["normal"]), np.eye(3)[0]),
        )
        for s in some.layout["sensors"]
    ])  # fmt: skip


def image():
    import base64
    import io

    from PIL import Image

    data = io.BytesIO()
    Image.new("RGB", (60, 30), "red").save(data, format="PNG")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()


@pytest.fixture(scope="module")
def device():
    return blocks(1, 1, ends=[["bend", "outside"]])


@pytest.fixture(scope="module")
def guide(device):
    steps = guide_steps(device.device, device.manifest, device.parts)
    joint = next(s.joint for s in steps if s.joint)
    found = face_template(
        joint,
        "Step 4: the face",
        device.device,
        layout_of(device),
        device.manifest,
        device.parts,
    )
    picture = image()
    return Guide(
        "blocks", "2 parts", (), picture, (GuideTable("Print", ("part",), (("1",),)),),
        tuple(
            AssemblyStep(s.title, tuple(IllustratedPassage(p.lines, picture) for p in s.passages))
            for s in steps
        ),
        GuideTable("Checked", ("what",), ()), steps, cord_templates(device.device, device.manifest),
        (found,),
    )  # fmt: skip


@pytest.fixture(scope="module")
def pages(guide, tmp_path_factory):
    pdfium = pytest.importorskip("pypdfium2")
    path = tmp_path_factory.mktemp("paper") / "guide.pdf"
    pdf.write_pdf(guide, path)
    document = pdfium.PdfDocument(path)
    out = []
    for page in document:
        text = page.get_textpage()
        pixels = np.asarray(page.render(scale=DPI / 72, grayscale=True).to_numpy())
        out.append((page.get_size(), text.get_text_range(), pixels.reshape(pixels.shape[:2])))
        text.close()
        page.close()
    document.close()
    return out


def runs(row, dark=100):
    """Lengths in pixels of the dark stretches of a row, and where they begin."""
    some = np.diff(np.concatenate([[0], (row < dark).astype(int), [0]]))
    return np.flatnonzero(some == -1) - np.flatnonzero(some == 1), np.flatnonzero(some == 1)


def test_pages_fit_a4_and_letter(pages):
    for (width, height), _, _ in pages:
        assert width <= min(210 / 25.4 * 72, 612) + 0.1
        assert height <= min(297 / 25.4 * 72, 792) + 0.1


def test_the_ruler_and_the_cord_are_drawn_as_long_as_they_are(pages, device):
    (page,) = (image for _, text, image in pages if "Templates at 1:1" in text)
    found = [int(n) for row in page for n in runs(row)[0] if n > 300]
    assert abs(max(n for n in found if abs(n - 1000) < 20) - 1000) <= 3  # 100 mm
    cord = device.manifest.cords[0]
    dark = 10 * (cord.unstretched - 7.0)  # between the ferrules
    assert min(abs(n - dark) for n in found) <= 5


def test_the_cut_face_is_drawn_at_its_size(guide, device):
    (found,) = guide.faces
    edges = np.linalg.norm(found.outline[:, 1] - found.outline[:, 0], axis=1)
    assert edges.sum() == pytest.approx(4 * 60.0, abs=0.01)
    (ferrules,) = (x.ferrules for x in found.cords)
    line = found.cords[0].line
    assert np.linalg.norm(ferrules[1][0] - line[-1]) == pytest.approx(20.0, abs=0.01)  # its lead
    assert np.linalg.norm(ferrules[0][0] - line[0]) == pytest.approx(11.0 - 3.5, abs=0.01)
    lengths = np.linalg.norm(np.diff(found.cords[0].line, axis=0), axis=1).sum()
    assert lengths == pytest.approx(device.manifest.cords[0].channel_length, abs=0.2)
    assert {letter for letter, _, _ in found.pins} == {"a", "b"}


def test_a_face_is_not_mirrored(guide, device):
    """Not mirrored: a pin lies to the same side of the cord as in the device."""
    (found,) = guide.faces
    joint = next(s.joint for s in guide.typed if s.joint)
    line = np.asarray(device.layout["sensors"][0]["points"])
    pin = joint.pins[0].center

    def turn(a, b, c, up):
        return float(np.cross(b - a, c - a) @ up)

    here = [np.append(p, 0) for p in (*found.cords[0].line[[0, -1]], found.pins[0][1])]
    flat = turn(*here, np.array([0, 0, 1.0]))
    assert np.sign(flat) == np.sign(turn(line[0], line[-1], pin, joint.opens))


def test_cords_longer_than_a_page_are_broken_into_rows(guide):
    (strip,) = guide.strips
    long = CordStrip(replace(strip, length=500.0, mark=480.0), 182.0)
    assert len(long.row_starts) == 3
    assert np.diff(long.row_starts) == pytest.approx([172.0, 172.0])
    assert long.wrap()[1] > CordStrip(strip, 182.0).wrap()[1]


def test_a_face_is_turned_to_fit_or_left_out(guide):
    (found,) = guide.faces
    wide = replace(found, size=np.array([200.0, 50.0]))
    assert CutFace.fit(wide, 182.0, 230.0).size[1] == pytest.approx(210.0)
    assert CutFace.fit(replace(found, size=np.array([300.0, 300.0])), 182.0, 230.0) is None


@pytest.mark.parametrize("count", [1, 3, 80])
def test_a_step_longer_than_a_page_continues_below_its_picture(guide, tmp_path, count):
    pdfium = pytest.importorskip("pypdfium2")
    (shown, *_), *_ = (s.passages for s in guide.steps)
    words = " and lay it into the groove of the lower part, ferrule first" * (
        20 if count < 9 else 3
    )
    lines = tuple(f"Take cord {k}{words}" for k in range(count))
    long = AssemblyStep("Lay the cords", (replace(shown, lines=lines),))
    pdf.write_pdf(replace(guide, steps=(long,)), tmp_path / "long.pdf")
    document = pdfium.PdfDocument(tmp_path / "long.pdf")
    text = " ".join(page.get_textpage().get_text_range() for page in document)
    assert all(f"Take cord {k} " in text for k in range(count))


def test_the_same_guide_gives_the_same_bytes(guide, tmp_path):
    for name in ("a.pdf", "b.pdf"):
        pdf.write_pdf(guide, tmp_path / name)
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


@pytest.mark.parametrize(("value", "limit", "least", "shown", "must", "holds"), [
    (1.19961, 1.2, True, "1.1996 mm", "at least 1.2 mm", "no"),
    (1.19961, 1.18, True, "1.2 mm", "at least 1.18 mm", "yes"),
    (0.0199, 0.02, False, "0.0199 mm", "at most 0.02 mm", "yes"),
    (0.0, 0.02, False, "0 mm", "at most 0.02 mm", "yes"),
    (27.6519, 0.76, True, "27.65 mm", "at least 0.76 mm", "yes"),
])  # fmt: skip
def test_a_measurement_and_its_limit_are_comparable(value, limit, least, shown, must, holds):
    checks = (Check("wall", value, limit, "mm", "(0, 0, 0)", at_least=least),)
    (row,) = guide_checks(SimpleNamespace(checks=checks)).rows
    assert row == ("wall", shown, must, holds, "(0, 0, 0)")


def test_shares_are_percentages():
    checks = (Check("part: share thinner than 0.8 mm", 0.0123, 0.5, "", ""),)
    (row,) = guide_checks(SimpleNamespace(checks=checks)).rows
    assert row[1:4] == ("1.23 %", "at most 50 %", "yes")
