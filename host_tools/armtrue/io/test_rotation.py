import itertools

import numpy as np
import pytest

from armtrue.io import rotation

RANDOM = np.random.default_rng(7)


def test_quarter_turn_about_x_maps_y_to_z():
    matrix = rotation.matrix_about("x", np.pi / 2)
    np.testing.assert_allclose(matrix @ [0, 1, 0], [0, 0, 1], atol=1e-15)


@pytest.mark.parametrize(
    "sequence", ["".join(s) for s in itertools.product("xyz", repeat=3) if s[0] != s[1] != s[2]]
)
def test_intrinsic_sequence_equals_reversed_extrinsic_sequence(sequence):
    angles = RANDOM.uniform(-3, 3, (5, 3))
    intrinsic = rotation.matrix_from_euler(angles, sequence, intrinsic=True)
    extrinsic = rotation.matrix_from_euler(angles[:, ::-1], sequence[::-1], intrinsic=False)
    np.testing.assert_allclose(intrinsic, extrinsic, atol=1e-14)


def test_rpy_is_recovered_from_its_matrix():
    for rpy in RANDOM.uniform(-1.5, 1.5, (20, 3)):
        np.testing.assert_allclose(rotation.rpy_from_matrix(rotation.matrix_from_rpy(rpy)), rpy, atol=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_rpy_at_pitch_90_gives_the_same_matrix(pitch):
    matrix = rotation.matrix_from_rpy([0.4, pitch, -1.1])
    np.testing.assert_allclose(rotation.matrix_from_rpy(rotation.rpy_from_matrix(matrix)), matrix, atol=1e-12)


def test_rotation_vectors_of_any_size_give_rotation_matrices():
    vectors = np.vstack([np.zeros(3), RANDOM.normal(size=(3, 3)) * 1e-9, RANDOM.normal(size=(3, 3))])
    matrices = rotation.matrix_from_rotation_vector(vectors)
    np.testing.assert_allclose(
        matrices @ matrices.swapaxes(-1, -2), np.broadcast_to(np.eye(3), matrices.shape), atol=1e-14
    )
    np.testing.assert_allclose(
        rotation.matrix_from_rotation_vector([0, 0, 1.2]), rotation.matrix_about("z", 1.2), atol=1e-15
    )
    np.testing.assert_allclose(matrices[1] - np.eye(3), -(matrices[1] - np.eye(3)).T, atol=1e-17)


def test_quaternion_describes_the_same_rotation_as_its_matrix():
    # Half turns about each axis make each component in turn the largest.
    vectors = np.vstack([RANDOM.normal(size=(50, 3)) * 2, np.eye(3) * np.pi, np.zeros((1, 3))])
    matrices = rotation.matrix_from_rotation_vector(vectors)
    w, x, y, z = rotation.quaternion_from_matrix(matrices).T
    np.testing.assert_allclose(w**2 + x**2 + y**2 + z**2, 1.0, atol=1e-14)
    assert (w >= 0).all()
    np.testing.assert_allclose(matrices[:, 0, 0], 1 - 2 * (y**2 + z**2), atol=1e-12)
    np.testing.assert_allclose(matrices[:, 1, 0], 2 * (x * y + w * z), atol=1e-12)
    np.testing.assert_allclose(matrices[:, 0, 2], 2 * (x * z + w * y), atol=1e-12)
    np.testing.assert_allclose(matrices[:, 2, 1], 2 * (y * z + w * x), atol=1e-12)
