"""Run a small study of the bar, and take its picture.

python docs/study/make_pictures.py FOLDER
"""

import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
BAR = HERE.parents[1] / "fixtures" / "devices" / "bar"
COARSE = (  # the same in less time
    ("edge_length = 8.0", "edge_length = 12.0"),
    ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]"),
    ("[fabrication]", '[design]\nsearches = 3\ndecoder = "affine"\n\n[fabrication]'),
)
STUDY = """schema = 1

[parameters]
body.parameters.height = [20, 24, 28]
cord.noise = [0.001, 0.002, 0.004]
"""


def main():
    """Run the study in FOLDER, and write `study.png`."""
    folder = Path(sys.argv[1]) / "bar"
    if not folder.exists():
        shutil.copytree(BAR, folder)
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    for old, new in COARSE:
        text = text.replace(old, new, 1)
    (folder / "device.toml").write_text(text, encoding="utf-8")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    words = ("study", folder, "--workers", "1")
    subprocess.run([sys.executable, "-m", "defsense_fab.cli.main", *words], check=True)
    with Image.open(folder / "study" / "study.png") as image:
        reduced = image.convert("RGB").quantize(64, dither=Image.Dither.NONE)
    reduced.save(HERE / "study.png", optimize=True)


if __name__ == "__main__":
    main()
