"""The step Inside, asked by browsers that record what they get."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.errors import DefsenseError, LayoutError
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.studio.edits.cords import remove_cord
from defsense_fab.studio.inside import next_cord_search
from defsense_fab.studio.messages import inside as messages
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.session.device_session import DeviceSession
from defsense_fab.studio.steps.inside import inside_step, simulated_body
from defsense_fab.studio.steps.inside.inside_step import InsideStep
from defsense_fab.workflow.design.next_cord import NextCord
from tests.conftest import box_surface
from tests.studio.devices import write_device
from tests.studio.steps.browsers import FakeBrowser, FakeServer
from tests.support.errors import raises

STRETCH = 0.10  # along x, in the state "bend@1"
PLANE = {"origin": [0.0, 0.0, 0.0], "axes": np.eye(3).tolist()}
OUTSIDE = {"origin": [0.0, 0.0, 40.0], "axes": np.eye(3).tolist()}
TIMEOUT_S = 30.0


def box_judge():
    """Return what stands for the judge of a box of 30 x 20 x 10 mm, at rest and stretched in x."""
    mesh = tetrahedralize(box_surface([-15, -10, -5], [15, 10, 5]), 6.0).mesh
    quadratic = QuadraticMesh.from_linear(mesh)
    field = quadratic.nodes * [STRETCH, -0.04, -0.04]
    everything = SimpleNamespace(
        locator=PointLocator(quadratic), fields=field[None], depth=None, grid=None
    )
    return SimpleNamespace(
        task=SimpleNamespace(
            everything=everything, names=("rest", "bend@1"), weights=({}, {"bend": 1.0})
        )
    )


@pytest.fixture
def step(tmp_path, monkeypatch):
    monkeypatch.setattr(simulated_body, "shortest_cord", lambda _: 30.0)
    session = DeviceSession(
        FakeServer(), Project(write_device(tmp_path / "grip")), Agreement(trusted=True)
    )
    step = InsideStep(session)
    session.on_device_changed.append(step.on_device_changed)
    step.on_device_changed()
    yield step
    step.close()
    session.close()


@pytest.fixture
def simulated(step):
    step.session.judge = box_judge()
    step.on_build_loaded()
    return step


def browser_of(step):
    def handle(browser, request):
        return step.handlers[type(request)](browser, request)

    return FakeBrowser(SimpleNamespace(handle=handle))


def section(step, browser=None, **content):
    content = {**PLANE, "state": 1, "quantity": "largest", **content}
    return (browser or browser_of(step)).ask("show-section", **content)


def published(step):
    return [e for e in step.session.server.history if isinstance(e, messages.InsideState)]


def test_a_device_without_simulation_asks_for_one(step):
    state = published(step)[-1]
    assert not state.is_ready
    assert state.text
    assert {shown.name for shown in state.quantities} >= {"largest", "along", "next-cord"}
    with raises(LayoutError, "not-simulated"):
        section(step)


def test_states_and_the_first_plane_follow_a_simulation(simulated):
    state = published(simulated)[-1]
    assert state.is_ready
    assert [s.label for s in state.states] == ["At rest", "bend 100 %"]
    assert state.first_state == 1
    assert state.size == pytest.approx(30.0)
    np.testing.assert_allclose(state.axes[2], [0, 0, 1])
    simulated.on_build_loaded()
    assert published(simulated)[-1] is state
    simulated.session.judge = None
    simulated.on_build_loaded()
    assert not published(simulated)[-1].is_ready


@pytest.mark.parametrize("detail", ["coarse", "fine"])
def test_a_section_has_positions_and_percent_strain(simulated, detail):
    answer = section(simulated, detail=detail)
    arrays = answer.arrays
    np.testing.assert_allclose(arrays["values"], 100 * STRETCH, atol=1e-9)
    np.testing.assert_allclose(
        arrays["vertices"], arrays["rest"] * [1 + STRETCH, 0.96, 0.96], atol=1e-9
    )
    assert (answer.facts["low"], answer.facts["high"]) == (0.0, 10.0)
    assert answer.facts["lowest"] == pytest.approx(-5.0)


def test_a_fine_section_has_more_triangles(simulated):
    coarse, fine = (len(section(simulated, detail=d).arrays["triangles"]) for d in _DETAILS)
    assert fine > 2 * coarse


_DETAILS = ("coarse", "fine")


def test_the_direction_is_an_angle_or_a_cord(simulated):
    along = section(simulated, quantity="along", angle=90.0)
    np.testing.assert_allclose(along.arrays["values"], -4.0, atol=1e-9)
    cord = section(simulated, quantity="along", cord="side", angle=90.0)
    np.testing.assert_allclose(cord.arrays["values"], 100 * STRETCH, atol=0.2)
    with raises(DefsenseError, "not-in-device"):
        section(simulated, quantity="along", cord="none")


def test_the_range_follows_the_section_or_is_fixed(simulated):
    rest = section(simulated, state=0)
    fixed = section(simulated, state=0, isRangeFixed=True)
    assert rest.facts["largest"] == pytest.approx(0.0, abs=1e-9)
    assert rest.facts["high"] < 0.1
    assert fixed.facts["high"] == 10.0


def test_the_variation_is_a_standard_deviation(simulated):
    values = section(simulated, quantity="deviation-along").arrays["values"]
    np.testing.assert_allclose(values, 100 * STRETCH / 2, atol=1e-9)


def test_invalid_sections_are_refused(simulated):
    with raises(LayoutError, "plane-misses-body"):
        section(simulated, **OUTSIDE)
    with raises(LayoutError, "no-state"):
        section(simulated, state=7)
    with raises(LayoutError, "no-state"):
        section(simulated, state=-1)
    with raises(LayoutError, "invalid-plane"):
        section(simulated, origin=[0.0])


def test_the_skin_and_the_cords_follow_the_state(simulated):
    skin = browser_of(simulated).ask("get-skin")
    shape = browser_of(simulated).ask("get-shape", state=1)
    np.testing.assert_allclose(
        shape.arrays["vertices"], skin.arrays["rest"] * [1 + STRETCH, 0.96, 0.96], atol=1e-9
    )
    assert len(shape.facts["counts"]) == len(simulated.session.device.sensors)
    assert sum(shape.facts["counts"]) == len(shape.arrays["cords"])
    assert len(skin.arrays["edges"]) > 0


def test_a_point_has_all_numbers(simulated):
    numbers = browser_of(simulated).ask(
        "probe-point",
        **PLANE,
        state=1,
        quantity="along",
        at=[1.0, 2.0, 0.0],
    )
    assert numbers.position == pytest.approx([1.1, 1.92, 0.0])
    assert (numbers.along, numbers.largest) == pytest.approx((10.0, 10.0))
    assert numbers.smallest == pytest.approx(-4.0)
    assert numbers.deviation == pytest.approx(5.0)
    assert numbers.drop is None


# The next cord


def cord_map(plane, *, drop, is_fine=True):
    points = np.array([[0.0, 0, 0], [5.0, 0, 0], [10.0, 0, 0]])
    half = np.array([0.0, 4.0, 0.0])
    ends = np.stack([points - half, points + half], axis=1)
    return NextCord(plane, 5.0, points, np.array(drop), ends, 3.0, 20, 1.0, is_fine)


@pytest.fixture
def maps(monkeypatch):
    """Searches whose maps are given by the test; they wait for `go`."""
    control = SimpleNamespace(go=threading.Event(), drop=[np.nan, 0.5, 1.0], error=None)
    control.go.set()

    def search(judge, body, plane, sensors, length):
        yield cord_map(plane, drop=control.drop, is_fine=False)
        assert control.go.wait(TIMEOUT_S)
        if control.error is not None:
            raise control.error
        yield cord_map(plane, drop=control.drop)

    def best_sensor(found, at, name, judge):
        sensor = control.step.session.device.sensors[0]
        control.at = at
        return SimpleNamespace(name=name, plane=sensor.plane, curve=sensor.curve, free=set())

    monkeypatch.setattr(next_cord_search, "map_next_cord", search)
    monkeypatch.setattr(inside_step, "best_sensor", best_sensor)
    return control


def search(step, browser, *, ends=True):
    browser.ask("search-next-cord", **PLANE, length=8.0)
    if ends:
        assert step._searches[browser]._search.wait(TIMEOUT_S)


def test_a_search_reports_its_progress_and_its_map(simulated, maps):
    browser = browser_of(simulated)
    search(simulated, browser)
    states = [event.state for event in browser.events]
    assert states[0] == "searching"
    assert states[-1] == "found"
    last = browser.events[-1]
    assert (last.error, last.drop, last.length) == (3.0, 1.0, 8.0)
    assert browser.arrays[-1].name == "next-cord"
    values = section(simulated, browser, quantity="next-cord").arrays["values"]
    assert set(np.unique(values[np.isfinite(values)])) == {0.5, 1.0}
    other = section(simulated, browser_of(simulated), quantity="next-cord").arrays["values"]
    assert np.isnan(other).all()


def test_the_best_cord_or_one_through_a_point_is_added(simulated, maps):
    browser, maps.step = browser_of(simulated), simulated
    count = len(simulated.session.device.sensors)
    with raises(LayoutError, "search-not-done"):
        browser.ask("add-next-cord")
    search(simulated, browser)
    with raises(LayoutError, "no-cord-fits"):
        browser.ask("add-next-cord", at=[0, 0, 0])
    browser.ask("add-next-cord", at=[4.0, 1.0, 0.0])
    assert maps.at == 1
    assert len(simulated.session.device.sensors) == count + 1
    assert browser.events[-1].state == "outdated"
    search(simulated, browser)
    browser.ask("add-next-cord")
    assert maps.at == 2
    simulated.session.project.undo()
    simulated.session.project.undo()
    assert len(simulated.session.device.sensors) == count


def test_a_place_without_benefit_is_refused(simulated, maps):
    browser, maps.drop = browser_of(simulated), [np.nan, -0.5, -1.0]
    search(simulated, browser)
    assert browser.events[-1].ends == []
    with raises(LayoutError, "no-better-cord"):
        browser.ask("add-next-cord")


def test_a_search_can_be_canceled(simulated, maps):
    browser = browser_of(simulated)
    maps.go.clear()
    search(simulated, browser, ends=False)
    browser.ask("stop-next-cord")
    maps.go.set()
    assert simulated._searches[browser]._search.wait(TIMEOUT_S)
    assert browser.events[-1].state == "none"
    assert np.isnan(section(simulated, browser, quantity="next-cord").arrays["values"]).all()


def test_the_error_of_a_search_reaches_its_browser(simulated, maps):
    browser, maps.error = browser_of(simulated), LayoutError("cannot be judged", code="not-finite")
    search(simulated, browser)
    assert browser.events[-1].state == "failed"
    assert browser.events[-1].problem.code == "not-finite"


def test_a_change_of_the_cords_outdates_maps(simulated, maps):
    browser = browser_of(simulated)
    search(simulated, browser)
    simulated.session.apply(remove_cord("side"))
    assert browser.events[-1].state == "outdated"
    assert np.isnan(section(simulated, browser, quantity="next-cord").arrays["values"]).all()


def test_a_browser_that_leaves_ends_its_search(simulated, maps):
    browser = browser_of(simulated)
    search(simulated, browser)
    browser.is_open = False
    simulated.disconnect(browser)
    with raises(DefsenseError, "cancelled"):
        search(simulated, browser)


def test_a_search_outside_the_body_is_refused(simulated, maps):
    with raises(LayoutError, "plane-misses-body"):
        browser_of(simulated).ask("search-next-cord", **OUTSIDE)


def test_planes_are_those_of_the_engine(simulated):
    tilted = Plane.from_normal(np.array([1.0, 0, 0]), np.array([0.1, -1.0, 0.3]), np.eye(3)[0])
    answer = section(simulated, origin=tilted.origin.tolist(), axes=tilted.axes.T.tolist())
    heights = (answer.arrays["rest"] - tilted.origin) @ tilted.normal
    np.testing.assert_allclose(heights, 0, atol=1e-9)
