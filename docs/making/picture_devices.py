"""Make the devices and parts that the pictures of the pages on making show."""

import shutil
import subprocess
import sys
from pathlib import Path

FIXTURES = Path(__file__).parents[2] / "fixtures" / "devices"
BAY = "[body.bay]\nat = [0, 0, 0]\nsize = [14, 7, 8]\n\n[material]"


def defsense(*words):
    """Return the command line of a `defsense` command."""
    return [sys.executable, "-m", "defsense_fab", *words]


def run(folder, *words):
    """Run a `defsense` command in a folder."""
    subprocess.run(defsense(*words), cwd=folder, check=True, stdin=subprocess.DEVNULL)


def make_joystick(folder):
    """Build the joystick of the tutorial."""
    run(folder, "new", "my-joystick", "--body", "joystick")
    run(folder, "build", "my-joystick")


def make_bar(folder):
    """Build the bar, whose cords are in several planes, with a coarse mesh."""
    changes = [
        ("edge_length = 8.0", "edge_length = 12.0"),
        ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [1.0]"),
        ("markers = 40", "markers = 8"),
    ]
    make_changed(folder, "my-bar", "bar", changes, "build")


def make_changed(folder, name, start, changes, *words):
    """Copy a device, replace texts of its device.toml, and run a command with it."""
    shutil.copytree(FIXTURES / start, folder / name, ignore=shutil.ignore_patterns("build"))
    file = folder / name / "device.toml"
    text = file.read_text(encoding="utf-8")
    for old, new in changes:
        if old not in text:
            raise ValueError(f"{file}: no {old!r}")
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")
    run(folder, *words, name)


def make_cast(folder):
    """Make the moulds of a joystick of silicone, with a coarse mesh."""
    changes = [
        ("edge_length = 5.0", "edge_length = 9.0"),
        ('decoder = "kernel"', 'decoder = "affine"'),
        ("markers = 40", "markers = 8"),
        ('name = "ninjaflex-85a"', 'name = "dragon-skin-30"'),
        ('process = "fdm-tpu"', 'process = "cast-silicone"'),
    ]
    make_changed(folder, "my-cast", "joystick", changes, "fabricate")


def make_bay(folder):
    """Make the parts of a bar with two cords and a bay for a connector, with a coarse mesh."""
    text = (FIXTURES / "bar" / "device.toml").read_text(encoding="utf-8")
    middle = next(t for t in text.split("[[sensors]]") if 'name = "B"' in t)
    middle = f"[[sensors]]{middle}".replace('free = ["path", "plane"]', "free = []")
    changes = [
        ("edge_length = 8.0", "edge_length = 14.0"),
        ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [1.0]"),
        ("markers = 40", "markers = 8"),
        ('free = ["path", "plane"]', "free = []"),
        ("[material]", BAY),
        ("origin = [0, 8, 0]", "origin = [0, 11.3, 0]"),
        ("origin = [0, -8, 0]", "origin = [0, -11.3, 0]"),
        (middle, ""),
    ]
    make_changed(folder, "my-bay", "bar", changes, "fabricate")


def make_poses(folder):
    """Solve the four poses of a new bar."""
    shutil.copy(FIXTURES / "bar" / "bar.py", folder)
    poses = ("--poses", "bend,bend_side,twist,pull", "--edge-length", "10")
    run(folder, "new", "my-poses", "--body", "bar.py", *poses, "--material", "ninjaflex-85a")
    run(folder, "simulate", "my-poses")


def make_response(folder):
    """Fit the response of simulated specimens."""
    run(folder, "calibrate", "twin", "my-response", "--lengths", "150,200")
    sessions = ("my-response/session-150", "my-response/session-200")
    run(folder, "calibrate", "fit", *sessions, "--out", "my-response/response.json")


MADE = {
    "my-joystick/build/guide.html": make_joystick,
    "my-bar/build/guide.html": make_bar,
    "my-cast/build/parts/manifest.json": make_cast,
    "my-bay/build/parts/manifest.json": make_bay,
    "my-poses/build/mesh.vtu": make_poses,
    "my-response/response.html": make_response,
    "my-specimen": lambda folder: run(folder, "calibrate", "specimen", "my-specimen"),
    "my-coupon": lambda folder: run(folder, "calibrate", "coupon", "my-coupon"),
    "my-traces": lambda folder: run(
        folder, "calibrate", "trace-coupon", "my-traces", "--trace", "eel"
    ),
}
