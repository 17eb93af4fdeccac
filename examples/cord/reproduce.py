"""Reproduce Fig. 3 of the paper: fit the response of a cord to specimens bent on jigs.

Two specimens are simulated: no hardware is needed. The response of their cords bends off its slope
at rest, as none of the fitted models does; the 95 % interval must contain the slope all the same.

python reproduce.py
"""

import tempfile

import numpy as np

import defsense_fab as df

K_RES = 2.0  # slope of (R - R0)/R0 over strain at rest
BENDING_STRAIN = 0.15  # at which the response has left its slope at rest

strains = np.arange(-48, 49) / 400
changes = K_RES * BENDING_STRAIN * (1 - np.exp(-strains / BENDING_STRAIN))
table = {"strains": strains.tolist(), "changes": changes.tolist()}

with tempfile.TemporaryDirectory() as folder:
    sessions = df.simulate_specimens(
        folder, df.ResponseSpec("piecewise", table), lengths=(150, 200)
    )
    response = df.fit_response(sessions).data
low, high = response["interval"]
print(f"k_res = {response['k_res']:.3f}, 95 % interval {low:.3f} to {high:.3f}; true {K_RES}")
print(f"w(eps): {response['model']}, {response['reason']}")
