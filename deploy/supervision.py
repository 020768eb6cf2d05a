"""When a process that ended is started again, and when not. Pure: time is passed in, in seconds.

1. Status 0 is an end, not a failure: the process has finished. For a lasting process such as fusion it is a failure.
2. Status 2 is bad input: the process has printed the fault, and another start would only repeat it.
3. Any other end is a failure: the process is started again, after 0.5 s and then ever later, up to 30 s.
4. A process that has run for a minute has recovered: the next pause is short again.
"""

from dataclasses import dataclass, field
from enum import Enum

BAD_INPUT = 2


class RunDecision(Enum):
    """What happens to a process that ended."""

    FINISHED = "finished"
    RESTART = "restart"
    GIVEN_UP = "given up"


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """first_s, longest_s: the shortest and longest pause; recovered_s: a run this long forgives earlier failures.

    failures: how many in a row are too many; None: never.
    """

    first_s: float = 0.5
    longest_s: float = 30.0
    recovered_s: float = 60.0
    failures: int | None = None


@dataclass(slots=True)
class RunHistory:
    """One process's successive runs. lasting: it is not meant to end by itself."""

    lasting: bool
    policy: RestartPolicy = field(default_factory=RestartPolicy)
    failures: int = 0

    def decide(self, status: int, ran_s: float) -> RunDecision:
        """What to do after a run that ended with `status` (negative: by that signal) after `ran_s`."""
        if status == 0 and not self.lasting:
            return RunDecision.FINISHED
        if status == BAD_INPUT:
            return RunDecision.GIVEN_UP
        self.failures = 1 if ran_s >= self.policy.recovered_s else self.failures + 1
        limit = self.policy.failures
        return RunDecision.GIVEN_UP if limit is not None and self.failures >= limit else RunDecision.RESTART

    @property
    def pause_s(self) -> float:
        """How long to wait before the next start: doubles with each failure in a row."""
        # 2**16 pauses are past any longest_s; the cap keeps the power small.
        doubled: float = self.policy.first_s * 2 ** min(self.failures - 1, 16)
        return min(doubled, self.policy.longest_s)
