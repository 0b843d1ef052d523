"""Keyed generators: one key, one stream."""

import itertools

import numpy as np

from seeds import generator


def test_the_same_key_draws_the_same_numbers():
    first, again = (generator(7, "open_0001", "yaw", 3).random(5) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_every_part_of_the_key_matters():
    keys = itertools.product((0, 1), ("a", "b"), ("yaw", "sensor"), (-1, 0, 1))
    draws = [generator(seed, subject, what, view).random() for seed, subject, what, view in keys]
    assert len(set(draws)) == len(draws)


def test_no_global_state_is_read_or_written():
    np.random.seed(0)  # noqa: NPY002, TID251
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002
    value = generator(0, "", "split").random()
    assert np.random.get_state()[1].tobytes() == before  # noqa: NPY002
    np.random.seed(99)  # noqa: NPY002, TID251
    assert generator(0, "", "split").random() == value
