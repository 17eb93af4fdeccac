"""A calibration session without frames, and the specimen that it measures."""

from defsense_fab.calibration import session as sessions
from defsense_fab.core.storage.session_manifest import Criterion

SPECIMEN = {
    "length": 150,
    "thickness": 15,
    "channels": {"inner": 2},
    "jigs": [{"radius": r} for r in (None, 75, 112, 200)],
}


def create_session(folder, rounds=1, radii=(75.0, 112.0, 200.0)):
    return sessions.create_session(
        folder,
        name="s",
        geometry=sessions.Geometry(),
        length=150,
        radii=radii,
        rounds=rounds,
        faces=["a", "b"],
        seed=1,
        reference=[2200.0] * 3,
        criterion=Criterion(),
        rate=20,
        average=None,
    )
