"""An interrupted solve keeps its solved jobs, and resumes with the same results."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device import PointDrag
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh, boundary_faces
from defsense_fab.mechanics.loading.boundary_conditions import Pressure
from defsense_fab.mechanics.solver import solved_jobs
from defsense_fab.mechanics.solver.batch import Job, solve_all
from defsense_fab.mechanics.solver.load_stepping import Status
from defsense_fab.mechanics.solver.solved_jobs import keep_solved_jobs
from tests.conftest import structured_bar
from tests.mechanics.conftest import FREE, MODELS

pytestmark = pytest.mark.slow

MATERIAL = MODELS["neo-hookean"]
FRACTIONS = (0.5, 1.0)


@pytest.fixture(scope="module")
def small():
    return QuadraticMesh.from_linear(structured_bar([0, -7, -7], [100, 8, 8], [8, 2, 2]))


@pytest.fixture(scope="module")
def jobs(small, clamp):
    """Return jobs with every kind of load, one of which is not reached."""
    pressed = Pressure(boundary_faces(small)[:6], 0.01)
    drag = PointDrag(np.array([100.0, 0, 0]), np.array([0, 0, 5.0]), 0.05)
    pushed = clamp(small, [0, 0.2, 0], FREE, gravity=np.array([0, 0, -1e-5]))
    handle = replace(pushed.handles[0], further_translation=np.array([0, 0, 3.0]))
    crushed = clamp(small, translation=[-99.9, 0, 0])
    return [
        Job(clamp(small, [0, 0.3, 0], [-3, 0, 0]), FRACTIONS),
        Job(clamp(small, [0, 0.1, 0], pressures=(pressed,), drags=(drag,)), FRACTIONS),
        Job(replace(pushed, handles=(handle,)), FRACTIONS),
        Job(crushed, FRACTIONS),
    ]


@pytest.fixture(scope="module")
def expected(small, jobs):
    return solve_all(small, MATERIAL, jobs)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    return tmp_path / "solved"


class Solver:
    """`solve_all`, which is interrupted after some jobs, and counts those that it solves."""

    def __init__(self, interrupted_after=None):
        self.solved, self.limit = 0, interrupted_after

    def __call__(self, mesh, material, jobs, on_step=None, on_solved=None):
        def count(job, equilibria):
            on_solved(job, equilibria)
            self.solved += 1
            if self.solved == self.limit:
                raise KeyboardInterrupt

        return solve_all(mesh, material, jobs, on_step, 1, count)


def interrupt(small, jobs, after, version=1):
    with pytest.raises(KeyboardInterrupt), keep_solved_jobs(version) as kept:
        kept.solve(Solver(after), small, MATERIAL, jobs)


def resume(small, jobs, version=1, material=MATERIAL):
    """Return the results, and the number of jobs that had to be solved."""
    solver = Solver()
    with keep_solved_jobs(version) as kept:
        return kept.solve(solver, small, material, jobs), solver.solved


def content(value):
    """Return a result without its wall time, with arrays as bytes."""
    plain = [
        [
            e.status,
            e.amplitude,
            replace(e.statistics, seconds=0.0),
            e.problem,
            e.state,
            e.last_state,
        ]
        for e in value
    ]
    return repr(solved_jobs._plain(plain))


@pytest.mark.parametrize("after", [1, 2, 3, 4])
def test_resumed_solve_has_the_same_results_bit_for_bit(small, jobs, expected, folder, after):
    interrupt(small, jobs, after)
    assert len(list(folder.iterdir())) == after
    results, solved = resume(small, jobs)
    assert solved == len(jobs) - after
    assert list(map(content, results)) == list(map(content, expected))
    assert list(folder.iterdir()) == []


def test_a_state_that_was_not_reached_is_kept(small, jobs, expected, folder):
    assert expected[-1][-1].status is Status.NOT_REACHED
    interrupt(small, jobs, 4)
    (result,), solved = resume(small, jobs[-1:])
    assert solved == 0
    assert content(result) == content(expected[-1])


def test_other_input_is_solved(small, jobs, folder):
    interrupt(small, jobs[:1], 1)
    moved = replace(small, nodes=small.nodes + 1.0)
    other = turn_more(jobs[0], 1.01)
    for arguments in (
        {"version": 2},
        {"material": MODELS["stable"]},
        {"small": moved},
        {"jobs": [other]},
        {"jobs": [replace(jobs[0], fractions=(0.25, 1.0))]},
    ):
        assert resume(**({"small": small, "jobs": jobs[:1]} | arguments))[1] == 1
    assert resume(small, jobs[:1])[1] == 0


def turn_more(job, factor):
    handle = job.conditions.handles[0]
    turned = replace(handle, rotation=factor * handle.rotation)
    return replace(job, conditions=replace(job.conditions, handles=(turned,)))


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9])
def test_damaged_files_are_solved_again(small, jobs, expected, folder, keep):
    interrupt(small, jobs, 1)
    (path,) = folder.iterdir()
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    results, solved = resume(small, jobs)
    assert solved == len(jobs)
    assert list(map(content, results)) == list(map(content, expected))


def test_folder_that_cannot_be_written_does_not_stop_the_solve(small, jobs, folder):
    folder.write_text("")
    assert resume(small, jobs[:1])[1] == 1


def test_oldest_files_are_deleted(small, jobs, folder, monkeypatch):
    monkeypatch.setattr(solved_jobs, "MAX_KEPT_BYTES", 0)
    interrupt(small, jobs, 2)
    assert list(folder.iterdir()) == []


def test_number_of_jobs_that_were_solved_before_is_reported(small, jobs):
    interrupt(small, jobs, 2)
    messages, steps = [], []

    def report_step(job, reached):
        steps.append((job, reached))

    with keep_solved_jobs(1, messages.append) as kept:
        results = kept.solve(solve_all, small, MATERIAL, jobs, report_step)
    (message,) = messages
    assert "2 of 4" in message
    reached = [k for k, result in enumerate(results) if result[-1].converged]
    assert set(reached) <= {job for job, fraction in steps if fraction == 1.0}
