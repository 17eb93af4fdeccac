"""Of the layouts that a search found, the one to build."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.core.curve import Plane
from defsense_fab.core.errors import FabricationError
from defsense_fab.optimize.prediction import choose_layout as module
from defsense_fab.optimize.prediction.choose_layout import choose_layout, drop_duplicates
from defsense_fab.optimize.refinement.refine import OptimizedLayout


def layout(straight, rmse, planes, slivers=False):
    """One cord for each of so many planes."""
    cords = tuple(straight(f"c{k}", z=float(k)) for k in range(planes))
    return OptimizedLayout(cords, rmse, slivers, (), cords)


def tilted(found):
    """The same layout with all planes turned by 30 degrees about x."""
    turn = Rotation.from_euler("x", 30, degrees=True).as_matrix()
    cords = [replace(s, plane=Plane(s.plane.origin, turn @ s.plane.axes)) for s in found.sensors]
    return replace(found, sensors=tuple(cords))


@pytest.fixture
def weigh(monkeypatch, bar):
    """Chooses among layouts (with one plane more than what follows) whose `made` tells the error as
    built, the number of parts and the warnings, or why they cannot be made."""

    def run(found, made, prefer="simple", kind="print", locks=()):
        """Of cast ones those whose numbers of parts are in `locks` have no moulds."""
        tried = []

        def fabricate(device, surface, sensors, report, solid, bay):
            result = next(m for f, m in zip(found, made, strict=True) if f.sensors is sensors)
            tried.append(result)
            if isinstance(result, str):
                raise FabricationError(result)
            built, parts, warnings = result
            parts, free = parts if isinstance(parts, tuple) else (parts, 0)
            part = SimpleNamespace(volume=1000.0 / parts)
            ends = [SimpleNamespace(pocket=0.0)] * free + [SimpleNamespace(pocket=7.0)]
            return SimpleNamespace(
                channels=[SimpleNamespace(ends=ends, built=built)],
                parts=[part] * parts,
                warnings=("note",) * warnings,
            )

        monkeypatch.setattr(module, "fabricate", fabricate)
        monkeypatch.setattr(
            module,
            "score_channels",
            lambda task, channels: SimpleNamespace(
                prediction=SimpleNamespace(unseen=channels[0].built), cords=()
            ),
        )

        def moulds(made, rules, report):
            if len(made.parts) in locks:
                raise FabricationError(f"mould of {len(made.parts)} parts locks")

        monkeypatch.setattr(module, "decide_strain_relief", lambda device, *_: (device, []))
        monkeypatch.setattr(module, "find_overstretched_cords", lambda *_: [])
        monkeypatch.setattr(module, "mould_rules", lambda device: None)
        monkeypatch.setattr(module, "check_openings", lambda made, rules: None)
        monkeypatch.setattr(module, "make_moulds", moulds)
        monkeypatch.setattr(
            module,
            "_score_design",
            lambda task, one: SimpleNamespace(prediction=SimpleNamespace(unseen=one.rmse)),
        )
        fabrication = SimpleNamespace(pockets=True, kind=kind)
        device = SimpleNamespace(prefer=prefer, fabrication=fabrication)
        return (*choose_layout(device, None, found, bar, None, lambda f, m: None), tried)

    return run


def test_the_simplest_of_similar_layouts_is_chosen(straight, weigh):
    found = [layout(straight, 0.50, 3), layout(straight, 0.51, 3), layout(straight, 0.52, 2)]
    chosen, trials, _ = weigh(found, [(0.500, 5, 0), (0.502, 4, 0), (0.520, 3, 1)])
    assert (chosen.built, chosen.parts) == (0.502, 4)  # three parts, but something is to be said
    assert [t.found for t in trials] == found
    chosen, _, _ = weigh(found, [(0.500, 5, 0), (0.502, 4, 0), (0.520, 3, 0)])
    assert chosen.parts == 3
    chosen, _, _ = weigh(found, [(0.500, 5, 0), (0.502, 4, 0), (0.530, 3, 0)])
    assert chosen.parts == 4  # the simplest one is six per cent worse


def test_an_end_without_a_pocket_counts_as_a_part(straight, weigh):
    found = [layout(straight, 0.50, 3), layout(straight, 0.51, 3)]
    chosen, _, _ = weigh(found, [(0.500, (4, 2), 0), (0.510, (5, 0), 0)])
    assert (chosen.parts, chosen.free_ends) == (5, 0)


def test_accuracy_is_judged_as_built(straight, weigh):
    found = [layout(straight, 0.50, 3), layout(straight, 0.51, 3)]
    chosen, _, _ = weigh(found, [(0.60, 2, 0), (0.55, 6, 3)], prefer="accuracy")
    assert chosen.built == 0.55


def test_the_next_layout_replaces_one_that_cannot_be_made(straight, weigh):
    found = [layout(straight, 0.5, 3), layout(straight, 0.7, 3), layout(straight, 0.9, 3)]
    chosen, trials, tried = weigh(found, ["in pieces", (0.71, 4, 1), (0.91, 2, 0)])
    assert chosen.built == 0.71
    assert trials[0].problem == "in pieces"
    assert len(tried) == 2  # those that are much worse are tried only until one can be made
    chosen, trials, _ = weigh(found, ["in pieces", "too thin", "too long"])
    assert chosen is trials[0]
    assert [t.problem for t in trials] == ["in pieces", "too thin", "too long"]


def test_the_next_layout_replaces_one_that_cannot_be_cast(straight, weigh):
    found = [layout(straight, 0.50, 3), layout(straight, 0.51, 3), layout(straight, 0.90, 3)]
    made = [(0.50, 3, 0), (0.51, 4, 0), (0.91, 5, 0)]
    chosen, trials, _ = weigh(found, made, kind="cast", locks={3})
    assert (chosen.built, [t.problem for t in trials]) == (0.51, ["mould of 3 parts locks", None])
    chosen, trials, tried = weigh(found, made, kind="cast", locks={3, 4})
    assert (chosen.built, len(tried)) == (0.91, 3)  # far worse: tried only for want of others
    chosen, trials, _ = weigh(found, made, kind="cast", locks={3, 4, 5})
    assert chosen is trials[0]
    assert [t.problem for t in trials] == [f"mould of {n} parts locks" for n in (3, 4, 5)]


def test_layouts_with_fewer_planes_are_always_tried(straight, weigh):
    found = [layout(straight, 0.5, 3), layout(straight, 1.5, 1), layout(straight, 2.5, 4)]
    chosen, trials, _ = weigh(found, [(0.5, 4, 0), (1.5, 2, 0), (2.5, 9, 0)])
    assert chosen.built == 0.5
    assert [(t.planes, t.parts) for t in trials] == [(3, 4), (1, 2)]
    found = [layout(straight, 0.5, 1), layout(straight, 0.52, 3), layout(straight, 1.5, 2)]
    _, trials, _ = weigh(found, ["in pieces", (0.52, 4, 0), (1.5, 3, 0)])
    assert [(t.planes, t.problem) for t in trials] == [(1, "in pieces"), (3, None), (2, None)]


def test_slivers_come_last_and_equal_layouts_are_dropped(straight):
    found = [
        layout(straight, 0.4, 2, slivers=True),
        layout(straight, 0.5, 2),
        layout(straight, 0.5 * (1 + 1e-6), 2),
        layout(straight, 0.5, 1),
    ]
    assert [(f.rmse, f.slivers) for f in drop_duplicates(found)] == [
        (0.5, False),
        (0.5, False),
        (0.4, True),
    ]


def test_planes_along_faces_are_simpler_and_always_tried(straight, weigh):
    found = [tilted(layout(straight, e, 2)) for e in (0.50, 0.52)] + [layout(straight, 0.9, 2)]
    made = [(0.50, 3, 0), (0.52, 3, 0), (0.90, 3, 0)]
    chosen, trials, _ = weigh(found, made)
    assert (chosen.built, [t.slanted for t in trials]) == (0.50, [1, 1, 0])
    chosen, trials, _ = weigh([found[0], replace(found[2], rmse=0.52)], [made[0], (0.52, 3, 0)])
    assert (chosen.built, chosen.slanted) == (0.52, 0)
