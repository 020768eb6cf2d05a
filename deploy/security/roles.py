"""What a named machine is there for: from what was asked, else from its name. Pure."""

from typing import TYPE_CHECKING

from common.errors import BadInput
from common.keys import identifier
from deploy.security.register import Roles

if TYPE_CHECKING:
    from common.config import Scene

LONGEST_NAME = 56
"""A common name has 64 characters at most, and the generation needs some."""


def roles_of(scene: "Scene", name: str, asked: Roles) -> Roles:
    """`asked`, or what `name` stands for in the scene; raises BadInput for unknown ids and for a name of nothing."""
    identifier(name, "machine")
    if len(name) > LONGEST_NAME:
        raise BadInput(f"machine = {name!r}: {len(name)} characters; {LONGEST_NAME} are the most")
    if asked.words:
        for observer in asked.observers:
            scene.observer(observer)
        for fusion in asked.fusions:
            scene.for_service(fusion)
        return asked
    is_observer, is_fusion = name in scene.observers, name in scene.services
    if is_observer and is_fusion:
        raise BadInput(
            f"{name!r}: an observer and a fusion service have this name; say --observer {name} or --fusion {name}"
        )
    if is_observer:
        return Roles(observers=(name,))
    if is_fusion:
        return Roles(fusions=(name,))
    if name in ("router", "hub"):
        return Roles(router=name == "router", hub=name == "hub")
    known = ", ".join([*scene.observers, *scene.services, "hub", "router"])
    raise BadInput(
        f"{name!r}: no process of the scene has this name ({known}); say what this machine is for: "
        "--observer ID, --fusion ID, --hub, --router"
    )
