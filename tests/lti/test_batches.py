"""Many small linear systems at once, some of them singular or without numbers."""

import numpy as np
import pytest

from revline.lti.batches import invert_each, solve_each


def test_solves_each_with_one_or_more_right_hand_sides() -> None:
    matrices = np.array([[[2.0, 0.0], [0.0, 4.0]], [[0.0, 1.0], [1.0, 0.0]]])
    right = np.array([[2.0, 4.0], [5.0, 6.0]])
    assert solve_each(matrices, right).tolist() == [[1.0, 1.0], [6.0, 5.0]]
    assert solve_each(matrices, np.stack((right, right), axis=-1))[..., 1].tolist() == [[1.0, 1.0], [6.0, 5.0]]


def test_singular_system_by_least_squares_beside_a_regular_one() -> None:
    matrices = np.array([[[1.0, 1.0], [1.0, 1.0]], [[2.0, 0.0], [0.0, 4.0]]])
    assert solve_each(matrices, np.array([[2.0, 2.0], [2.0, 4.0]])) == pytest.approx(np.ones((2, 2)))


def test_a_regular_system_is_solved_alike_beside_a_singular_one() -> None:
    """By least squares a badly scaled one would lose its small part."""
    regular = np.array([[1.0, 1.0], [0.0, 1e-17]])
    alone = solve_each(regular[None], np.array([[3.0, 2e-17]]))
    beside = solve_each(np.array([regular, np.zeros((2, 2))]), np.array([[3.0, 2e-17], [1.0, 1.0]]))
    assert beside[0].tolist() == alone[0].tolist() == [1.0, 2.0]
    assert beside[1].tolist() == [0.0, 0.0]


def test_system_without_numbers_gives_none_and_leaves_the_others() -> None:
    matrices = np.array([[[np.nan]], [[2.0]]])
    found = solve_each(matrices, np.array([[1.0], [1.0]]))
    assert np.isnan(found[0, 0])
    assert found[1, 0] == 0.5


def test_inverts_each_singular_ones_by_the_pseudo_inverse() -> None:
    matrices = np.array([[[2.0, 1.0], [0.0, 4.0]], [[1.0, 1.0], [1.0, 1.0]], [[np.inf, 0.0], [0.0, 1.0]]])
    found = invert_each(matrices)
    assert found[0] == pytest.approx(np.array([[0.5, -0.125], [0.0, 0.25]]))
    assert found[1] == pytest.approx(np.full((2, 2), 0.25))
    assert np.all(np.isnan(found[2]))
