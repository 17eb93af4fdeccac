"""Reproduce Fig. 5 of the paper: predict the errors of one cord as drawn, and as refined.

python reproduce.py
"""

from pathlib import Path

import defsense_fab as df

# With one plane per drawn cord there is no search. The descents start near the drawing, not exactly
# at it: there the gradient vanishes, as the mirror images of the cord are equally good.
device = df.Device.load(Path(__file__).parent)
device = device.changed({"design.planes": 1, "design.decoder": "affine"})
layout = df.optimize(df.simulate(device))
drawn, refined = layout.record.initial.unseen, layout.prediction.unseen
print(f"as drawn {drawn:.2f} mm, refined {refined:.2f} mm: {drawn / refined:.1f} times better")
print(f"no affine map of one signal has an error below {layout.prediction.floor:.2f} mm")
