"""Listening to one scene: messages from the mesh become a stream of scene states."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.keys import SceneKeys
from common.messages import JudgementMessage, StatusMessage, VerdictMessage, VocabularyMessage
from common.wire import BadMessage, decode_from
from hub.scene_state import SceneMessage, SceneState, SenderRole

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link

KINDS: dict[str, type[JudgementMessage] | type[StatusMessage] | type[VocabularyMessage]] = {
    "judgement": JudgementMessage,
    "verdict": VerdictMessage,
    "status": StatusMessage,
    "vocabulary": VocabularyMessage,
}
"""The last part of a key names the kind of message."""
TAKE_S = 0.1
"""How long one look into the inbox waits, so that a view notices soon that time has passed or that it should end."""
QUERY_S = 0.5
QUERY_AGAIN_S = 2.0
"""How often a vocabulary that judgements refer to and that is unknown here is queried."""


@dataclass(frozen=True, slots=True)
class SceneUpdate:
    """The scene after `message`; None when time has passed, or the message was a copy or was rejected.

    answered: it answers the query at the start, and may be long past.
    """

    state: SceneState
    message: SceneMessage | None = None
    answered: bool = False


def listen(
    scene: "Scene",
    link: "Link",
    go_on: Callable[[], bool],
    clock: Callable[[], int] = time.time_ns,
    newest_only: bool = False,
) -> Iterator[SceneUpdate]:
    """Updates of `scene` while `go_on()`: one for each message and one after each look into the inbox.

    The last values are queried first, so that a late joiner knows them at once. Rejected messages are counted in the
    state. `clock` is this machine's time in ns since the epoch. newest_only: of all judgements since the last look only
    the newest is decoded, for hubs that pass on a few a second.
    """
    keys = scene.keys
    state = SceneState(scene.scene, scene.roster, clock())
    events = (keys.verdict, keys.observer_status(), keys.fusion_status(), keys.vocabulary)
    inbox = link.inbox(*events, *([] if newest_only else [keys.judgement]))
    newest = link.inbox(keys.judgement, limit=1) if newest_only else None
    answers = link.ask_each(f"{keys.root}/**", QUERY_S)
    waiting = inbox.take(0.0)
    # A verdict that was published between the opening of the inbox and the query is new.
    new = {(arrival.key, arrival.payload) for arrival in waiting}
    for key, payload in answers:
        if (key, payload) not in new:
            update = _ingest(state, keys, key, payload, clock(), answered=True)
            state = update.state
            yield update
    queried_ns = clock()
    while waiting or go_on():
        arrivals, waiting = waiting or inbox.take(TAKE_S), []
        # A verdict precedes the judgement that shows it.
        for arrival in (*arrivals, *(newest.take(0.0) if newest else ())):
            update = _ingest(state, keys, arrival.key, arrival.payload, arrival.arrived_ns)
            state = update.state
            yield update
        state = state.at(clock(), inbox.dropped)
        if state.missing_vocabulary and state.now_ns - queried_ns > QUERY_AGAIN_S * SECOND_NS:
            queried_ns = state.now_ns
            for key, payload in link.ask_each(keys.vocabulary, QUERY_S):
                state = _ingest(state, keys, key, payload, state.now_ns).state
        yield SceneUpdate(state)


def decode_for_hub(keys: SceneKeys, key: str, payload: bytes) -> SceneMessage | None:
    """The message under `key`; None for a kind that hubs do not read.

    The key identifies the sender. Raises BadMessage for unusable bytes, and for another scene or sender inside.
    """
    parts = key.removeprefix(f"{keys.root}/").split("/")
    kind = KINDS.get(parts[-1])
    if kind is None or len(parts) != (3 if kind is StatusMessage else 1):
        return None
    message: SceneMessage = decode_from(key, kind, payload)
    return message


def _ingest(
    state: SceneState, keys: SceneKeys, key: str, payload: bytes, now_ns: int, answered: bool = False
) -> SceneUpdate:
    """Fold in one payload; a judgement that answers a query dates from when it was made."""
    state = state.at(now_ns)
    try:
        message = decode_for_hub(keys, key, payload)
    except BadMessage:
        return SceneUpdate(state.reject(), answered=answered)
    if message is None:
        return SceneUpdate(state, answered=answered)
    received_ns = min(now_ns, message.at_ns) if answered and isinstance(message, JudgementMessage) else now_ns
    role: SenderRole = "fusion" if key.startswith(f"{keys.root}/fusion/") else "observer"
    folded = state.fold(message, received_ns, role)
    return SceneUpdate(folded, None if folded is state else message, answered)
