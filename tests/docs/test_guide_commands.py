"""Run the commands of the tutorial and of the page on webcams, with a twin instead of hardware.

Then run those of other pages in the same folder.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import webbrowser
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.cli.main import main
from tests.docs.page_commands import NOT_RUN, TYPED, lines_of
from tests.support.places import ROOT

PAGES = [ROOT / f"docs/guide/{name}.md" for name in ("first-device", "camera-training")]
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


#: Fewer and larger tetrahedra, and one search: the same steps in less time.
SMALLER = {
    "my-joystick": (
        ("edge_length = 5.0", "edge_length = 9.0"),
        ('decoder = "kernel"', 'decoder = "affine"'),
        ("markers = 40", "markers = 8"),
    ),
    "my-device": (
        ("edge_length = 8.0", "edge_length = 18.0"),
        ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]"),
        ("markers = 40", "markers = 8"),
        ("[[sensors]]", '[design]\nsearches = 1\ndecoder = "affine"\n\n[[sensors]]'),
    ),
}


def make_smaller(device):
    text = device.read_text(encoding="utf-8")
    for old, new in SMALLER[device.parent.name]:
        assert old in text
        text = text.replace(old, new, 1)
    device.write_text(text, encoding="utf-8")


def type_in(folder, line):
    """One command, as a person types it there; those of the toolkit run in this process."""
    words = shlex.split(line)
    if words[0] == "defsense":
        words = [
            f"{start}{match}"
            for start, found in map(partial(expand, folder), words[1:])
            for match in found
        ]
        with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "stdin", io.StringIO())
            patch.setattr(webbrowser, "open", lambda _: True)
            assert main(words) == 0, line
        return
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        words, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT), "PATH": path},
        capture_output=True, text=True, encoding="utf-8", stdin=subprocess.DEVNULL, timeout=1000,
    )  # fmt: skip
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


def expand(folder, word):
    """Return what a word starts with, such as "replay:", and the one file that its `*` means."""
    start, pattern = re.fullmatch(r"(replay:)?(.*)", word, re.DOTALL).groups()
    found = (
        sorted(path.relative_to(folder) for path in folder.glob(pattern)) if "/*" in word else []
    )
    return start or "", [str(found[0])] if found else [pattern]


def write_tables(folder):
    """Write the tables, readings and settings that pages expect their readers to have."""
    rng = np.random.default_rng(0)
    time = np.arange(0, 60, 0.05)
    for k in (1, 2):
        angle = 30 + 20 * np.sin(time * (1 + 0.1 * k)) + 5 * np.sin(0.37 * time)
        signals = [1.2 + 0.01 * angle, 0.9 - 0.004 * angle]
        signals += rng.normal(0, 1e-3, (2, len(time)))
        for name, header, columns in (
            (f"walk-{k}.csv", "time,s1_kohm,s2_kohm", signals),
            (f"knee-{k}.csv", "time,flexion_deg", [angle]),
        ):
            np.savetxt(
                folder / name, np.transpose([time, *columns]), "%.5f", ",", header=header,
                comments="",
            )  # fmt: skip
    rows = ["specimen,jig_radius,channel,resistance"]
    for radius in ("", 250, 150, 100, 75):
        for channel, height in (("top", 5.5), ("neutral", 0.0), ("bottom", -5.5)):
            strain = height / (radius + 7.5) if radius else 0.0
            rows.append(f"150,{radius},{channel},{2200 * (1 + 2.5 * strain):.1f}")
    (folder / "readings.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (folder / "my-device/study.toml").write_text(
        "schema = 1\n[parameters]\ndesign.seed = { range = [1, 2], step = 1 }\n", encoding="utf-8"
    )


@pytest.fixture(scope="module")
def typed(tmp_path_factory):
    """The folder in which the pages were typed."""
    folder = tmp_path_factory.mktemp("guide")
    (folder / "fixtures").symlink_to(ROOT / "fixtures")
    for page in PAGES:
        lines = 0
        for kind, what in steps(page.read_text(encoding="utf-8")):
            if kind == "smaller":
                make_smaller(folder / what / "device.toml")
            else:
                type_in(folder, what)
                lines += 1
        assert lines >= 8, page
    write_tables(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_that_a_page_names_exist(page, typed):
    text = page.read_text(encoding="utf-8")
    names = set(re.findall(r"`(my-[a-z]+/[\w./-]+\.(?:html|pdf|json|3mf))`", text))
    assert names
    for name in names:
        assert (typed / name).stat().st_size > 0, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "instead"),
    [
        pytest.param(line, instead, id=f"{page}: {line}")
        for page, lines in TYPED.items()
        for line, instead in lines.items()
    ],
)
def test_commands_of_other_pages_run(typed, line, instead):
    for command in (instead or line).split(" && "):
        type_in(typed, command)


def test_every_line_of_a_shell_block_is_run_or_has_a_reason():
    """Those of the tutorial are all run."""
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        if path in PAGES:
            continue
        page = path.relative_to(ROOT / "docs" if path.parent != ROOT else ROOT)
        name = page.with_suffix("").as_posix()
        run, not_run = TYPED.get(name, {}), NOT_RUN.get(name, {})
        text = path.read_text(encoding="utf-8")
        assert {*lines_of(text)} <= {*run, *not_run}, name
        words = " ".join(text.replace("\\\n", " ").split())
        assert [line for line in (*run, *not_run) if line not in words] == [], name
        assert not {*run} & {*not_run}
    names = {*TYPED, *NOT_RUN}
    assert {n for n in names if not (ROOT / f"docs/{n}.md").is_file()} == set()


def test_tests_that_run_other_lines_exist():
    reasons = " ".join(reason for lines in NOT_RUN.values() for reason in lines.values())
    named = re.findall(r"tests/[\w/]+", reasons)
    assert named
    assert [n for n in named if not ((ROOT / n).is_dir() or (ROOT / f"{n}.py").is_file())] == []
