"""What a look at a source has found, in words: what is there, and what to do about it. Pure."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from observer.tracks import State

DARK, BRIGHT = 45.0, 215.0
"""Mean grey levels (0 to 255) below and above which colours are lost."""
SMALL_FACE = 24
"""Width of a face, px, below which hands are a handful of pixels."""
SKIN_TONED = 0.15
"""Share of the picture from which on skin colour is not the person's alone."""


@dataclass(frozen=True, slots=True)
class Account:
    """What was found in `pictures` pictures; shares are 0 to 1.

    rate_hz: measured for a live camera, else as the recording says. brightness: mean grey level, 0 to 255. faces: in
    how many of `faces_sought` pictures there was a face, and face_px how wide the last was. skin: share of the newest
    picture that has the skin's colour, None where the tracker knows no such colour. seen: for each part the share of
    pictures in which it was seen. states: in the newest.
    """

    source: str
    tracker: str
    size_px: tuple[int, int]
    rate_hz: float
    live: bool
    pictures: int
    brightness: float
    faces: int
    faces_sought: int
    face_px: int | None
    skin: float | None
    seen: Mapping[str, float]
    states: Mapping[str, State]
    complaint: str = ""


def lines(account: Account) -> Iterator[str]:
    """The account, a line a thing."""
    width, height = account.size_px
    rate = "measured" if account.live else "as recorded"
    yield f"{account.source}: {width}x{height} px, {account.rate_hz:.3g} Hz {rate}, {account.pictures} pictures seen"
    yield f"  {'light':<12}{account.brightness:.0f} of 255"
    if account.faces_sought:
        wide = f", {account.face_px} px wide" if account.face_px else ""
        yield f"  {'face':<12}in {account.faces} of {account.faces_sought} pictures{wide}"
    if account.skin is not None:
        yield f"  {'skin':<12}its colour in {100 * account.skin:.1f} % of the picture"
    for part, state in account.states.items():
        share = f"seen in {100 * account.seen[part]:.0f} % of the pictures"
        yield f"  {part.replace('_', ' '):<12}{state.value:<8} {share}"


def advice(account: Account) -> Iterator[str]:
    """What to do, the most urgent first; one line that all is well where nothing is to be done."""
    said = list(_advice(account))
    yield from said or [f'nothing to do: tracker = "{account.tracker}" suits this picture']


def _advice(account: Account) -> Iterator[str]:
    if account.complaint:
        yield f"{account.tracker} says: {account.complaint}"
    if account.brightness < DARK:
        yield "too dark: more light, best from behind the camera"
    if account.brightness > BRIGHT:
        yield "too bright: less light, or turn the camera away from the window"
    if account.tracker == "camshift":
        yield from _about_skin(account)
    missing = [part for part, share in account.seen.items() if not share]
    if account.tracker == "camshift" and account.seen.get("head") and missing:
        named = " and ".join(part.replace("_", " ") for part in missing)
        yield f"{named} not seen: camshift takes up a hand when it moves in view; wave, and look again"
    elif account.tracker != "camshift" and missing == list(account.seen):
        yield "nobody seen: step before the camera so that head and hands are in the picture"


def _about_skin(account: Account) -> Iterator[str]:
    if not account.seen.get("head"):
        yield (
            "no face followed: face the camera, nearer; or mark it (--face X,Y,WIDTH,HEIGHT), or use skin saved "
            "elsewhere (--skin FILE), or --tracker mediapipe"
        )
    elif account.face_px and account.face_px < SMALL_FACE:
        yield f"a face of {account.face_px} px is small: nearer, or larger pictures, or --tracker mediapipe"
    if account.skin is not None and account.skin > SKIN_TONED:
        yield "much has the colour of skin: another background or whiter light, or --tracker mediapipe"
