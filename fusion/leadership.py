"""Which of several fusion services of one scene speaks. Pure: time is passed in.

1. One leads, the others stand by: they hear and judge all the same, but say nothing.
2. Who hears another judge, and does not lead, stands by for as long as that one goes on.
3. When the leader's process is seen to go, the first of the others by name takes over at once. When it falls silent
   for `takeover_s`, the same; a silent one is not counted among the others. Each next one waits that long again, in
   case those before it are dead too.
4. Where two lead, after a network was cut in two, the later by name stands by as soon as it hears the other.
5. Who did not get to a step for `takeover_s` (stopped, swapped out) stands by until it has listened for as long:
   another may lead by now.
6. Who is alone in the scene file always leads.
"""

SECOND_NS = 1_000_000_000
STEPS_MISSED = 2.5
"""Who judges at every step is not silent before it has missed so many."""


class Leadership:
    """Whether the service `own` leads, of all the `services` that the scene names; takeover_s: seconds."""

    def __init__(self, own: str, services: frozenset[str], takeover_s: float) -> None:
        self._own, self._others = own, services - {own}
        self._takeover_ns = round(takeover_s * SECOND_NS)
        self._alive: frozenset[str] = frozenset()
        self.leader: str | None = None if self._others else own
        self._quiet_since_ns: int | None = None
        self._silent: frozenset[str] = frozenset()
        self._stepped_ns: int | None = None

    def present(self, alive: frozenset[str], now_ns: int) -> None:
        """Which fusion services are alive on the mesh now."""
        gone, self._alive = self._alive - alive, alive & self._others
        self._silent &= self._alive
        if self.leader in gone:
            # As quiet as can be: the first of the others need not wait (rule 3).
            self.leader, self._quiet_since_ns = None, now_ns - self._takeover_ns

    def heard(self, other: str, now_ns: int) -> bool:
        """Another service judged; returns whether it is the one to follow."""
        if other not in self._others or (self.leader == self._own and self._own < other):
            return False
        if self.leader is None or self.leader == self._own or other < self.leader:
            self.leader = other
        self._silent -= {other}
        if other == self.leader:
            self._quiet_since_ns = now_ns
        return other == self.leader

    def leads(self, now_ns: int) -> bool:
        """Whether to speak now; to be asked at every step."""
        if not self._others:
            return True
        slept = self._stepped_ns is None or abs(now_ns - self._stepped_ns) > self._takeover_ns
        self._stepped_ns = now_ns
        if slept:
            self.leader, self._quiet_since_ns = None, now_ns
        elif self.leader != self._own:
            self._watch(now_ns)
        return self.leader == self._own

    def _watch(self, now_ns: int) -> None:
        """Rule 3, for one who stands by."""
        quiet_ns = now_ns - (self._quiet_since_ns or 0)
        if self.leader is not None and quiet_ns > self._takeover_ns:
            self._silent |= {self.leader}
            self.leader = None
        if self.leader is None:
            before_us = sum(other < self._own for other in self._alive - self._silent)
            if quiet_ns >= self._takeover_ns * (1 + before_us):
                self.leader = self._own
