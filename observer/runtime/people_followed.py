"""How many people an observer of a scene follows. Pure."""

from observer.geometry.views import View


def people_followed(most: int, observers: int, view: View) -> int:
    """How many people the observer follows: `most`, as the scene judges, if people can be told apart, else one.

    They can be told apart by where they stand, if the view is a camera file, or if no other of the `observers` looks.
    """
    return most if view.has_place or observers == 1 else 1


def follows_one(most: int, observers: int, view: View, followed: int) -> str:
    """A line that the observer follows one person although the scene judges several, and what to do; "" if it does not.

    followed: how many people its tracker follows.
    """
    if followed > 1 or most == 1:
        return ""
    can_tell = people_followed(most, observers, view) == most
    way_out = "choose the tracker mediapipe" if can_tell else "calibrate this camera"
    return f"follows one person, who counts while nobody else is there; to tell several apart {way_out}"
