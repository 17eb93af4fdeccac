"""The state of the steps, and what is next, follow from the device and its build."""

import pytest

from defsense_fab.studio.session.pipeline import LimitState, Progress, next_action, pipeline

STAGES = ("body", "mesh", "simulate", "optimize", "fabricate", "report")


def progress(current=(), old=(), **values):
    freshness = {s: "current" if s in current else "old" if s in old else "missing" for s in STAGES}
    defaults = {
        "has_body": True, "poses": 2, "cords": 2, "proposed": 0, "can_move": True,
        "limits": LimitState(), "misfit": "",
        "is_optimized": False, "noun": "cord", "has_model": False,
    }  # fmt: skip
    return Progress(freshness=freshness, **{**defaults, **values})


def states(p):
    return {step.name: step.state for step in pipeline(p).steps}


@pytest.mark.parametrize(
    ("p", "step", "stage"),
    [
        (progress(has_body=False), "body", None),
        (progress(poses=0), "poses", None),
        (progress(), "poses", "simulate"),
        (progress((), STAGES, misfit="1 region lies outside the body"), "poses", None),
        (progress(STAGES[:3], cords=0), "sensors", None),
        (progress(STAGES[:3], cords=0, proposed=2), "optimize", "optimize"),
        (progress(STAGES[:3], limits=LimitState(is_broken=True, broken_cord="a")), "sensors", None),
        (progress(STAGES[:3]), "optimize", "optimize"),
        (progress(STAGES[:4]), "make", "report"),
        (progress(STAGES), "measure", None),
        (progress((), STAGES), "poses", "simulate"),
        (progress(STAGES[:3], can_move=False), "make", "report"),
        (progress(STAGES[:3], STAGES[3:]), "optimize", "optimize"),
        (progress(STAGES[:3], STAGES[3:], is_optimized=True), "make", "report"),
    ],
)
def test_next_action_is_the_first_that_is_missing(p, step, stage):
    action = next_action(p)
    assert (action.step, action.stage) == (step, stage)


def test_new_device_has_everything_blocked_but_the_body():
    found = states(progress(has_body=False, poses=0, cords=0))
    assert found.pop("body") == "ready"
    assert set(found.values()) == {"blocked"}


def test_built_device_is_done():
    assert set(states(progress(STAGES, has_model=True)).values()) == {"done"}


def test_changed_body_makes_later_steps_stale():
    found = states(progress((), STAGES))
    assert {"body", "poses", "inside", "optimize", "make"} == {
        name for name, state in found.items() if state == "stale"
    }


def test_region_outside_the_body_makes_the_poses_stale():
    assert states(progress(STAGES, misfit="1 region lies outside the body"))["poses"] == "stale"


def test_next_action_names_the_cord_that_breaks_a_limit():
    limits = LimitState(is_broken=True, broken_cord="a")
    assert next_action(progress(STAGES[:3], limits=limits)).cord == "a"
    assert not next_action(progress(STAGES[:3])).cord


def test_broken_limit_makes_the_sensors_stale():
    assert states(progress(STAGES[:3], limits=LimitState(is_broken=True)))["sensors"] == "stale"


def test_cords_taken_from_the_last_search_are_optimized():
    found = states(progress(STAGES[:3], STAGES[3:], is_optimized=True))
    assert (found["optimize"], found["make"]) == ("done", "stale")


def test_cords_that_are_being_checked_are_not_done():
    limits = LimitState(is_being_checked=True)
    found = pipeline(progress(STAGES[:3], limits=limits))
    assert states(progress(STAGES[:3], limits=limits))["sensors"] == "ready"
    assert found.next == pipeline(progress(STAGES[:3])).next
