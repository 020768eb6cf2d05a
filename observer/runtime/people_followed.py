"""How many people an observer of a scene follows. Pure."""

from common.config import Scene
from observer.geometry.views import View


def people_followed(scene: Scene, view: View) -> int:
    """As many as the scene judges, if it can be known who is who: by where they stand in the room of a camera file, or
    because no other camera looks. Another observer follows one person."""
    known = view.has_place or len(scene.observers) == 1
    return scene.people.most if known else 1


def follows_one(scene: Scene, view: View) -> str:
    """That the observer follows one person although the scene judges several, and what to do; "" if it is not so."""
    if people_followed(scene, view) == scene.people.most:
        return ""
    return "follows one person, who counts while nobody else is there: calibrate this camera to tell several apart"
