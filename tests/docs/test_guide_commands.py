"""Run the commands of the tutorial and of the page on webcams, with a twin instead of hardware.

Then run those of other pages in the same folder, with the files that these pages have created.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys

import pytest

from defsense_fab.cli.main import main
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


_REHEARSAL = "--board my-cameras --calibration rehearsal.toml"
_SHORT = "my-device/model.json --port twin --seconds 5 --json"
#: What other pages say to type, and what is run for it where that needs hardware or takes long: the
#: same command with a twin for the port, less time, or names of what is there ("": as it stands).
ELSEWHERE = {
    "boards": {
        "board wiring my-device --board esp32 --converter ads1115 --out my-wiring": "",
    },
    "check-wiring": {
        "board check my-device --port twin:unit=2,swap=left+right --auto":
            "board check my-joystick --port twin:unit=2 --auto",
    },
    "clearance": {
        "calibrate clearance my-device --fits 0.3": "calibrate clearance my-joystick --fits 0.3",
    },
    "machine": {
        "doctor": "",
        "list materials": "",
        "list printers fdm-tpu": "",
        "completion bash": "",
    },
    "motion-capture": {
        "capture markers my-device": "capture markers my-device --out my-markers",
    },
    "tags": {
        "capture board my-cameras --measured 29.95": "",
    },
    "cameras": {
        "capture camera calibrate twin --board my-cameras --calibration rehearsal.toml":
            f"capture camera calibrate twin {_REHEARSAL} --views 12",
        "capture camera arrange twin --board my-cameras --calibration rehearsal.toml":
            f"capture camera arrange twin {_REHEARSAL} --views 8",
        "capture camera check twin --board my-cameras --calibration rehearsal.toml": "",
    },
    "live": {
        "run my-device/model.json --port twin:seed=7,cut=left@20-30":
            "run my-device/model.json --port twin:seed=7,cut=middle@1-2 --seconds 3 --json",
        "run my-device/model.json --port replay:my-device/session --view":
            "run my-device/model.json --port replay:session --seconds 3 --json",
    },
    "live-outputs": {
        "run my-device/model.json --port /dev/ttyUSB0 --output osc,port=9000 --output websocket":
            f"run {_SHORT} --output osc,port=9000 --output websocket,port=0",
    },
    "live-recording": {
        "run my-device/model.json --port /dev/ttyUSB0 --animation bend.glb":
            f"run {_SHORT} --animation bend.glb",
    },
    "training-data": {
        "dataset my-device/session --device my-device --out my-device/data":
            "dataset session --device my-device --out my-device/data",
        "dataset my-device/session --lerobot policy-data --rate 30":
            "dataset session --lerobot policy-data --rate 30",
    },
    "training": {
        "recalibrate my-device/model.json routine": "recalibrate my-device/model.json session",
    },
    "evaluation": {
        "evaluate model.json session --against affine.json --last-share 0.3":
            "evaluate my-device/model.json session --against my-device/recalibrated.json",
    },
    "twin": {
        "twin my-device --list-assumptions": "",
        "twin my-device --off relaxation,hysteresis,mullins":
            "twin my-device --off relaxation,hysteresis,mullins --minutes 1 --out plain",
        "train my-device/twin-1-1 --device my-device":
            "train plain --device my-device --out plain.json",
    },
}  # fmt: skip


def type_in(folder, line):
    """One command, as a person types it there; those of the toolkit run in this process."""
    words = shlex.split(line)
    if words[0] == "defsense":
        with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "stdin", io.StringIO())
            assert main(words[1:]) == 0, line
        return
    done = subprocess.run(
        words, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True,
        text=True, encoding="utf-8", stdin=subprocess.DEVNULL, timeout=1000,
    )  # fmt: skip
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


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
    ("page", "line", "instead"),
    [(page, line, instead) for page, lines in ELSEWHERE.items() for line, instead in lines.items()],
)
def test_commands_of_other_pages_run(typed, page, line, instead):
    text = (ROOT / f"docs/{page}.md").read_text(encoding="utf-8").replace("\\\n", " ")
    assert f"defsense {line}" in " ".join(text.split())
    type_in(typed, f"defsense {instead or line}")
