"""How many people an observer of a scene follows. Pure."""

from observer.geometry.views import View


def people_followed(most: int, observers: int, view: View) -> int:
    """As many as the scene judges, `most`, if it can be known who is who: by where they stand in the room of a camera
    file, or because no other one of the `observers` looks. Another observer follows one person."""
    return most if view.has_place or observers == 1 else 1


def follows_one(most: int, observers: int, view: View) -> str:
    """That the observer follows one person although the scene judges several, and what to do; "" if it is not so."""
    if people_followed(most, observers, view) == most:
        return ""
    return "follows one person, who counts while nobody else is there: calibrate this camera to tell several apart"
