"""Small built devices for tests of the studio."""

from __future__ import annotations

import pytest

from defsense_fab.cli.main import main
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.support.body_scripts import write_bar
from tests.support.places import BAR
from tests.support.shared_folders import fill_once
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


@pytest.fixture(autouse=True)
def own_settings(tmp_path, monkeypatch):
    """Keep tests away from the agreements of the user."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))


def make_bar(folder):
    """Write a coarse bar with two locked cords, and build it up to the report."""
    write_bar(folder)
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    for old, new in (
        ("edge_length = 8.0", "edge_length = 15.0"),
        ("markers = 40", "markers = 8"),
        ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]"),
        ('free = ["path", "plane"]\n', ""),
        ("[fabrication]", '[design]\ndecoder = "affine"\nsearches = 1\n\n[fabrication]'),
    ):
        assert old in text
        text = text.replace(old, new)
    down, twist = text.index('[[poses]]\nname = "bend_down"'), text.index('[[poses]]\nname = "twi')
    text = text[:down] + text[twist:]
    (folder / "device.toml").write_text(text[: text.rindex("[[sensors]]")], encoding="utf-8")
    assert main(["build", str(folder)]) == 0


@pytest.fixture(scope="session")
def made_bar(tmp_path_factory):
    """Return the folder of a bar that the command line has built."""
    return fill_once(tmp_path_factory, "made-bar", make_bar)
