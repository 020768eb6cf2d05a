"""Whether the camshift tracker suits the picture: why it loses sight, and what would help, in one line; pure."""

from observer.tracking.skin import Picture

PATIENCE_S = 5.0
"""So long no face may be found before anybody is told; and so long what was told stands."""
DARK = 40.0
"""Mean of a picture, 0 to 255, under which hues are noise."""
COVERED = 0.2
"""Where more of the picture has the colour of a face, either is none, or nothing can be told by colour."""
NARROW_PX = 24.0
"""A hand of a face narrower than this is about a dozen pixels wide."""


def why(unfound_s: float, brightness: float, covered: float, face_px: float | None) -> str:
    """One line, or "" when all is well.

    unfound_s: for how long no face was found. brightness: the picture's mean, 0 to 255. covered: share of the picture
    in the colour of the face found last, 0 to 1. face_px: its width, None before the first.
    """
    if unfound_s < PATIENCE_S:
        if face_px is not None and face_px < NARROW_PX:
            return f'the face is {face_px:.0f} px wide: nearer, a larger picture, or tracker = "mediapipe"'
        return ""
    lost = f"no face found for {PATIENCE_S:.0f} s"
    if brightness < DARK:
        return f'{lost}: the picture is dark (mean {brightness:.0f} of 255); more light, or tracker = "mediapipe"'
    if covered >= COVERED:
        return f'{lost}: skin colour covers {covered:.0%} of the picture; another wall, or tracker = "mediapipe"'
    return f'{lost}: face the camera, come nearer, or tracker = "mediapipe"'


class Hint:
    """Keeps the line while nothing new is to be said."""

    def __init__(self) -> None:
        self.complaint, self._unfound_s, self._stood_s = "", 0.0, PATIENCE_S

    def update(self, followed: bool, face_px: float | None, covered: float, small: Picture, seconds: float) -> None:
        """After each frame; followed: whether there is a head now; small: the picture, of any size."""
        self._unfound_s = 0.0 if followed else self._unfound_s + seconds
        self._stood_s += seconds
        well = followed and (face_px is None or face_px >= NARROW_PX)
        if well:
            self.complaint, self._stood_s = "", PATIENCE_S
        elif self._stood_s >= PATIENCE_S:
            said = why(self._unfound_s, float(small[::8, ::8].mean()), covered, face_px)
            self.complaint, self._stood_s = said, 0.0 if said else PATIENCE_S
