"""Table 1 of the paper from Python: three layouts of one bar, built, recorded, trained, tested.

python reproduce.py                # at full size, which takes hours
python reproduce.py --quick        # in minutes
"""

import sys
from dataclasses import replace
from pathlib import Path

from defsense_fab.core.progress import silent
from defsense_fab.workflow.reproduce.devices.layouts import build_layout, simulate_device
from defsense_fab.workflow.reproduce.devices.sessions import place_tags, evaluate_unit
from defsense_fab.workflow.reproduce.experiments.experiment_file import load_experiment
from defsense_fab.twin.devices.device_fields import share_fields

quick = "--quick" in sys.argv
out = Path("reproduced-quick" if quick else "reproduced") / "bar"
experiment = load_experiment(Path(__file__).parent).at_size(quick=quick, units=1)

# Poses are solved once; each layout is a device folder of its own, built as any other.
poses = simulate_device(experiment, out, silent)
devices = {c.name: build_layout(experiment, c, poses, out, silent) for c in experiment.layouts}

# All layouts carry the same tags, their first unit is moved by the same hand, and the states that
# the twin is solved in serve all of them.
tags = place_tags(experiment, devices["full"], out, silent)
first = None
for name, device in devices.items():
    if first is not None:
        share_fields(first, device)
    first = first or device
    found = evaluate_unit(experiment, device, replace(tags, device=device.name), 1, silent)
    e = found["chosen"]
    print(
        f"{name:7} {e['rmse']:5.2f} ± {e['deviation']:.2f} mm, peak {e['peak']:.1f},"
        f" average peak {e['average_peak']:.2f}; {found['decoder']}"
    )
