"""How long to wait between attempts that fail. Pure."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Backoff:
    """`first_s` after the first failure, doubled with each one in a row up to `longest_s`.

    steady_s: what has worked for this long before it failed has recovered: the next wait is short again.
    """

    first_s: float
    longest_s: float
    steady_s: float = math.inf

    def failures(self, before: int, worked_s: float) -> int:
        """Failures in a row, counting one more of what had worked for `worked_s` seconds."""
        return 1 if worked_s >= self.steady_s else before + 1

    def wait_s(self, failures: int) -> float:
        """Seconds to wait after that many failures in a row (at least 1)."""
        # Without the bound of 60 doublings the float would overflow after a night.
        return min(self.first_s * 2.0 ** min(failures - 1, 60), self.longest_s)
