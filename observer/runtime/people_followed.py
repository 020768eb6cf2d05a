"""How many people an observer of a scene follows. Pure."""

from observer.geometry.views import View


def people_followed(most: int, observers: int, view: View) -> int:
    """As many as the scene judges, `most`, if it can be known who is who: by where they stand in the room of a camera
    file, or because no other one of the `observers` looks. Another observer follows one person."""
    return most if view.has_place or observers == 1 else 1


def follows_one(most: int, observers: int, view: View, followed: int) -> str:
    """That the observer follows one person although the scene judges several, and what to do; "" if it is not so.

    followed: how many people its tracker follows.
    """
    if followed > 1 or most == 1:
        return ""
    can_tell = people_followed(most, observers, view) == most
    way_out = "choose the tracker mediapipe" if can_tell else "calibrate this camera"
    return f"follows one person, who counts while nobody else is there; to tell several apart {way_out}"
