"""Fig. 5 of the paper from Python: one cord as drawn and refined, as the design predicts them.

python reproduce.py
"""

import shutil
import tempfile
from pathlib import Path

from defsense_fab.core.device.device_file import load_device
from defsense_fab.store.layout import load_layout
from defsense_fab.workflow.build.build import build

here = Path(__file__).parent
with tempfile.TemporaryDirectory() as folder:
    device = Path(folder) / "twist-bar"
    shutil.copytree(here, device, ignore=shutil.ignore_patterns("build", ".build*"))
    # With as many planes as are drawn there is no search: descents begin at the drawing, pushed
    # aside a little. Exactly at it the gradient vanishes, as its mirror images are equally good.
    with (device / "device.toml").open("a", encoding="utf-8") as file:
        file.write('\n[design]\nplanes = 1\ndecoder = "affine"\n')
    made = build(load_device(device), "optimize")
    layout = load_layout(made.folder)
    drawn, refined = layout.initial.unseen, layout.prediction.unseen
    print(f"as drawn {drawn:.2f} mm, refined {refined:.2f} mm: {drawn / refined:.1f} times better")
    print(f"no affine map of one signal does better than {layout.prediction.floor:.2f} mm")
