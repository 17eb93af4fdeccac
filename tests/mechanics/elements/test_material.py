"""Check each material: stress and tangent by finite differences, small strain, projection."""

import numpy as np
import pytest

from defsense_fab.core.device.device import MaterialSpec
from defsense_fab.core.device.materials import gent_modulus, modulus_from_shore
from defsense_fab.mechanics.elements.energy_density import (
    energy_density,
    signed_svd,
    stress,
    symmetric_eigen,
    tangent,
)
from defsense_fab.mechanics.elements.material import Material


def gradients(seed, count, size):
    """Return random gradients with det F > 0."""
    rng = np.random.default_rng(seed)
    found = np.eye(3) + rng.normal(0, size, (4 * count, 3, 3))
    return found[np.linalg.det(found) > 0.2][:count]


def test_stress_is_the_gradient_of_the_energy(material):
    h = 1e-6
    for F in gradients(0, 20, 0.3):
        P = stress(material, F)
        for k in range(9):
            e = np.zeros((3, 3))
            e.ravel()[k] = h
            slope = (energy_density(material, F + e) - energy_density(material, F - e)) / (2 * h)
            assert P.ravel()[k] == pytest.approx(slope, rel=1e-6, abs=1e-7)


def test_tangent_is_the_gradient_of_the_stress(material):
    h = 1e-6
    for F in gradients(1, 20, 0.3):
        H = tangent(material, F)
        assert pytest.approx(H.T, rel=1e-9, abs=1e-9) == H
        for k in range(9):
            e = np.zeros((3, 3))
            e.ravel()[k] = h
            slope = (stress(material, F + e) - stress(material, F - e)).ravel() / (2 * h)
            assert H[k] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(H).max())


def test_projection_clamps_the_eigenvalues(material):
    """Compare the closed form with clamped eigenvalues of the 9 x 9 matrix."""
    negative = 0
    for F in [*gradients(2, 40, 0.5), np.diag([0.5, 1.5, 1.5]), 0.7 * np.eye(3)]:
        w, Q = np.linalg.eigh(tangent(material, F))
        negative += (w < -1e-6).sum()
        clamped = (Q * np.maximum(w, 0)) @ Q.T
        assert tangent(material, F, share=1.0) == pytest.approx(clamped, abs=1e-7 * np.abs(w).max())
    assert negative > 20


def test_projection_includes_the_lag(material):
    for F in gradients(5, 20, 0.4):
        w, Q = np.linalg.eigh(tangent(material, F, lag=1.5))
        clamped = (Q * np.maximum(w, 0)) @ Q.T
        found = tangent(material, F, lag=1.5, share=1.0)
        assert found == pytest.approx(clamped, abs=1e-7 * np.abs(w).max())


def test_a_share_of_the_projection_interpolates(material):
    for F in gradients(2, 5, 0.5):
        none, all_of_it = tangent(material, F), tangent(material, F, share=1.0)
        quarter = tangent(material, F, share=0.25)
        assert quarter == pytest.approx(none + 0.25 * (all_of_it - none), abs=1e-9)


def test_the_lag_multiplies_the_second_derivative_of_the_volume(material):
    h, rng = 1e-4, np.random.default_rng(3)
    for F in gradients(4, 5, 0.3):
        E = rng.normal(size=(3, 3))
        second = (np.linalg.det(F + h * E) - 2 * np.linalg.det(F) + np.linalg.det(F - h * E)) / h**2
        more = tangent(material, F, lag=2.0) - tangent(material, F)
        assert E.ravel() @ more @ E.ravel() == pytest.approx(2 * second, rel=1e-4, abs=1e-5)


def test_volumetric_is_the_modulus_of_the_volumetric_energy(material):
    more = material.parameters.copy()
    more[4 if material.model != "stable-neo-hookean" else 1] += 0.7
    other = Material(material.model, material.kind, more, 0, 0)
    assert other.volumetric - material.volumetric == pytest.approx(0.7)
    scaled = [np.cbrt(J) * np.eye(3) for J in (0.9, 1.0, 1.1)]
    a, b, c = (energy_density(other, F) - energy_density(material, F) for F in scaled)
    assert (a - 2 * b + c) / 0.01 == pytest.approx(0.7)


def test_rest_has_no_stress_and_rotations_no_energy(material):
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert energy_density(material, turn) == pytest.approx(0, abs=1e-12)
    assert np.abs(stress(material, np.eye(3))).max() < 1e-12
    F = gradients(4, 1, 0.3)[0]
    assert stress(material, turn @ F) == pytest.approx(turn @ stress(material, F), abs=1e-9)


def test_small_strain_gives_the_moduli(material):
    """Compare with linear elasticity: 2 mu sym(G) + (kappa - 2 mu / 3) tr(G)."""
    H = tangent(material, np.eye(3))
    rng = np.random.default_rng(5)
    G = rng.normal(size=(3, 3))
    e = (G + G.T) / 2
    expected = 2 * material.shear * e + (material.bulk - 2 / 3 * material.shear) * np.trace(
        G
    ) * np.eye(3)
    assert (H @ G.ravel()).reshape(3, 3) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("model", ["neo-hookean", "stable-neo-hookean"])
@pytest.mark.parametrize("nu", [0.3, 0.45, 0.49, 0.499])
def test_young_and_poisson_become_moduli(model, nu):
    m = Material.from_spec(MaterialSpec("x", 1.5, nu, model))
    assert m.young == pytest.approx(1.5)
    assert (3 * m.bulk - 2 * m.shear) / (2 * (3 * m.bulk + m.shear)) == pytest.approx(nu)


def test_yeoh_constants_by_uniaxial_tension():
    """Compare with the incompressible nominal stress 2 (l - 1/l^2) dW/dI1 (Yeoh 1993, eq. 9)."""
    spec = MaterialSpec(
        "x", 1.0, 0.499999, "yeoh", constants={"c10": 0.1, "c20": 0.02, "c30": 0.01}
    )
    m = Material.from_spec(spec)
    stretch = 1.8
    y = stretch**2 + 2 / stretch - 3
    expected = 2 * (stretch - stretch**-2) * (0.1 + 2 * 0.02 * y + 3 * 0.01 * y**2)
    low, high = 0.5, 1.0  # the lateral stretch without lateral stress, by bisection
    for _ in range(80):
        middle = (low + high) / 2
        lateral = stress(m, np.diag([stretch, middle, middle]))[1, 1]
        low, high = (middle, high) if lateral < 0 else (low, middle)
    assert stress(m, np.diag([stretch, low, low]))[0, 0] == pytest.approx(expected, rel=1e-4)


def test_only_the_stable_model_allows_inverted_tets(material):
    energy = energy_density(material, np.diag([1.0, 1.0, -0.5]))
    assert np.isfinite(energy) == (material.model == "stable-neo-hookean")


def test_signed_singular_values_and_eigenvalues():
    rng = np.random.default_rng(6)
    special = [np.eye(3), -np.eye(3), np.diag([2.0, 2.0, 1.0]), np.diag([1.0, 2.0, 2.0])]
    for F in [*rng.normal(size=(200, 3, 3)), *special]:
        U, s, V = signed_svd(F)
        assert (U * s) @ V.T == pytest.approx(F, abs=1e-9)
        assert np.linalg.det(U) == pytest.approx(1)
        assert np.linalg.det(V) == pytest.approx(1)
        assert np.sort(np.abs(s)) == pytest.approx(
            np.linalg.svd(F, compute_uv=False)[::-1], abs=1e-9
        )
        A = F + F.T
        w, Q = symmetric_eigen(A)
        assert (Q * w) @ Q.T == pytest.approx(A, abs=1e-12)


def test_shore_hardness_follows_gent_with_its_band():
    # Relation of Gent 1958, computed manually.
    assert gent_modulus(50) == pytest.approx(2.456, abs=1e-3)
    modulus = modulus_from_shore("50A")
    assert modulus.value == gent_modulus(50)
    assert modulus.high / modulus.value == pytest.approx(1.69, abs=0.01)
    for wrong in ("15A", "95A", "00-30", "soft", "40D"):
        with pytest.raises(ValueError, match="young_modulus"):
            modulus_from_shore(wrong)
