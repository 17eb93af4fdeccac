"""The guide's first page, typed as it stands in an empty folder, a twin in place of hardware."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/guide/first-device.md"
_BLOCK = re.compile(
    r"(?:<!-- tested as: (?P<instead>[^>]*?) -->\n)?```sh\n(?P<typed>.*?)```"
    r"|<!-- test: make (?P<smaller>\S+) smaller -->",
    re.DOTALL,
)


def steps(text):
    """The page's commands in their order: lines to run, or a device to make smaller."""
    for block in _BLOCK.finditer(text):
        instead = block["instead"]
        if block["smaller"]:
            yield "smaller", block["smaller"]
        elif instead is None:
            yield from (("run", line) for line in block["typed"].splitlines())
        elif not instead.startswith("nothing, "):
            yield "run", instead


def make_smaller(device):
    """Fewer and larger tetrahedra, and one search: the same steps in less time."""
    text = device.read_text(encoding="utf-8")
    for old, new in (
        ("edge_length = 6.0", "edge_length = 15.0"),
        ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]"),
        ("markers = 40", "markers = 8"),
        ("[[sensors]]", "[design]\nsearches = 1\n\n[[sensors]]"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    device.write_text(text, encoding="utf-8")


@pytest.mark.slow
def test_each_command_of_the_first_page_does_what_it_says(tmp_path):
    (tmp_path / "fixtures").symlink_to(ROOT / "fixtures")
    page = PAGE.read_text(encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    run = 0
    for kind, what in steps(page):
        if kind == "smaller":
            make_smaller(tmp_path / what / "device.toml")
            continue
        words = shlex.split(what)
        if words[0] == "defsense":
            words[:1] = [sys.executable, "-m", "defsense_fab.cli.main"]
        done = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True,
            encoding="utf-8", stdin=subprocess.DEVNULL, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, f"{what}\n{done.stdout}\n{done.stderr}"
        run += 1
    assert run >= 10
    for named in set(re.findall(r"`(my-[a-z]+/[\w./-]+\.(?:html|pdf|json|3mf))`", page)):
        made = tmp_path / named
        assert made.is_file(), named
        assert made.stat().st_size > 0, named
