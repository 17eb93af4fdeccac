"""Reproduce Fig. 8 of the paper: cords of a character, drawn by hand and optimized.

python reproduce.py                # full size, takes hours
python reproduce.py --quick        # small size, takes minutes

`defsense reproduce character` runs the same experiment, and writes a page of its results.
"""

import sys
from pathlib import Path

import defsense_fab as df

quick = "--quick" in sys.argv
experiment = df.load_experiment(Path(__file__).parent, quick=quick, units=1)
results = df.reproduce(experiment, "reproduced-quick" if quick else "reproduced")
for name, layout in results["layouts"].items():
    errors = layout["units"][0]["chosen"]
    print(
        f"{name:7} {errors['rmse']:5.2f} ± {errors['deviation']:.2f} mm, peak {errors['peak']:.1f}"
    )
