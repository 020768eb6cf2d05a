"""What a machine is for: the roles that were asked for, or that its name stands for in the scenes. Pure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from common.errors import BadInput
from common.keys import identifier
from deploy.security.register import Roles

if TYPE_CHECKING:
    from common.config import Scene

LONGEST_NAME = 56
"""A common name has 64 characters at most, and the generation needs some."""
HUB_RIGHTS = {"pictures": "gets pictures", "teach": "teaches", "history": "shows the history"}
"""What a hub may do besides listening, by option."""


def roles_of(scenes: Sequence["Scene"], name: str, requested: Roles) -> Roles:
    """The requested roles, or those that `name` stands for in the scenes.

    Raises BadInput for unknown ids, for an observer's id that several scenes have, and for a name that means nothing.
    """
    identifier(name, "machine")
    if len(name) > LONGEST_NAME:
        raise BadInput(f"machine = {name!r}: {len(name)} characters; choose a name of at most {LONGEST_NAME}")
    rights = {right: True for right in HUB_RIGHTS if getattr(requested, right)}
    roles = _without_rights(scenes, name, requested.model_copy(update=dict.fromkeys(HUB_RIGHTS, False)))
    for right in rights:
        if not (roles.hub or roles.hub_of):
            what = HUB_RIGHTS[right]
            raise BadInput(f"--{right}: {name} is for {roles}, and only a hub {what}; add --hub, or --hub-of SCENE")
    return roles.model_copy(update=rights)


def _without_rights(scenes: Sequence["Scene"], name: str, requested: Roles) -> Roles:
    if requested.words:
        hub_of = tuple(_scene(scenes, scene).scene for scene in requested.hub_of)
        return Roles(
            observers=tuple(_observer(scenes, observer) for observer in requested.observers),
            fusions=tuple(_fusion(scenes, fusion) for fusion in requested.fusions),
            hub=requested.hub or (len(scenes) == 1 and bool(hub_of)),
            hub_of=hub_of if len(scenes) > 1 else (),
            router=requested.router,
        )
    is_observer = any(name in scene.observers for scene in scenes)
    is_fusion = any(name in scene.services for scene in scenes)
    if is_observer and is_fusion:
        raise BadInput(
            f"{name!r}: an observer and a fusion service have this name; say --observer {name} or --fusion {name}"
        )
    if is_observer:
        return Roles(observers=(_observer(scenes, name),))
    if is_fusion:
        return Roles(fusions=(name,))
    if name in ("router", "hub"):
        return Roles(router=name == "router", hub=name == "hub")
    known = ", ".join(dict.fromkeys(name for scene in scenes for name in [*scene.observers, *scene.services]))
    raise BadInput(
        f"{name!r}: no process has this name ({known}, hub, router); say what this machine is for: "
        "--observer ID, --fusion ID, --hub, --router"
    )


def _observer(scenes: Sequence["Scene"], name: str) -> str:
    """The observer's name in the register: its id, in an authority of several scenes with its scene."""
    if len(scenes) == 1 and "/" not in name:
        scenes[0].observer(name)
        return name
    scene_name, slash, observer = name.rpartition("/")
    if slash:
        _scene(scenes, scene_name).observer(observer)
        return name if len(scenes) > 1 else observer
    holders = [scene.scene for scene in scenes if name in scene.observers]
    if not holders:
        raise BadInput(f"observer {name!r}: in none of the scenes; known: {', '.join(qualified_observers(scenes))}")
    if len(holders) > 1:
        raise BadInput(f"observer {name!r}: in scenes {' and '.join(holders)}; say --observer {holders[0]}/{name}")
    return f"{holders[0]}/{name}"


def qualified_observers(scenes: Sequence["Scene"]) -> list[str]:
    """All observers of several scenes as `SCENE/ID`."""
    return [f"{scene.scene}/{observer}" for scene in scenes for observer in scene.observers]


def _fusion(scenes: Sequence["Scene"], name: str) -> str:
    """The fusion service's name in the register. Services that share scenes stand in no scene file: any id is legal."""
    scene_name, slash, fusion = name.rpartition("/")
    if slash:
        _scene(scenes, scene_name)
    if len(scenes) == 1:
        scenes[0].require_service(fusion)
        return fusion
    identifier(fusion, "--fusion")
    return name


def _scene(scenes: Sequence["Scene"], name: str) -> "Scene":
    for scene in scenes:
        if scene.scene == name:
            return scene
    raise BadInput(f"scene {name!r}: none of the scenes; known: {', '.join(scene.scene for scene in scenes)}")
