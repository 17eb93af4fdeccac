"""Fig. 9 of the paper from Python: an instrument whose poses are told apart.

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
out = Path("reproduced-quick" if quick else "reproduced") / "organ-pipe"
experiment = load_experiment(Path(__file__).parent).at_size(quick=quick, units=1)

# Poses are solved once; each layout is a device folder of its own, built as any other.
poses = simulated_device(experiment, out, silent)
devices = {c.name: built_layout(experiment, c, poses, out, silent) for c in experiment.layouts}

# Its first unit is recorded, trained and tested on which of the poses is made.
device = devices["full"]
tags = tags_of(experiment, device, out, silent)
found = tested_unit(experiment, device, replace(tags, device=device.name), 1, silent)
told = found["told_apart"]
print(f"{told['share']:.2%} of {told['pictures']} pictures with one pose are told apart")
for pose, share in told["by_pose"].items():
    print(f"  {pose:6} {share:.2%}")
