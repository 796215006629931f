"""Sample times: the floating-point numbers nearest to what their decimals say, as one writes them
to select a sample: 0.3 and not 3 * 0.1, which is 0.30000000000000004.
"""

from fractions import Fraction

import numpy as np

# digits of a decimal that a floating-point number stands for without doubt; one with more, such as
# 1/3, is taken as the floating-point number that it is
DECIMAL_DIGITS = 15
EXACT = 2**53  # up to it all integers are floating-point numbers


def decimal_of(number: float) -> Fraction:
    """Return the decimal with which a floating-point number is written, exactly: 1/10 for 0.1."""
    return Fraction(repr(float(number)))


def multiples(interval: float, count: int) -> np.ndarray:
    """Return 0, 1, ..., count - 1 times an interval, (count,), each rounded once.

    Multiplied is the decimal of the interval if it is a short one. Integers below `EXACT`, and so
    their quotient, are rounded once by NumPy; larger ones by Python, a second for 5 million.

        multiples(0.1, 4)  # 0, 0.1, 0.2, 0.3
    """
    digits = f"{interval!r}".lower().partition("e")[0].replace(".", "").strip("0")
    if len(digits) > DECIMAL_DIGITS:
        return np.arange(count) * interval
    numerator, denominator = decimal_of(interval).as_integer_ratio()
    if max(numerator * count, denominator) <= EXACT:
        return np.arange(count, dtype=float) * float(numerator) / float(denominator)
    return np.array([k * numerator / denominator for k in range(count)])


def logarithmic(first: float, per_decade: int, count: int) -> np.ndarray:
    """Return first * 10**(k / per_decade) for k = 0, 1, ..., count - 1, (count,).

    Whole decades are those of the decimal of `first`. Powers are computed by Python: NumPy's may
    differ in the last bit between processors.

        logarithmic(0.07, 2, 3)  # 0.07, 0.2213594362117866, 0.7
    """
    times = [first * 10 ** (k / per_decade) for k in range(count)]
    for k in range(0, count, per_decade):
        times[k] = float(decimal_of(first) * 10 ** (k // per_decade))
    return np.array(times)
