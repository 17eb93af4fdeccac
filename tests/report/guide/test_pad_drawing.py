"""Drawings of pads."""

import xml.etree.ElementTree as ElementTree

import pytest

from defsense_fab.core.device.pads import PADS
from defsense_fab.report.guide.pad_drawing import draw_pad


@pytest.mark.parametrize("pad", PADS.values(), ids=PADS)
def test_drawings_state_the_sizes_of_the_solids(pad):
    """The picture is valid SVG, and all of its texts are inside."""
    root = ElementTree.fromstring(draw_pad(pad))
    width, height = (float(root.get(key)) for key in ("width", "height"))
    texts = [e for e in root.iter() if e.tag.endswith("}text")]
    words = " ".join(e.text for e in texts)
    for size in (pad.diameter, pad.depth, pad.hole_diameter, pad.hole_depth):
        assert f"{size:g}" in words
    assert all(fastener.name in words for fastener in pad.fasteners)
    assert all(0 < float(e.get("x")) < width and 0 < float(e.get("y")) < height for e in texts)


@pytest.mark.parametrize("pad", PADS.values(), ids=PADS)
def test_fasteners_fit_their_pads(pad):
    """Filament is left below and around all holes, and screws end above the holes' bottoms."""
    reach = max(pad.hole_offsets) + pad.hole_diameter / 2
    assert pad.diameter / 2 - reach >= 0.8 - 1e-9
    assert pad.depth - pad.hole_depth >= 0.8 - 1e-9
    assert all(-f.low <= pad.hole_depth for f in pad.fasteners)
