"""The hubs that `labanmesh up` starts beside a scene's observers, by the names that `[hub] start` gives them."""

from common.errors import BadInput
from common.plugins import plugins
from common.text import nearest

HUBS = {"mqtt": ("hub", "mqtt"), "dashboard": ("dashboard",)}
"""By name the words that start it, which a scene file follows."""
EVENTS = ("hub", "events")
"""Those of the hub that a scene with [history] or [notify.NAME] has by itself."""


def hub_words(name: str) -> tuple[str, ...]:
    """The words that start a hub, ours or a verb of an installed package; raises BadInput for an unknown one."""
    if name not in HUBS and name not in (verbs := plugins("verbs")):
        raise BadInput(f"hub.start = {name!r}: unknown hub; {nearest(name, (*HUBS, *verbs))}")
    return HUBS.get(name, (name,))
