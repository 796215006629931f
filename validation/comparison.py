"""A number of ours beside a published one."""

import math
from typing import NamedTuple


class Comparison(NamedTuple):
    """A published value and ours, with their standard errors."""

    quantity: str  # as in the table: Markdown, such as "$Z$, $\\phi = 0.5$"
    published: float
    published_error: float  # standard error; 0: exact, NaN: none is given
    ours: float
    error: float  # standard error
    source: str  # where the published value is, as in the references of docs/validation.md
    # the published value is of a theory that is not exact: the difference is no failure
    approximate: bool = False
    remark: str = ""  # why it differs

    @property
    def z(self) -> float:
        """The difference in standard errors, both combined; the published one counts as 0 where
        none is given.
        """
        theirs = 0.0 if math.isnan(self.published_error) else self.published_error
        return (self.ours - self.published) / math.hypot(self.error, theirs)

    @property
    def departure(self) -> float:
        """The difference, relative to the published value."""
        return self.ours / self.published - 1

    @property
    def is_at_odds(self) -> bool:
        """Whether the values differ by more than three standard errors, though the published one is
        not approximate.
        """
        return not self.approximate and not abs(self.z) <= 3  # NaN is at odds, too
