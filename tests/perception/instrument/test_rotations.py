import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from haptigraph.perception.instrument.rotations import (
    euler_xyz_matrix,
    mean_rotation,
    nearest_rotation,
    rotation_matrix,
    rotation_vector,
)

vectors = st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array)


@given(vectors)
def test_a_matrix_has_its_vector(vector):
    matrix = rotation_matrix(vector)
    assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-9)
    assert_allclose(rotation_vector(matrix), vector, atol=1e-7)
    assert_allclose(matrix @ vector, vector, atol=1e-9)


def test_a_quarter_turn_about_z_takes_x_to_y():
    assert_allclose(rotation_matrix(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=1e-12)


def test_euler_angles_are_intrinsic():
    matrix = euler_xyz_matrix(np.array([90.0, 0.0, 90.0]))
    assert_allclose(matrix @ [1, 0, 0], [0, 0, 1], atol=1e-12)  # about its own z first, then x takes y to z


@given(vectors)
def test_opposite_turns_have_the_middle_as_their_mean(vector):
    middle = rotation_matrix(np.array([0.3, -0.2, 0.1]))
    turned = [middle @ rotation_matrix(0.2 * vector), middle @ rotation_matrix(-0.2 * vector)]
    assert_allclose(mean_rotation(turned), middle, atol=1e-9)


def test_the_nearest_rotation_of_a_mirrored_matrix_is_no_mirror():
    assert np.linalg.det(nearest_rotation(np.diag([1.0, 1.0, -1.0]))) > 0.99
