"""Listening to one scene: what comes over the mesh becomes a stream of scene states."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common.keys import SceneKeys
from common.messages import JudgementMessage, Message, StatusMessage, VerdictMessage, VocabularyMessage
from common.wire import BadMessage, decode
from hub.scene_state import Role, SceneState

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link

KINDS: dict[str, type[Message]] = {
    "judgement": JudgementMessage,
    "verdict": VerdictMessage,
    "status": StatusMessage,
    "vocabulary": VocabularyMessage,
}
"""What is spoken where: the last part of a key names the kind of message."""
TAKE_S = 0.1
"""How long one look into the inbox waits: so fast a view learns that time has passed or that it should end."""
ASK_S = 0.5
ASK_AGAIN_S = 2.0
"""While the judgements speak a vocabulary that nobody has told us, it is asked for this often."""


@dataclass(frozen=True, slots=True)
class Heard:
    """The scene after `message`; None where nothing new was heard: time has passed, or it was a copy or unusable."""

    state: SceneState
    message: Message | None = None


def listen(
    scene: "Scene", link: "Link", go_on: Callable[[], bool], clock: Callable[[], int] = time.time_ns
) -> Iterator[Heard]:
    """What is heard of `scene` while `go_on()`: one Heard for each message and one after each look into the inbox.

    Last values are asked for first, so that who comes late knows at once. Messages that cannot be understood
    are counted in the state and dropped. `clock` is this machine's time in ns since the epoch.
    """
    keys = SceneKeys(scene.scene, scene.mesh.prefix)
    state = SceneState(scene.scene, tuple(scene.observers), clock())
    spoken = (keys.judgement, keys.verdict, keys.observer_status(), keys.fusion_status(), keys.vocabulary)
    inbox = link.inbox(*spoken)
    for key, payload in link.ask_each(f"{keys.root}/**", ASK_S):
        heard = _hear(state, key, payload, clock(), told=True)
        state = heard.state
        yield heard
    asked_ns = clock()
    while go_on():
        arrivals = inbox.take(TAKE_S)
        for arrival in arrivals:
            heard = _hear(state, arrival.key, arrival.payload, arrival.arrived_ns)
            state = heard.state
            yield heard
        state = state.at(clock())
        if state.missing_vocabulary and state.now_ns - asked_ns > ASK_AGAIN_S * 1e9:
            asked_ns = state.now_ns
            for key, payload in link.ask_each(keys.vocabulary, ASK_S):
                state = _hear(state, key, payload, state.now_ns).state
        yield Heard(state)


def _hear(state: SceneState, key: str, payload: bytes, now_ns: int, told: bool = False) -> Heard:
    """One payload folded in; a judgement `told` on asking may be old, so it was heard when it was made."""
    state = state.at(now_ns)
    kind = KINDS.get(key.rsplit("/", 1)[-1])
    if kind is None:
        return Heard(state)
    try:
        message = decode(kind, payload)
    except BadMessage:
        return Heard(state.reject())
    heard_ns = min(now_ns, message.at_ns) if told and isinstance(message, JudgementMessage) else now_ns
    role: Role = "fusion" if key.rsplit("/", 3)[-3:-2] == ["fusion"] else "observer"
    folded = state.fold(message, heard_ns, role)
    return Heard(folded, None if folded is state else message)
