"""The reference resistors of a build, without which resistances of wired cords are not known."""

import json
from types import SimpleNamespace

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.store.build import Build
from defsense_fab.store.manifest import FOLDER, MANIFEST, save_manifest
from tests.report.guide.blocks import blocks
from tests.support.errors import raises


@pytest.fixture
def build(tmp_path):
    """A build with the parts and cords of a block."""
    some = blocks(1, 2, ends=[["mouth", "mouth"]] * 2)
    (tmp_path / FOLDER).mkdir()
    save_manifest(tmp_path, some.manifest)
    build = Build(tmp_path)
    cords = [SimpleNamespace(name=c.sensor) for c in reversed(some.manifest.cords)]
    build.layout = SimpleNamespace(by_channel=lambda: cords)
    return build


def test_resistors_are_those_of_the_manifest_in_the_order_of_the_channels(build):
    ohm = {c.sensor: c.reference_resistor for c in build.manifest.cords}
    names = [c.name for c in build.layout.by_channel()]
    assert names[::-1] == list(ohm)
    assert build.reference_resistors == tuple(ohm[name] for name in names)
    for name in names:
        assert f"{ohm[name]:g} ohm ({name})" in build.describe_resistors()


def test_parts_of_another_version_lead_to_the_option_for_resistors(build):
    path = build.folder / MANIFEST
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), "schema": 4}))
    build = Build(build.folder)
    with raises(StorageError, "wrong-schema") as error:
        _ = build.reference_resistors
    assert "reference" in error.value.action
