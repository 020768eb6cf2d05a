"""Which fusion service publishes for a scene: one state machine for standby services and for shared scenes. Pure.

The rules, by number: docs/design/fusion.md, "Several services". Times are seconds of a monotonic clock.
"""

import hashlib
from collections.abc import Callable, Iterable
from enum import Enum

EPOCHS_AHEAD = 1_000_000
"""An epoch rises by one with each takeover; one that is higher by more is a forgery, and its successor may overflow."""

LEFT_S = 0.03
"""A lost connection takes the tokens of all others with it, a moment before it is known to be lost."""
START_S = 0.3
"""So long after a start all tokens are known. An owner is heard several times meanwhile, unless it is suspended."""


class Role(Enum):
    """What a service does for a scene.

    IDLE: not next in rank, so that it does not listen. STANDBY: it listens. REQUESTING: it asks the owner for the
    scene. OWNER: it publishes.
    """

    IDLE = "idle"
    STANDBY = "standby"
    REQUESTING = "requesting"
    OWNER = "owner"


def rendezvous_rank(scene: str, services: Iterable[str]) -> tuple[str, ...]:
    """The services by their weight in the scene, the heaviest first; the same in every process."""
    return tuple(sorted(set(services), key=lambda service: _weight(scene, service), reverse=True))


def _weight(scene: str, service: str) -> bytes:
    """The weight of a service in a scene (rule 1)."""
    # No name contains a space, so no two pairs give the same text.
    return hashlib.blake2b(f"{scene} {service}".encode(), digest_size=16).digest()


class Ownership:
    """The role of the service `own` in one scene.

    ranked: the services that the scene file names, in its order; empty for a scene that all services share.
    takeover_s: how long an owner may publish nothing.
    """

    def __init__(self, own: str, scene: str, ranked: tuple[str, ...], takeover_s: float) -> None:
        self._own, self._scene, self._ranked, self._takeover_s = own, scene, ranked, takeover_s
        self._others: frozenset[str] = frozenset()
        self._older: frozenset[str] | None = None
        self._silent: frozenset[str] = frozenset()
        self._has_met_others = self._was_owner = False
        self._silent_since_s = 0.0
        self._resumed_s = self._disconnected_s = self._owner_left_s = float("-inf")
        self._updated_s: float | None = None
        self.role = Role.IDLE
        self.owner: str | None = None
        """The service that owns the scene, as far as it is known; possibly `own`."""
        self.epoch = 0
        """The epoch of the owner; of `own` while it is the owner."""

    def set_alive(self, alive: Iterable[str], now_s: float) -> None:
        """Take the services whose liveliness tokens exist now."""
        present = frozenset(alive) - {self._own}
        if self._ranked:
            present &= frozenset(self._ranked)
        gone, self._others = self._others - present, present
        self._has_met_others |= bool(present)
        # Tokens come back in any order after a lost connection (rule 6).
        self._older = present if self._older is None or self._has_reconnected(now_s) else self._older & present
        self._silent &= present
        if self.owner in gone:
            # Rule 3: the first of the others hardly waits.
            self.owner, self._silent_since_s, self._owner_left_s = None, now_s - self._takeover_s, now_s

    def record_message(self, service: str, epoch: int, now_s: float) -> bool:
        """Take a message that another service published; returns whether that service is the owner to follow.

        A message of a service whose liveliness token has disappeared is its last one and changes nothing; so does one
        whose epoch no service can have reached.
        """
        if service not in self._others or epoch > self.epoch + EPOCHS_AHEAD:
            return False
        rival = self._own if self.role is Role.OWNER else self.owner
        if rival not in (None, service) and not self._precedes(service, epoch, rival):
            return False
        if rival is None and epoch < self.epoch and self._has_just_resumed(now_s):
            # It was the owner before this service was. If each followed the other, neither would publish.
            return False
        self._silent -= {service}
        self._was_owner = False
        if self.role is Role.OWNER:
            self.role = Role.STANDBY
        self.owner, self.epoch, self._silent_since_s = service, max(epoch, self.epoch), now_s
        return True

    def is_present(self, service: str) -> bool:
        """Whether the liveliness token of another service exists."""
        return service in self._others

    def record_heartbeat(self, now_s: float) -> None:
        """Take a message that was not decoded: the owner, if it is known, is not silent."""
        if self.role is not Role.OWNER:
            self._silent_since_s = now_s

    def update(self, now_s: float, connected: Callable[[], bool] = lambda: True) -> Role:
        """Follow the rules at one step; to be called at every step, after everything that has arrived was taken.

        connected: whether this process can reach any other now (rule 6).
        """
        was_suspended = self._updated_s is None or now_s - self._updated_s > self._takeover_s
        if was_suspended and self._updated_s is not None:
            self._resumed_s = now_s
        self._updated_s = now_s
        if self._ranked == (self._own,):
            self._become_owner()
        elif was_suspended and self._others_may_exist(now_s):
            # One that stood by goes on waiting for the owner, which may have been suspended with it.
            self._was_owner = self.role is Role.OWNER
            self.owner = None if self._was_owner else self.owner
            self.role, self._silent_since_s = Role.STANDBY, now_s
        elif self.role is not Role.OWNER:
            self._follow_rank(now_s, connected)
        return self.role

    def complete_handover(self) -> None:
        """Become the owner: the previous one has handed over, or did not answer."""
        if self.role is Role.REQUESTING:
            self._become_owner()

    def hand_over_to(self, service: str, now_s: float) -> bool:
        """Hand the scene over to `service`, which has asked for it, if rule 4 allows; returns whether it does."""
        if self._ranked or self.role is not Role.OWNER or service not in self._others:
            return False
        if self._rank((self._own, service))[0] != service:
            return False
        self.role, self.owner, self._silent_since_s = Role.STANDBY, service, now_s
        return True

    def _follow_rank(self, now_s: float, connected: Callable[[], bool]) -> None:
        if not connected():
            self._silent_since_s = self._disconnected_s = now_s
        silent_s = now_s - self._silent_since_s
        # The owner may have been stopped too (rule 7), and then it comes back first.
        if self.owner is not None and silent_s > self._takeover_s * (2 if self._has_just_resumed(now_s) else 1):
            self._silent |= {self.owner}
            self.owner = None
        rank = self._rank({self._own, *self._others} - self._silent).index(self._own)
        if rank > 1 and not self._ranked:
            self.role, self.owner = Role.IDLE, None
        elif self.role is Role.IDLE and self._others_may_exist(now_s):
            # It begins to listen now.
            self.role, self.owner, self._silent_since_s = Role.STANDBY, None, now_s
        elif self.owner is None:
            # An owner that was suspended goes on first, whatever its rank (rule 7).
            turn = 0 if self._was_owner else rank
            waits_s = self._listens_s(now_s) * (1 + turn)
            self.role = Role.STANDBY
            if connected() and silent_s >= waits_s and now_s - self._owner_left_s >= LEFT_S:
                self._become_owner()
        elif rank == 0 and not self._ranked:
            self.role = Role.REQUESTING
        else:
            self.role = Role.STANDBY

    def _listens_s(self, now_s: float) -> float:
        """How long the first in rank listens for an owner before it becomes the owner."""
        others_may_own = self._older or self._ranked or self._has_reconnected(now_s)
        return self._takeover_s if others_may_own else min(START_S, self._takeover_s)

    def _has_just_resumed(self, now_s: float) -> bool:
        """Whether this process was suspended lately (rule 7), for some takeover times."""
        return now_s - self._resumed_s < 4 * self._takeover_s

    def _others_may_exist(self, now_s: float) -> bool:
        """Whether another service may own the scene.

        One that the scene file names, or that was known before this one lost its connection, may be out of reach.
        """
        return bool(self._others) or len(self._ranked) > 1 or self._has_reconnected(now_s)

    def _has_reconnected(self, now_s: float) -> bool:
        """Whether this service has lost its connection lately, and the tokens of others with it."""
        return self._has_met_others and now_s - self._disconnected_s < self._takeover_s

    def _become_owner(self) -> None:
        self._was_owner = False
        if self.role is not Role.OWNER:
            self.role, self.owner, self.epoch = Role.OWNER, self._own, self.epoch + 1

    def _precedes(self, service: str, epoch: int, rival: str | None) -> bool:
        """Whether `service` stays the owner, and `rival` stands by (rule 5)."""
        if epoch != self.epoch or rival is None:
            return epoch > self.epoch
        return self._rank((service, rival))[0] == service

    def _rank(self, services: Iterable[str]) -> tuple[str, ...]:
        """The services in their order (rule 1), the first in rank first."""
        if self._ranked:
            return tuple(service for service in self._ranked if service in set(services))
        return rendezvous_rank(self._scene, services)
