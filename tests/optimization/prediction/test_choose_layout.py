"""Choose the layout to build among those of a search."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.core.curve import Plane
from defsense_fab.core.errors import FabricationError
from defsense_fab.optimization.prediction import choose_layout as module
from defsense_fab.optimization.prediction.as_built import StrainRelief
from defsense_fab.optimization.prediction.choose_layout import choose_layout, drop_duplicates
from defsense_fab.optimization.refinement.refine import OptimizedLayout


def layout(straight, rmse, planes, slivers=False):
    """Return a layout of one cord in each of some planes."""
    cords = tuple(straight(f"c{k}", z=float(k)) for k in range(planes))
    return OptimizedLayout(cords, rmse, slivers, (), cords)


def tilted(layout):
    """Return the same layout with all planes turned by 30 degrees about x."""
    turn = Rotation.from_euler("x", 30, degrees=True).as_matrix()
    cords = [replace(s, plane=Plane(s.plane.origin, turn @ s.plane.axes)) for s in layout.sensors]
    return replace(layout, sensors=tuple(cords))


@pytest.fixture
def choose(monkeypatch, bar):
    """Return a function that chooses among layouts.

    Each of its `outcomes` holds the error as built, the number of parts (with the number of ends
    without a pocket) and the number of warnings, or the reason why the layout cannot be made.
    """

    def run(layouts, outcomes, prefer="simple", kind="print", locks=(), parts=None):
        """Choose; cast layouts whose numbers of parts are in `locks` have no moulds."""
        tried = []

        def outcome(sensors):
            found = zip(layouts, outcomes, strict=True)
            return next((f.rmse, m) for f, m in found if f.sensors is sensors)

        def relief(device, task, surface, sensors, bay):
            rmse, result = outcome(sensors)
            built, parts, _ = (rmse, 1, 0) if isinstance(result, str) else result
            free = parts[1] if isinstance(parts, tuple) else 0
            ends = [SimpleNamespace(pocket=0.0)] * free + [SimpleNamespace(pocket=7.0)]
            return StrainRelief(device, [SimpleNamespace(ends=ends, built=built)])

        def fabricate(device, surface, sensors, report, solid, bay, channels):
            _, result = outcome(sensors)
            tried.append(result)
            if isinstance(result, str):
                raise FabricationError(result, code="part-too-thin")
            _, parts, warnings = result
            parts = parts[0] if isinstance(parts, tuple) else parts
            return SimpleNamespace(
                channels=channels,
                parts=[SimpleNamespace(volume=1000.0 / parts)] * parts,
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

        def moulds(part_set, rules, report):
            if len(part_set.parts) in locks:
                raise FabricationError(
                    f"mould of {len(part_set.parts)} parts locks", code="mould-pieces-lock"
                )

        monkeypatch.setattr(module, "decide_strain_relief", relief)
        monkeypatch.setattr(module, "find_overstretched_cords", lambda *_: [])
        monkeypatch.setattr(module, "mould_rules", lambda device: None)
        monkeypatch.setattr(module, "check_openings", lambda part_set: None)
        monkeypatch.setattr(module, "make_moulds", moulds)
        monkeypatch.setattr(
            module,
            "_score_design",
            lambda task, one: SimpleNamespace(prediction=SimpleNamespace(unseen=one.rmse)),
        )
        fabrication = SimpleNamespace(pockets=True, kind=kind)
        device = SimpleNamespace(prefer=prefer, fabrication=fabrication, parts=parts)
        return (*choose_layout(device, None, layouts, bar, None, lambda f, m: None), tried)

    return run


def test_the_fewest_parts_within_25_per_cent_of_the_best_are_chosen(straight, choose):
    layouts = [layout(straight, 0.50, 4), layout(straight, 0.55, 3), layout(straight, 0.60, 2)]
    chosen, trials, _ = choose(layouts, [(0.500, 5, 0), (0.550, 4, 0), (0.620, 3, 1)])
    assert (chosen.built, chosen.parts) == (0.620, 3)  # with a warning, but fewer parts
    assert [t.layout for t in trials] == layouts
    chosen, trials, tried = choose(layouts, [(0.500, 5, 0), (0.550, 4, 0), (0.630, 3, 0)])
    assert chosen.parts == 4  # three parts are 26 per cent worse
    assert (trials[2].built, trials[2].parts, len(tried)) == (0.63, 3, 3)


def test_a_requested_number_of_parts_is_made_though_it_is_much_worse(straight, choose):
    layouts = [layout(straight, 0.50, 4), layout(straight, 0.55, 3), layout(straight, 0.90, 2)]
    outcomes = [(0.500, 5, 0), (0.550, 4, 0), (0.900, 3, 0)]
    for parts in (3, 4, 5):
        assert choose(layouts, outcomes, parts=parts)[0].parts == parts
    assert choose(layouts, outcomes, parts=2)[0].parts == 4  # as without a number


def test_the_simplest_of_as_few_parts_is_chosen_if_it_is_about_as_good(straight, choose):
    layouts = [layout(straight, e, 3) for e in (0.50, 0.51, 0.52)]
    chosen, _, _ = choose(layouts, [(0.500, 4, 1), (0.502, 5, 0), (0.520, 4, 0)])
    assert (chosen.built, chosen.parts) == (0.520, 4)
    chosen, _, _ = choose(layouts, [(0.500, 4, 1), (0.502, 5, 0), (0.530, 4, 0)])
    assert (chosen.built, chosen.parts) == (0.500, 4)  # the other is six per cent worse
    chosen, _, _ = choose(layouts, [(0.500, (4, 2), 0), (0.510, (4, 0), 0), (0.52, 5, 0)])
    assert (chosen.parts, chosen.free_ends) == (4, 0)


def test_layouts_that_cannot_be_chosen_are_not_made(straight, choose):
    layouts = [layout(straight, 0.50, 2), layout(straight, 0.55, 3), layout(straight, 0.51, 3)]
    _, _, tried = choose(layouts, [(0.50, 3, 0), (0.55, 4, 0), (0.51, 4, 0)])
    assert tried == [(0.50, 3, 0), (0.51, 4, 0)]  # 0.55 mm in more parts than 0.50 mm


def test_a_number_of_parts_is_taken_if_a_layout_has_it(straight, choose):
    layouts = [layout(straight, 0.50, 4), layout(straight, 0.55, 3), layout(straight, 0.90, 2)]
    outcomes = [(0.500, 5, 0), (0.550, 4, 0), (0.900, 3, 0)]
    assert choose(layouts, outcomes)[0].parts == 4
    assert choose(layouts, outcomes, parts=5)[0].parts == 5
    assert choose(layouts, outcomes, parts=7)[0].parts == 4


def test_accuracy_is_judged_as_built(straight, choose):
    layouts = [layout(straight, 0.50, 3), layout(straight, 0.51, 3)]
    chosen, _, _ = choose(layouts, [(0.60, 2, 0), (0.55, 6, 3)], prefer="accuracy")
    assert chosen.built == 0.55
    _, _, tried = choose(layouts, [(0.60, 2, 0), "in pieces"], prefer="accuracy")
    assert tried == ["in pieces", (0.60, 2, 0)]  # in the order of errors as built


def test_the_next_layout_replaces_one_that_cannot_be_made(straight, choose):
    layouts = [layout(straight, 0.5, 3), layout(straight, 0.7, 3), layout(straight, 0.9, 3)]
    chosen, trials, tried = choose(layouts, ["in pieces", (0.71, 4, 1), (0.91, 2, 0)])
    assert chosen.built == 0.71
    assert trials[0].problem == "in pieces"
    assert len(tried) == 2  # those that are much worse are tried only until one can be built
    chosen, trials, _ = choose(layouts, ["in pieces", "too thin", "too long"])
    assert chosen is trials[0]
    assert [t.problem for t in trials] == ["in pieces", "too thin", "too long"]


def test_the_next_layout_replaces_one_that_cannot_be_cast(straight, choose):
    layouts = [layout(straight, 0.50, 3), layout(straight, 0.51, 3), layout(straight, 0.90, 3)]
    outcomes = [(0.50, 3, 0), (0.51, 4, 0), (0.91, 5, 0)]
    chosen, trials, _ = choose(layouts, outcomes, kind="cast", locks={3})
    assert (chosen.built, [t.problem for t in trials]) == (0.51, ["mould of 3 parts locks", None])
    chosen, trials, tried = choose(layouts, outcomes, kind="cast", locks={3, 4})
    assert (chosen.built, len(tried)) == (0.91, 3)  # much worse: tried only after the others
    chosen, trials, _ = choose(layouts, outcomes, kind="cast", locks={3, 4, 5})
    assert chosen is trials[0]
    assert [t.problem for t in trials] == [f"mould of {n} parts locks" for n in (3, 4, 5)]


def test_layouts_with_fewer_planes_are_always_listed(straight, choose):
    layouts = [layout(straight, 0.5, 3), layout(straight, 1.5, 1), layout(straight, 2.5, 4)]
    chosen, trials, _ = choose(layouts, [(0.5, 4, 0), (1.5, 2, 0), (2.5, 9, 0)])
    assert chosen.built == 0.5
    assert [(t.planes, t.built, t.parts) for t in trials] == [(3, 0.5, 4), (1, 1.5, 2)]
    layouts = [layout(straight, 0.5, 1), layout(straight, 0.52, 3), layout(straight, 1.5, 2)]
    _, trials, _ = choose(layouts, ["in pieces", (0.52, 4, 0), (1.5, 3, 0)])
    assert [(t.planes, t.problem) for t in trials] == [(1, "in pieces"), (3, None), (2, None)]


def test_slivers_come_last_and_equal_layouts_are_dropped(straight):
    layouts = [
        layout(straight, 0.4, 2, slivers=True),
        layout(straight, 0.5, 2),
        layout(straight, 0.5 * (1 + 1e-6), 2),
        layout(straight, 0.5, 1),
    ]
    assert [(f.rmse, f.slivers) for f in drop_duplicates(layouts)] == [
        (0.5, False),
        (0.5, False),
        (0.4, True),
    ]


def test_planes_along_faces_are_simpler_and_always_tried(straight, choose):
    layouts = [tilted(layout(straight, e, 2)) for e in (0.50, 0.52)] + [layout(straight, 0.9, 2)]
    outcomes = [(0.50, 3, 0), (0.52, 3, 0), (0.90, 3, 0)]
    chosen, trials, _ = choose(layouts, outcomes)
    assert (chosen.built, [t.slanted for t in trials]) == (0.50, [1, 1, 0])
    chosen, trials, _ = choose(
        [layouts[0], replace(layouts[2], rmse=0.52)], [outcomes[0], (0.52, 3, 0)]
    )
    assert (chosen.built, chosen.slanted) == (0.52, 0)
