"""What the scripts that make the guide's pictures share: commands to run first, and a browser."""

import os
import shutil
import subprocess
import sys
from pathlib import Path


def make_missing(folder, made):
    """Run the commands whose results a folder lacks; create the folder if it is missing.

    Args:
        folder: The folder in which the commands run.
        made: Words of each `defsense` command, by the file that it writes.

    Returns:
        The folder as a Path.
    """
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    for result, words in made.items():
        if not (folder / result).exists():
            command = [sys.executable, "-m", "defsense_fab.cli.main", *words]
            subprocess.run(command, cwd=folder, check=True, stdin=subprocess.DEVNULL)
    return folder


def open_chromium(playwright):
    """Return the installed Chromium, which renders by the CPU."""
    switches = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    switches += ["--no-sandbox"] if os.geteuid() == 0 else []
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    return playwright.chromium.launch(executable_path=program, args=switches)
