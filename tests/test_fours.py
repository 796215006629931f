"""Fours: compiled, they have the bits of the same functions of NumPy arrays, which is what they are without Numba."""

import math

import numpy as np
import pytest

from brownpipe.engines.fours import (
    all_bits,
    any_of,
    copy_four,
    four,
    four_columns,
    four_entries,
    four_from,
    least,
    replace_in_four,
    where,
)
from brownpipe.engines.kernels import entry_point, kernel


@kernel
def number(values, lane):
    """One of four finite numbers."""
    lanes = four_from(0.0)
    return least(where((lanes <= lane) & (lanes > lane - 1.0), values, four(math.inf)))


@kernel
def results(numbers, words, copied, first, end, lane):
    """Every operator and function, one number of each."""
    index = four_entries(words, first, end, 5)
    a, b, c, d = four_columns(numbers, 4 * (index & 7))
    other, _, _, _ = four_columns(numbers, (index >> 28) * 8 + 1)
    copy_four(copied, 2, words, first)
    replace_in_four(copied, 3, words[first + 1], words[first])
    return (
        number(a + b * c, lane),
        number(2.5 - d / a, lane),
        number((1.0 - b) / 3.0 + other, lane),
        number(np.maximum(a, b) + np.sqrt(np.maximum(c, 0.25)), lane),
        number(where((a < b) & (c <= d), four(numbers[0]), four_from(numbers[1])), lane),
        number(where((a > b) & (index != 5), a, d), lane),
        least(b),
        1.0 * any_of(a < b) + 2.0 * any_of(a < a),
        1.0 * all_bits(index),
    )


compiled = entry_point(results)


@pytest.mark.parametrize("scale", [1.0, 1e-300, 1e150])
def test_four_have_the_bits_of_one(scale):
    random = np.random.default_rng(1)
    for _ in range(50):
        numbers = random.normal(size=40) * scale
        numbers[random.integers(0, 40, 8)] = numbers[0]  # equal ones
        words = (random.integers(0, 8, 12) + (random.integers(0, 4, 12) << 28)).astype(np.uint32)
        first, end = random.integers(0, 9, 2)
        arrays = [np.zeros(8, np.uint32), np.zeros(8, np.uint32)]
        for lane in range(4):
            given = numbers, words, arrays[0], first, end, float(lane)
            with np.errstate(all="ignore"):
                expected = results(*given)
            given = numbers, words, arrays[1], first, end, float(lane)
            assert np.array(compiled(*given)).tobytes() == np.array(expected).tobytes()
        assert arrays[0].tolist() == arrays[1].tolist()
        assert arrays[0].tolist()[:4] == [0, 0, words[first], words[first]]
