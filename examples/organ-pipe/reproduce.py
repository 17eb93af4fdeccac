"""Fig. 9 of the paper from Python: an instrument whose poses are told apart.

python reproduce.py                # at full size, which takes hours
python reproduce.py --quick        # in minutes

`defsense reproduce organ-pipe` does the same; examples/bar/reproduce.py has its steps one by one.
"""

import sys
from pathlib import Path

from defsense_fab.workflow.reproduce.experiments.experiment_file import load_experiment
from defsense_fab.workflow.reproduce.run import reproduce

quick = "--quick" in sys.argv
experiment = load_experiment(Path(__file__).parent).at_size(quick=quick, units=1)
results = reproduce([experiment], Path("reproduced-quick" if quick else "reproduced"))
(found,) = results["experiments"]
told = found["layouts"]["full"]["units"][0]["told_apart"]
print(f"{told['share']:.2%} of {told['frames']} pictures with one pose are told apart")
for pose, share in told["by_pose"].items():
    print(f"  {pose:6} {share:.2%}")
