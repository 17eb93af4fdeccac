"""Reproduce Table 1 of the paper: three layouts of one bar.

Each layout is built as a device, recorded by a simulated twin, trained on and tested. The poses are
solved once. All layouts carry the same tags, and the same hand movement deforms them.

python reproduce.py                # full size, takes hours
python reproduce.py --quick        # small size, takes minutes

`defsense reproduce bar` runs the same experiment, and writes a page of its results.
"""

import sys
from pathlib import Path

import defsense_fab as df

quick = "--quick" in sys.argv
experiment = df.load_experiment(Path(__file__).parent, quick=quick, units=1)
results = df.reproduce(experiment, "reproduced-quick" if quick else "reproduced")
for name, layout in results["layouts"].items():
    unit = layout["units"][0]
    errors = unit["chosen"]
    print(
        f"{name:7} {errors['rmse']:5.2f} ± {errors['deviation']:.2f} mm, peak {errors['peak']:.1f},"
        f" average peak {errors['average_peak']:.2f}; {unit['decoder']}"
    )
