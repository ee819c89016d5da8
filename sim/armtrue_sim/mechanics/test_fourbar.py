import numpy as np
import pytest

from .fourbar import FourBar

ARCSEC = np.pi / 180 / 3600
THETA2, BETA = (g.ravel() for g in np.meshgrid(np.linspace(-3.0, 0.0, 31), np.linspace(0.6, 2.5, 41)))
ERRORS = {
    "crank_error": 2e-4,
    "rod_error": -1.5e-4,
    "rocker_error": 1e-4,
    "arm_error": 0.7e-4,
    "pivot_x": 1e-4,
    "pivot_y": -0.8e-4,
}


def first_order(linkage, theta2, beta):
    variables = {"th2": theta2, "beta": beta, "sin": np.sin, "cos": np.cos}
    return sum(value * eval(text, variables) for text, value in linkage.first_order().items())


def unit(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def closure_residual(linkage, psi):
    """Distance between the rod's pivots minus the rod's length, in metres (N,)."""
    offset = np.array([linkage.pivot_x, linkage.pivot_y])
    tip = offset + (linkage.crank + linkage.crank_error) * unit(THETA2 + BETA)
    rocker = (linkage.crank + linkage.rocker_error) * unit(THETA2 + psi)
    driven = (linkage.rod + linkage.arm_error) * unit(THETA2) + rocker
    return np.linalg.norm(tip - driven, axis=-1) - (linkage.rod + linkage.rod_error)


def test_perfect_parallelogram_keeps_the_rocker_angle():
    assert np.allclose(FourBar(0.32, 0.705, 1.67).rocker_angle(THETA2, BETA), BETA, atol=1e-13)


@pytest.mark.parametrize("scale", [0.01, 1.0, 30.0])
def test_closure_is_exact_at_every_size_of_error(scale):
    linkage = FourBar(0.32, 0.705, 1.67, **ERRORS).scaled(scale)
    psi = linkage.rocker_angle(THETA2, BETA)
    assert np.abs(closure_residual(linkage, psi)).max() < 1e-12


def test_first_order_formula_holds_in_the_limit():
    left = []
    for scale in (1.0, 0.1):
        linkage = FourBar(0.32, 0.705, 1.67, **ERRORS).scaled(scale)
        exact = linkage.rocker_angle(THETA2, BETA) - BETA
        left.append(np.abs(exact - first_order(linkage, THETA2, BETA)).max())
    # The remainder is of second order: errors a tenth as large leave a hundredth of it.
    assert left[0] < 5e-6
    assert left[1] / left[0] == pytest.approx(0.01, rel=0.05)


def test_arm_error_of_0_1_mm_turns_the_rocker_by_52_arcsec():
    # Crank 0.4 m: 52 arcsec where beta is 90 degrees, 103 where it is 30.
    linkage = FourBar(0.4, 0.9, np.pi / 2, arm_error=1e-4)
    beta = np.radians([90.0, 30.0])
    error = (linkage.rocker_angle(np.zeros(2), beta) - beta) / ARCSEC
    assert error == pytest.approx([51.6, 103.1], abs=0.2)


def test_bars_that_cannot_close_are_refused():
    with pytest.raises(ValueError, match="does not close"):
        FourBar(0.32, 0.705, 1.67, rod_error=0.8).rocker_angle(np.zeros(1), np.array([0.1]))
