"""Fig. 3 of the paper from Python: specimens on jigs, and the response that is fitted to them.

python reproduce.py
"""

import tempfile
from pathlib import Path

from defsense_fab.workflow.calibrate.fit_response import fit_response
from defsense_fab.twin.calibration_session import record_twin
from defsense_fab.workflow.reproduce.cord_experiment import make_true_response
from defsense_fab.twin.electronics.cords import CordTraits

K_RES = 2.0  # the twin's slope at rest; its response bends off beyond, as no fitted model does

with tempfile.TemporaryDirectory() as folder:
    sessions = []
    for length in (150, 200):
        session = Path(folder) / f"{length}-mm"
        record_twin(session, CordTraits(make_true_response(K_RES)), seed=length, length=length)
        sessions.append(session)
    found = fit_response(sessions)
    low, high = found.data["interval"]
    print(
        f"k_res = {found.data['k_res']:.3f}, 95 % between {low:.3f} and {high:.3f};"
        f" the twin's is {K_RES}"
    )
    print(f"w(eps): {found.calibration.response.model}, {found.data['reason']}")
