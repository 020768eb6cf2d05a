"""Listening to one scene: messages from the mesh become a stream of scene states, if wanted in a thread of its own."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from common import SECOND_NS
from common.config import Scene
from common.fall_messages import FallMessage
from common.inbox import Inbox
from common.keys import SceneKeys, observer_of
from common.link import Link
from common.message_checks import check_vocabulary
from common.messages import JudgementMessage, StatusMessage, VerdictMessage
from common.same_movement import JudgingServices, SameMovement
from common.wire import BadMessage, decode_from
from hub.scene_state import (
    MESSAGE_KINDS,
    VERDICTS_WAIT_LIMIT,
    SceneMessage,
    SceneState,
    SenderRole,
    is_abstention,
)

TAKE_S = 0.1
"""How long one look into the inbox waits, so that a view notices soon that time has passed or that it should end."""
QUERY_S = 0.5
QUERY_AGAIN_S = 2.0
"""How often a vocabulary that judgements refer to and that is unknown here is queried, and verdicts at most."""
LISTENER_END_S = 5.0


@dataclass(frozen=True, slots=True)
class SceneUpdate:
    """The scene after `message`; None when time has passed, or the message was a copy, or was rejected, or repeats the
    stage of the watch for falls.

    answered: it answers a query, and may be long past.
    """

    state: SceneState
    message: SceneMessage | None = None
    answered: bool = False


def listen(
    scene: Scene,
    link: Link,
    go_on: Callable[[], bool],
    clock: Callable[[], int] = time.time_ns,
    newest_only: bool = False,
) -> Iterator[SceneUpdate]:
    """Updates of `scene` while `go_on()`: one for each message and one after each look into the inbox.

    The last values are queried first, so that a late joiner knows them at once; the last verdicts again when a fusion
    service appears, as after a lost link: what it published meanwhile was lost. Rejected messages are counted in the
    state. `clock` is this machine's time in ns since the epoch. newest_only: of all judgements since the last look only
    the newest is decoded, of several people as many of the newest, for hubs that pass on a few a second.
    """
    keys = scene.keys
    taken = _Taken(keys, SceneState(scene.scene, scene.roster, clock(), services=scene.services))
    events = (keys.verdict, keys.observer_status(), keys.fusion_status(), keys.vocabulary, keys.fall)
    inbox = link.inbox(*events, *([] if newest_only else [keys.judgement]))
    newest = link.inbox(keys.judgement, limit=scene.people.most) if newest_only else None
    services, late = link.presence(keys.fusion_alive(), map(keys.fusion_alive, scene.services)), Inbox()
    answers = link.ask_each(f"{keys.root}/**", QUERY_S)
    appearances, waiting = services.appearances, inbox.take(0.0)
    # A verdict that was published between the opening of the inbox and the query is new.
    new = {(arrival.key, arrival.payload) for arrival in waiting}
    for key, payload in (answer for answer in answers if answer not in new):
        yield taken.ingest(key, payload, clock(), answered=True)
    queried_ns = clock()
    while waiting or go_on():
        arrivals, waiting = waiting or inbox.take(TAKE_S), []
        # A verdict precedes the judgement that shows it.
        published = [*arrivals, *(newest.take(0.0) if newest else ())]
        for n, arrival in enumerate((*published, *late.take(0.0))):
            yield taken.ingest(arrival.key, arrival.payload, arrival.arrived_ns, answered=n >= len(published))
        skipped = newest.dropped if newest else 0
        taken.state = state = replace(taken.state, now_ns=clock(), dropped=inbox.dropped, skipped=skipped)
        if services.appearances != appearances and state.now_ns - queried_ns > QUERY_AGAIN_S * SECOND_NS:
            queried_ns, appearances = state.now_ns, services.appearances
            link.request(keys.verdict, late.put, QUERY_S)
        if state.missing_vocabulary and state.now_ns - queried_ns > QUERY_AGAIN_S * SECOND_NS:
            queried_ns = state.now_ns
            for key, payload in link.ask_each(keys.vocabulary, QUERY_S):
                taken.ingest(key, payload, state.now_ns)
        yield SceneUpdate(taken.state)


def decode_for_hub(keys: SceneKeys, key: str, payload: bytes) -> SceneMessage | None:
    """The message under `key`; None for a kind that hubs do not read.

    The key identifies the sender. Raises BadMessage for unusable bytes, and for another scene or sender inside.
    """
    parts = key.removeprefix(f"{keys.root}/").split("/")
    kind = MESSAGE_KINDS.get(parts[-1])
    if kind is None or len(parts) != (3 if kind is StatusMessage else 1):
        return None
    message: SceneMessage = decode_from(key, kind, payload)
    return message


class _Taken:
    """The state after all messages that were taken, and what is remembered to tell which ones to take."""

    def __init__(self, keys: SceneKeys, state: SceneState) -> None:
        self.state, self._keys, self._same, self._services = state, keys, SameMovement(), JudgingServices()

    def ingest(self, key: str, payload: bytes, now_ns: int, answered: bool = False) -> SceneUpdate:
        """Fold in one payload; a judgement that answers a query dates from when it was made."""
        before = self.state = self.state.at(now_ns)
        role: SenderRole = "fusion" if key.startswith(f"{self._keys.root}/fusion/") else "observer"
        try:
            message = self._checked(key, payload, role, answered)
        except BadMessage:
            self.state = before.reject()
            return SceneUpdate(self.state, answered=answered)
        if message is None:
            return SceneUpdate(before, answered=answered)
        received_ns = min(now_ns, message.at_ns) if answered and isinstance(message, JudgementMessage) else now_ns
        self.state = before.fold(message, received_ns, role)
        is_old = self.state is before or (isinstance(message, FallMessage) and before.has_stage(message))
        return SceneUpdate(self.state, None if is_old else message, answered)

    def _checked(self, key: str, payload: bytes, role: SenderRole, answered: bool) -> SceneMessage | None:
        """The message, None for one that says nothing new; raises BadMessage."""
        message = decode_for_hub(self._keys, key, payload)
        if isinstance(message, JudgementMessage):
            _require_known(self.state, message, answered)
        if isinstance(message, VerdictMessage | FallMessage):
            if not (answered or self._services.knows(message)):
                raise BadMessage("wrong_key", "of no service that judges")
            return self._same.take(message) if isinstance(message, VerdictMessage) else message
        if isinstance(message, JudgementMessage):
            self._services.hear(message)
            return self._same.judged(message)
        if isinstance(message, StatusMessage) and role == "fusion":
            self._services.hear(message)
        return message


def _require_known(state: SceneState, message: JudgementMessage, answered: bool) -> None:
    """Raises BadMessage for labels outside of the vocabulary, and for a verdict in a vocabulary that nobody judges in.

    Anybody may publish on a mesh without certificates. Verdicts of an earlier vocabulary answer the query at the start,
    or end a movement that is known.
    """
    known = [each for each in (state.vocabulary, state.next_vocabulary) if each is not None]
    for each in known:
        if each.hash == message.vocabulary.hash:
            check_vocabulary(message, each.vocabulary)
            return
    if not isinstance(message, VerdictMessage) or answered or any(each.id == message.id for each in state.verdicts):
        return
    judged = [] if state.judgement is None else [state.judgement.vocabulary.hash]
    if (known or judged) and message.vocabulary.hash not in judged:
        raise BadMessage("foreign_vocabulary", f"hash {message.vocabulary.hash}, which nobody judges in")


@dataclass(frozen=True, slots=True)
class ArrivedVerdict:
    """A verdict; `answered`: it answers a query, and may be long past."""

    verdict: VerdictMessage
    answered: bool


def newly_decided(arrived: "deque[ArrivedVerdict]") -> list[VerdictMessage]:
    """The first words of the movements in `arrived`, which is empty afterwards; each movement has one."""
    taken = [arrived.popleft() for _ in range(len(arrived))]
    new = [each.verdict for each in taken if not each.answered]
    return [each for each in new if each.stage == "decided" or is_abstention(each)]


class SceneListener:
    """Listens to `scene` in a thread, for a loop that does something else; a context manager.

    note: called with every update, in that thread. newest_only: as in `listen`. state: the newest. ready: whether the
    last values have been queried; before that `state` is incomplete. verdicts: those that arrived; the reader empties
    it.
    """

    def __init__(
        self,
        scene: Scene,
        link: Link,
        note: Callable[[SceneUpdate], None] = lambda update: None,
        newest_only: bool = True,
    ) -> None:
        self.state = SceneState(scene.scene, scene.roster, services=scene.services)
        self.ready = False
        self.verdicts: deque[ArrivedVerdict] = deque(maxlen=VERDICTS_WAIT_LIMIT)
        self._fault: Exception | None = None
        self._scene, self._link, self._note, self._newest_only = scene, link, note, newest_only
        self._ended = threading.Event()
        self._presence = link.presence(scene.keys.observer_alive(), map(scene.keys.observer_alive, scene.roster))
        self._thread = threading.Thread(target=self._listen, name=f"listen-{scene.scene}", daemon=True)

    @property
    def tokens(self) -> frozenset[str]:
        """The observers whose processes can be reached."""
        return frozenset(map(observer_of, self._presence.alive))

    def check(self) -> None:
        """Raise the exception that ended the thread, if one did."""
        if self._fault is not None:
            raise self._fault

    def _listen(self) -> None:
        try:
            updates = listen(self._scene, self._link, lambda: not self._ended.is_set(), newest_only=self._newest_only)
            for update in updates:
                self.state = update.state
                if isinstance(update.message, VerdictMessage):
                    self.verdicts.append(ArrivedVerdict(update.message, update.answered))
                self.ready = self.ready or not update.answered
                self._note(update)
        except Exception as error:  # noqa: BLE001 - the loop that reads from us raises it
            self._fault = error

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(LISTENER_END_S)


def has_right(scene: Scene, right: str) -> bool:
    """Whether this process's certificate, if the mesh has any, is for `pictures`, to `teach`, or for `history`."""
    if not scene.mesh.credentials:
        return True
    # Slow to import, and needed only with certificates.
    from common.credentials import own_certificate

    return own_certificate(Path(scene.mesh.credentials)).is_for(right)
