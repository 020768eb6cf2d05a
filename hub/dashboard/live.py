"""A scene on the mesh, told to the audience: verdicts at once, the state at most ten times a second."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from common.keys import observer_of
from common.messages import VerdictMessage
from hub.dashboard import picture
from hub.dashboard.chronicle import Chronicle
from hub.dashboard.events import event
from hub.scene_state import SceneState
from hub.session import Heard, listen

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link
    from hub.dashboard.audience import Audience

STATE_EVERY_NS = 100_000_000
CROWD_EVERY_NS = 300_000_000
"""The state of a crowd of judges is long, and nobody reads two hundred lines ten times a second."""


def first_chronicle(scene: "Scene", now_ns: int) -> Chronicle:
    """What is known before anything was heard."""
    return Chronicle(SceneState(scene.scene, scene.roster, now_ns))


def follow(
    scene: "Scene", link: "Link", audience: "Audience", go_on: Callable[[], bool], note: Callable[[Heard], None]
) -> None:
    """Tell `audience` all that is heard in `scene` while `go_on()`; `note` is given it too."""
    presence = link.presence(scene.keys.observer_alive())
    chronicle, told_ns = first_chronicle(scene, 0), 0
    for heard in listen(scene, link, go_on):
        note(heard)
        chronicle = chronicle.hear(heard.state, heard.message)
        before, chronicle = chronicle, chronicle.with_presence(map(observer_of, presence.alive))
        verdict = _as_event(heard.message, chronicle, scene.fusion.quorum)
        now_ns = heard.state.now_ns
        every_ns = CROWD_EVERY_NS if len(chronicle.state.judges) > picture.CROWD else STATE_EVERY_NS
        if abs(now_ns - told_ns) >= every_ns or before is not chronicle:
            told_ns = now_ns
            audience.tell(chronicle, verdict, event("state", picture.state(chronicle)))
        elif verdict is not None:
            audience.tell(chronicle, verdict)


def _as_event(message: object, chronicle: Chronicle, quorum: int) -> bytes | None:
    if not isinstance(message, VerdictMessage):
        return None
    return event("verdict", picture.verdict(message, chronicle, quorum))
