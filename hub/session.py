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
    """The scene after `message`; None when time has passed, or the message was a copy or was rejected."""

    state: SceneState
    message: SceneMessage | None = None


def listen(
    scene: "Scene", link: "Link", go_on: Callable[[], bool], clock: Callable[[], int] = time.time_ns
) -> Iterator[SceneUpdate]:
    """Updates of `scene` while `go_on()`: one for each message and one after each look into the inbox.

    The last values are queried first, so that a late joiner knows them at once. Rejected messages are counted in the
    state. `clock` is this machine's time in ns since the epoch.
    """
    keys = scene.keys
    state = SceneState(scene.scene, scene.roster, clock())
    inbox = link.inbox(keys.judgement, keys.verdict, keys.observer_status(), keys.fusion_status(), keys.vocabulary)
    for key, payload in link.ask_each(f"{keys.root}/**", QUERY_S):
        update = _ingest(state, keys, key, payload, clock(), answered=True)
        state = update.state
        yield update
    queried_ns = clock()
    while go_on():
        for arrival in inbox.take(TAKE_S):
            update = _ingest(state, keys, arrival.key, arrival.payload, arrival.arrived_ns)
            state = update.state
            yield update
        state = state.at(clock())
        if state.missing_vocabulary and state.now_ns - queried_ns > QUERY_AGAIN_S * SECOND_NS:
            queried_ns = state.now_ns
            for key, payload in link.ask_each(keys.vocabulary, QUERY_S):
                state = _ingest(state, keys, key, payload, state.now_ns).state
        yield SceneUpdate(state)


def decode_for_hub(keys: SceneKeys, key: str, payload: bytes) -> SceneMessage | None:
    """The message under `key`; None for a kind that hubs do not read.

    The key says who sent it. Raises BadMessage for unusable bytes, and for another scene or sender inside.
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
    """Fold in one payload; a judgement that was `answered` to our query may be old: it dates from when it was made."""
    state = state.at(now_ns)
    try:
        message = decode_for_hub(keys, key, payload)
    except BadMessage:
        return SceneUpdate(state.reject())
    if message is None:
        return SceneUpdate(state)
    received_ns = min(now_ns, message.at_ns) if answered and isinstance(message, JudgementMessage) else now_ns
    role: SenderRole = "fusion" if key.startswith(f"{keys.root}/fusion/") else "observer"
    folded = state.fold(message, received_ns, role)
    return SceneUpdate(folded, None if folded is state else message)
