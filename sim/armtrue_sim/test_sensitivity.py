import numpy as np
import pytest

from .arm import Arm, Term
from .campaign import simulate
from .mechanics.transforms import Pose
from .presets import PRESETS, nominal_robot
from .sensitivity import (
    geometry_terms,
    orthonormal_range,
    sensitivity,
    unexplained,
    unit_term,
)


@pytest.mark.quick("cobot")
@pytest.mark.parametrize("name", PRESETS)
def test_sensitivity_is_the_derivative_of_exact_position(name):
    # A perfect arm: the geometric Jacobian is exact there.
    base = Pose.from_xyz_rpy([1.0, 2.0, -0.5], [0.1, -0.2, 2.0])
    arm = Arm(nominal_robot(name), [], base, {"": Pose.from_vector([0.06, 0.03, 0.16, 0, 0, 0])})
    campaign = simulate({"arm": name, "poses": 20, "repeats": {}})
    columns = campaign.data
    terms = [*geometry_terms(arm), unit_term("motor2", "tau2/100"), unit_term("link3.rz", "sin(q2)")]
    slopes = sensitivity(arm, campaign.q, columns, terms)
    for j, term in enumerate(terms):
        step = 1e-6
        ahead, behind = (
            arm.with_terms([Term("x", (), term.coordinate, term.expression, s * step, "1")]).true_position(
                campaign.q, columns
            )
            for s in (1.0, -1.0)
        )
        assert np.allclose(slopes[:, j], (ahead - behind).ravel() / (2 * step), atol=1e-7), term


def test_unexplained_is_the_part_orthogonal_to_the_basis():
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(30, 4))
    columns[:, 3] = columns[:, 0] - 2 * columns[:, 1]
    basis = orthonormal_range(columns)
    assert basis.shape == (30, 3)
    inside = (columns @ [1.0, 2.0, 3.0, 4.0]).reshape(10, 3)
    assert np.abs(unexplained(inside, basis)).max() < 1e-12
    left = unexplained(rng.normal(size=(10, 3)), basis)
    assert np.abs(columns.T @ left.ravel()).max() < 1e-12
