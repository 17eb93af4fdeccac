"""The guide in Chromium: ticks are kept, phones need no sideways scroll, one page sums up."""

from dataclasses import replace

import pytest

from defsense_fab.report.guide.guide import Guide, write_guide
from defsense_fab.report.guide.steps import guide_steps
from defsense_fab.report.guide.tables import guide_checks, guide_tables

from .blocks import blocks

PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    some = blocks(1, 2, ends=[["mouth", "mouth"]] * 2)
    steps = guide_steps(some.device, some.manifest, some.parts)
    kinds = tuple(replace(p, file="plate.3mf") for p in some.manifest.plates)
    pins = {f"{pin.name}_1": next(iter(kinds[0].parts.values())) for pin in some.manifest.pins}
    plates = (replace(kinds[0], parts={**kinds[0].parts, **pins}),)
    manifest = replace(some.manifest, plates=plates)
    folder = tmp_path_factory.mktemp("guide")
    guide = Guide(
        device="blocks",
        intro="Two cords.",
        warnings=(),
        exploded=PIXEL,
        tables=guide_tables(manifest),
        steps=steps,
        pictures=tuple((None,) * len(step.passages) for step in steps),
        checks=guide_checks(manifest),
        strips=(),
        faces=(),
    )
    write_guide(guide, folder)
    return folder / "guide.html"


@pytest.fixture
def page(browser, file):
    context = browser.new_context(viewport={"width": 390, "height": 844})
    opened = context.new_page()
    opened.goto(file.as_uri())
    yield opened
    context.close()


def test_finished_steps_stay_ticked_after_a_reload(page):
    boxes, status = page.locator(".step input"), page.get_by_role("status")
    count = boxes.count()
    assert status.inner_text() == f"0 of {count} done."
    page.get_by_label("Step 2 is done").check()
    page.reload()
    assert [box.is_checked() for box in boxes.all()] == [k == 1 for k in range(count)]
    assert page.locator(".summary input").nth(1).is_checked()
    assert status.inner_text() == f"1 of {count} done."
    page.get_by_role("button", name="Clear").click()
    page.reload()
    assert status.inner_text() == f"0 of {count} done."


def test_a_phone_does_not_scroll_sideways(page):
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    wide = "[...document.querySelectorAll('.wide')].filter((e) => e.scrollWidth > e.clientWidth)"
    assert page.evaluate(f"{wide}.length") == 0


MORE_ROWS = """() => {
for (const { rows } of document.querySelectorAll(".summary table"))
  for (let k = 0; k < 6; k++) rows[0].parentNode.append(rows[rows.length - 1].cloneNode(true));
const picture = document.querySelector(".summary img");
picture.style.width = "100%";
picture.style.height = "200px";
}"""


def test_the_summary_is_one_printed_page(page, tmp_path):
    pdfium = pytest.importorskip("pypdfium2")
    page.evaluate("window.print = () => {}")
    page.evaluate(MORE_ROWS)  # those of four parts have about as many more
    whole = page.pdf(path=tmp_path / "whole.pdf", format="A4")
    page.get_by_role("button", name="Print the summary").click()
    summary = page.pdf(path=tmp_path / "summary.pdf", format="A4")
    assert (len(pdfium.PdfDocument(summary)), len(pdfium.PdfDocument(whole)) > 1) == (1, True)
