"""The default surface on known shapes: trained, interpolated, mixed and noisy."""

import numpy as np
import pytest

from benchmarks import live_surface
from defsense_fab.runtime.surface.live_surface import make_surface
from defsense_fab.runtime.surface.surface_mesh import SurfaceBasis
from tests.runtime.surface import meshes

VERTICES, TRIANGLES = meshes.bar((24, 5, 5))
BASE = VERTICES[:, 0] < 1e-9
MARKERS = meshes.spread(VERTICES, TRIANGLES, 30)
SD = np.full(len(MARKERS), 0.02)
#: Bend and twist (rad) of the states of the basis.
POSES = [(0.5, 0), (0.25, 0), (-0.5, 0), (-0.25, 0), (0, 0.7), (0, 0.35), (0.5, 0.7), (-0.5, 0.7)]


def basis(poses=POSES, base=BASE):
    states = np.array([meshes.bent(VERTICES, *p) - VERTICES for p in poses])
    return SurfaceBasis(VERTICES, TRIANGLES, states, base)


def rms(solved, pose):
    return float(np.sqrt(((solved - meshes.bent(VERTICES, *pose)) ** 2).sum(axis=1).mean()))


@pytest.fixture(scope="module")
def surface():
    return make_surface(basis(), MARKERS, SD)


def test_trained_states_are_reproduced(surface):
    for pose in POSES:
        surface.reset()
        assert rms(surface(meshes.bent(MARKERS, *pose)), pose) < 0.02


def test_intermediate_states_are_as_good_as_with_the_better_method(surface):
    alone = [make_surface(basis(), MARKERS, SD, mode) for mode in ("arap", "basis")]
    for pose in [(0.4, 0.2), (-0.2, 0.6), (0.6, 0.5)]:
        observed = meshes.bent(MARKERS, *pose)
        surface.reset()
        error = rms(surface(observed), pose)
        assert error < 0.06
        assert error < 1.05 * min(rms(other(observed), pose) for other in alone) + 0.002


def test_noise_is_averaged():
    rng, noise = np.random.default_rng(0), 0.5
    sd = np.full(len(MARKERS), noise)
    surface, rigid = (make_surface(basis(), MARKERS, sd, mode) for mode in ("default", "arap"))
    errors = []
    for pose in POSES:
        observed = meshes.bent(MARKERS, *pose) + noise * rng.standard_normal(MARKERS.shape)
        errors.append([rms(surface(observed), pose), rms(rigid(observed), pose)])
    ours, theirs = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ours < 0.25 < 0.4 < theirs


def test_markers_lead_far_from_all_states():
    only_bends = make_surface(basis(POSES[:4]), MARKERS, SD)
    pose = (0.0, 0.6)
    solved = only_bends(meshes.bent(MARKERS, *pose))
    assert rms(solved, pose) < 0.25
    assert only_bends.rounds > 1


def test_missing_markers_are_left_out(surface):
    pose = (0.5, 0.35)
    observed = meshes.bent(MARKERS, *pose)
    observed[::3] = np.nan
    surface.reset()
    solved = surface(observed)
    assert np.isfinite(solved).all()
    assert rms(solved, pose) < 0.1
    surface.reset()
    assert (
        rms(surface(np.full_like(observed, np.nan)), (0, 0)) < 1e-6
    )  # without markers it is at rest


def test_floating_body_is_found_anywhere():
    sd = np.full(len(MARKERS), 0.05)
    free = make_surface(basis(base=np.zeros(len(VERTICES), bool)), MARKERS, sd)
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    solved = free(meshes.bent(MARKERS, 0.5, 0.35) @ turn.T + [100.0, 20.0, -30.0])
    expected = meshes.bent(VERTICES, 0.5, 0.35) @ turn.T + [100.0, 20.0, -30.0]
    assert np.sqrt(((solved - expected) ** 2).sum(axis=1).mean()) < 0.1
    assert np.isfinite(free(np.full((len(MARKERS), 3), np.nan))).all()


def test_fixed_vertices_do_not_move_much_even_with_noise(surface):
    observed = meshes.bent(MARKERS, 0.5, 0.7)
    solved = surface(observed, np.full(len(observed), 1.0))
    assert np.abs(solved - VERTICES)[BASE].max() < 1e-9


@pytest.mark.parametrize("mode", ["default", "arap"])
def test_markers_on_fixed_vertices_and_coincident_markers(mode):
    on_base = np.stack([np.zeros(25), *np.random.default_rng(0).uniform(-14, 14, (2, 25))], axis=1)
    markers = np.concatenate([MARKERS[:20], MARKERS[:1], on_base])
    surface = make_surface(basis(), markers, np.zeros(len(markers)), mode)
    assert rms(surface(meshes.bent(markers, 0.25, 0.0)), (0.25, 0.0)) < 0.3


def test_zero_budget_takes_one_step_per_frame(surface):
    pose = (0.5, 0.35)
    surface.reset()
    errors = [rms(surface(meshes.bent(MARKERS, *pose), budget=0.0), pose) for _ in range(4)]
    assert surface.rounds == 0
    assert errors[-1] < 0.1


def test_surface_without_states_is_as_rigid_as_possible():
    alone = make_surface(SurfaceBasis.at_rest(VERTICES, TRIANGLES), MARKERS, SD)
    assert alone.description.startswith("as rigid as possible;")
    assert rms(alone(meshes.bent(MARKERS, 0.3, 0.3)), (0.3, 0.3)) < 1.0


def test_large_mesh_is_carried_by_a_cage():
    vertices, triangles, base = live_surface.bar(140)
    states = np.array([meshes.bent(vertices, *p) - vertices for p in POSES])
    large = make_surface(SurfaceBasis(vertices, triangles, states, base), MARKERS, SD)
    assert len(vertices) > 15_000
    assert "a cage of 4,0" in large.description
    solved, truth = large(meshes.bent(MARKERS, 0.5, 0.7)), meshes.bent(vertices, 0.5, 0.7)
    assert solved.shape == vertices.shape
    assert np.sqrt(((solved - truth) ** 2).sum(axis=1).mean()) < 0.1


def test_wrong_shapes_are_refused(surface):
    with pytest.raises(ValueError, match="markers"):
        surface(MARKERS[:5])
    with pytest.raises(ValueError, match="triangles"):
        SurfaceBasis.at_rest(np.concatenate([VERTICES, VERTICES[:1]]), TRIANGLES)
    with pytest.raises(ValueError, match="marker_rest"):
        make_surface(basis(), MARKERS, SD[:3])
