import numpy as np
import pytest

from .transforms import Pose, exp_so3, matrix_from_rpy, quaternion_from_matrix, rot_x, rot_z, rpy_from_matrix


def test_exponential_turns_about_the_vector_by_its_length():
    assert np.allclose(exp_so3(np.array([0.0, 0.0, 0.7])), rot_z(0.7), atol=1e-15)
    assert np.allclose(exp_so3(np.array([-1.2, 0.0, 0.0])), rot_x(-1.2), atol=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-9, 9.9e-5, 1.01e-4, 0.3, 3.1])
def test_exponential_is_a_rotation_at_every_size(size):
    r = exp_so3(size * np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0]]))
    assert np.allclose(r @ np.swapaxes(r, 1, 2), np.eye(3), atol=1e-15)
    assert np.allclose(np.linalg.det(r), 1.0)


def test_rpy_is_about_fixed_axes_x_then_y_then_z():
    # A quarter turn about x, then one about the *fixed* z: y goes to z and stays there.
    r = matrix_from_rpy([np.pi / 2, 0.0, np.pi / 2])
    assert np.allclose(r @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-15)
    assert np.allclose(r @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)
    rpy = np.array([0.3, -0.8, 2.9])
    assert np.allclose(rpy_from_matrix(matrix_from_rpy(rpy)), rpy)


def test_quaternion_is_half_the_angle_and_has_positive_w():
    assert np.allclose(quaternion_from_matrix(rot_z(1.0)[None]), [[np.cos(0.5), 0.0, 0.0, np.sin(0.5)]])
    vectors = np.random.default_rng(0).normal(size=(200, 3))
    q = quaternion_from_matrix(exp_so3(vectors))
    assert np.all(q[:, 0] >= 0.0)
    back = exp_so3(
        2.0
        * np.arctan2(np.linalg.norm(q[:, 1:], axis=1), q[:, 0])[:, None]
        * q[:, 1:]
        / np.linalg.norm(q[:, 1:], axis=1, keepdims=True)
    )
    assert np.allclose(back, exp_so3(vectors), atol=1e-12)


def test_pose_times_its_inverse_is_the_identity():
    pose = Pose.from_vector([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    both = pose @ pose.inverse()
    assert np.allclose(both.rotation, np.eye(3))
    assert np.allclose(both.translation, 0.0)
    again = Pose.from_xyz_rpy(**pose.xyz_rpy())
    assert np.allclose(again.rotation, pose.rotation)
