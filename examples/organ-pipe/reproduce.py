"""Reproduce Fig. 9 of the paper: an instrument whose poses are distinguished.

python reproduce.py                # full size, takes hours
python reproduce.py --quick        # small size, takes minutes

`defsense reproduce organ-pipe` runs the same experiment, and writes a page of its results.
"""

import sys
from pathlib import Path

import defsense_fab as df

quick = "--quick" in sys.argv
experiment = df.load_experiment(Path(__file__).parent, quick=quick, units=1)
results = df.reproduce(experiment, "reproduced-quick" if quick else "reproduced")
poses = results["layouts"]["full"]["units"][0]["told_apart"]
print(f"the pose is recognized in {poses['share']:.2%} of {poses['frames']} frames with one pose")
for pose, share in poses["by_pose"].items():
    print(f"  {pose:6} {share:.2%}")
