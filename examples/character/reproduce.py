"""Fig. 8 of the paper from Python: a character's cords as drawn by hand, and optimised.

python reproduce.py                # at full size, which takes hours
python reproduce.py --quick        # in minutes
"""

import sys
from dataclasses import replace
from pathlib import Path

from defsense_fab.core.progress import silent
from defsense_fab.pipeline.reproduce.devices.layouts import built_layout, simulated_device
from defsense_fab.pipeline.reproduce.devices.sessions import tags_of, tested_unit
from defsense_fab.pipeline.reproduce.experiments.experiment_file import load_experiment

quick = "--quick" in sys.argv
out = Path("reproduced-quick" if quick else "reproduced") / "character"
experiment = load_experiment(Path(__file__).parent).at_size(quick=quick, units=1)

# Poses are solved once; each layout is a device folder of its own, built as any other.
poses = simulated_device(experiment, out, silent)
devices = {c.name: built_layout(experiment, c, poses, out, silent) for c in experiment.layouts}

# All layouts carry the same tags, and their first unit is moved by the same hand.
tags = tags_of(experiment, devices["full"], out, silent)
for name, device in devices.items():
    found = tested_unit(experiment, device, replace(tags, device=device.name), 1, silent)
    e = found["chosen"]
    print(
        f"{name:7} {e['rmse']:5.2f} ± {e['deviation']:.2f} mm, peak {e['peak']:.1f},"
        f" average peak {e['average_peak']:.2f}; {found['decoder']}"
    )
