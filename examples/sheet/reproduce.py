"""Fig. 6 of the paper from Python: a sheet with two cords, and with four.

python reproduce.py                # at full size, which takes hours
python reproduce.py --quick        # in minutes

`defsense reproduce sheet` does the same; examples/bar/reproduce.py has its steps one by one.
"""

import sys
from pathlib import Path

from defsense_fab.workflow.reproduce.experiments.experiment_file import load_experiment
from defsense_fab.workflow.reproduce.run import reproduce

quick = "--quick" in sys.argv
experiment = load_experiment(Path(__file__).parent).at_size(quick=quick, units=1)
results = reproduce([experiment], Path("reproduced-quick" if quick else "reproduced"))
(found,) = results["experiments"]
for name, layout in found["layouts"].items():
    e = layout["units"][0]["chosen"]
    print(f"{name:7} {e['rmse']:5.2f} ± {e['deviation']:.2f} mm, peak {e['peak']:.1f}")
