"""Completions that a shell shows."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("line", "completions"),
    [
        ("defsense new x --cord rubber-1", ["rubber-1.7mm "]),
        ("defsense new x --poses bend,t", ["bend,twist "]),
        ("defsense new x --body b", ["bar", "blob", "body.stl"]),
        ("defsense new x --units i", ["inch "]),
        ("defsense build d", ["device/"]),
    ],
)
def test_completions(line, completions, tmp_path):
    (tmp_path / "body.stl").touch()
    (tmp_path / "device").mkdir()
    (tmp_path / "device" / "device.toml").touch()
    (tmp_path / "docs").mkdir()  # not a device
    output = str(tmp_path / ".output")
    subprocess.run(
        [sys.executable, "-m", "defsense_fab.cli.main"], cwd=tmp_path, check=True,
        env=os.environ | {
            "_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_STDOUT_FILENAME": output,
            "COMP_LINE": line, "COMP_POINT": str(len(line)),
        },
    )  # fmt: skip
    assert Path(output).read_text(encoding="utf-8").split("\n") == completions
