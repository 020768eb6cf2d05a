"""Signs that tracks are wrong: a head off the face, parts that jump, hands in one place or out of reach. Pure.

Lengths are in body heights, so that the limits hold for every camera and person. The height comes from the head and
the pelvis or, for a tracker without a pelvis, from the width of the face.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from observer.tracks import Floats

Box = tuple[float, float, float, float]
"""Left, top, width, height, px."""

HEAD, HANDS = "head", ("left_hand", "right_hand")
HEAD_TO_PELVIS = 0.40
"""Distance of ears and pelvis in heights: Winter, Biomechanics and Motor Control of Human Movement, 2009, fig. 4.1."""
FACE_WIDTH = 1 / 9
"""Width of the cascade's box in heights, on people who stand upright (wave_webcam)."""
SAME_SIZE = 1.6
"""Boxes of one face differ by less than this factor."""
SPEED = {HEAD: 3.0, **dict.fromkeys(HANDS, 6.0)}
"""Heights per second that a part does not exceed: 10 m/s for a hand is a fast throw."""
TOGETHER, REACH = 0.04, 0.75
"""Heights: less between two palms is one place; more between head and hand is out of reach (a hanging hand: .55)."""
EXCHANGED_NEAR, EXCHANGED_FAR = 0.05, 0.12
"""A hand that is this near to the other one's last place, and this far from its own, has taken its place."""
FACES = 4
"""With a face in so many pictures the person faces the camera: then the left hand is right of the other one."""
FEWEST_DOUBTFUL = {"off": 4, "jumps": 2, "beyond": 2, "exchanged": 2, "together": 4, "sides": 4}
OF_SEEN = {"off": 0.3, "jumps": 0.05, "beyond": 0.05, "exchanged": 0.05, "together": 0.6, "sides": 0.6}
"""At least so many pictures, and such a share of those in which it could be seen, make a doubt."""
RARELY = 0.5
"""A hand or head seen in fewer of the pictures than this is rarely seen."""
FINDINGS = {
    "off": "the head is off the face in {share} of the pictures with a face",
    "sides": "the left hand is on the right hand's side in {share} of the pictures",
    "jumps": "the {part} jumps faster than anybody moves in {share} of the pictures",
    "exchanged": "the hands change places in {share} of the pictures",
    "together": "both hands are in one place in {share} of the pictures",
    "beyond": "the {part} is further from the head than an arm reaches in {share} of the pictures",
    "rarely": "the {part} is seen in only {share} of the pictures",
}
"""What is wrong, most urgent first."""
ANOTHER_PERSON = "if somebody else is in the picture, let only one person be there"
CAMSHIFT_REMEDIES = {
    "off": "mark the face (--face X,Y,WIDTH,HEIGHT), or --tracker mediapipe",
    "sides": "say from where the camera looks (--view), or --tracker mediapipe",
    "jumps": "wear long sleeves, avoid a background in the colour of skin, or --tracker mediapipe",
    "exchanged": "--tracker mediapipe",
    "together": "--tracker mediapipe",
    "beyond": "something else has the colour of skin: change the background, or --tracker mediapipe",
    "rarely": "face the camera, in even light and with long sleeves, or --tracker mediapipe",
}
POSE_REMEDIES = {
    "off": ANOTHER_PERSON,
    "sides": "come nearer, or put the camera where both arms are seen",
    "jumps": "come nearer, add light; a film may also state a wrong rate",
    "exchanged": "come nearer, add light, or put the camera where both arms are seen",
    "together": "one of them is a guess: put the camera where both arms are seen",
    "beyond": ANOTHER_PERSON,
    "rarely": "it is hidden or outside the picture: move the camera, or add another one",
}


@dataclass(frozen=True, slots=True)
class Doubt:
    """kind: a key of FINDINGS. part: which one; "" for both hands. count: of the `pictures` that could show it."""

    kind: str
    part: str
    count: int
    pictures: int

    @property
    def share(self) -> float:
        """The share of those pictures that show it, 0 to 1."""
        return self.count / self.pictures if self.pictures else 0.0


def explain(doubt: Doubt, tracker: str) -> str:
    """What is wrong and what to do, in one line."""
    finding = FINDINGS[doubt.kind].format(part=doubt.part.replace("_", " "), share=f"{100 * doubt.share:.0f} %")
    return f"{finding}: {(CAMSHIFT_REMEDIES if tracker == 'camshift' else POSE_REMEDIES)[doubt.kind]}"


def confirmed_faces(boxes: Mapping[int, Sequence[Box]]) -> dict[int, list[Box]]:
    """The boxes that the search before had found near the same place: a false one is seldom found twice.

    boxes: by the number of the picture, in its order, for each picture that was searched.
    """
    searched = list(boxes.items())
    confirmed = {}
    for (_, before), (number, now) in pairwise(searched):
        if twice := [box for box in now if any(_is_same(box, other) for other in before)]:
            confirmed[number] = twice
    return confirmed


def doubts(
    centres: Floats, parts: Sequence[str], at_ns: Sequence[int], boxes: Mapping[int, Sequence[Box]]
) -> list[Doubt]:
    """What is wrong with the tracks (T, P, 2) px, NaN where not seen; at_ns: T times; boxes: as `confirmed_faces`."""
    rows = {part: centres[:, index] for index, part in enumerate(parts)}
    faces = confirmed_faces(boxes)
    doubts = [_head_off(rows[HEAD], faces)] if HEAD in rows else []
    height_px = body_height_px(rows, faces)
    if height_px is not None:
        doubts += _jumps(rows, np.asarray(at_ns), height_px)
        doubts += _hands(rows, height_px)
    if len(faces) >= FACES and all(hand in rows for hand in HANDS):
        doubts.append(_sides(*(rows[hand] for hand in HANDS)))
    doubts = [each for each in doubts if each.count >= FEWEST_DOUBTFUL[each.kind] and each.share >= OF_SEEN[each.kind]]
    order = list(FINDINGS)
    return sorted([*doubts, *_rarely_seen(rows)], key=lambda doubt: order.index(doubt.kind))


def body_height_px(rows: Mapping[str, Floats], faces: Mapping[int, Sequence[Box]]) -> float | None:
    """The person's height by the head and the pelvis, else by the face; None if neither is seen."""
    if HEAD in rows and "pelvis" in rows:
        lengths = _distances(rows[HEAD], rows["pelvis"])
        if len(lengths):
            return float(np.median(lengths)) / HEAD_TO_PELVIS
    widths = [box[2] for boxes in faces.values() for box in boxes]
    return float(np.median(widths)) / FACE_WIDTH if widths else None


def _is_same(box: Box, other: Box) -> bool:
    (u, v), (other_u, other_v) = _middle(box), _middle(other)
    size = max(box[2], other[2])
    return abs(u - other_u) < size and abs(v - other_v) < size and size < SAME_SIZE * min(box[2], other[2])


def _middle(box: Box) -> tuple[float, float]:
    return box[0] + box[2] / 2, box[1] + box[3] / 2


def _head_off(head: Floats, faces: Mapping[int, Sequence[Box]]) -> Doubt:
    """In how many pictures with a face the head is seen further from every face than that is wide."""
    visible = [number for number in faces if number < len(head) and np.isfinite(head[number]).all()]
    off = 0
    for number in visible:
        off += all(np.abs(head[number] - _middle(box)).max() > box[2] for box in faces[number])
    return Doubt("off", HEAD, off, len(visible))


def _jumps(rows: Mapping[str, Floats], at_ns: NDArray[np.int64], height_px: float) -> Iterator[Doubt]:
    seconds = np.maximum(np.diff(at_ns) / SECOND_NS, 1e-3)
    for part, limit in SPEED.items():
        if part in rows:
            speeds = np.linalg.norm(np.diff(rows[part], axis=0), axis=1) / height_px / seconds
            known = speeds[np.isfinite(speeds)]
            yield Doubt("jumps", part, int((known > limit).sum()), len(known))


def _hands(rows: Mapping[str, Floats], height_px: float) -> Iterator[Doubt]:
    for hand in HANDS:
        if hand in rows and HEAD in rows:
            reach = _distances(rows[hand], rows[HEAD]) / height_px
            yield Doubt("beyond", hand, int((reach > REACH).sum()), len(reach))
    if all(hand in rows for hand in HANDS):
        left, right = (rows[hand] for hand in HANDS)
        apart = _distances(left, right) / height_px
        yield Doubt("together", "", int((apart < TOGETHER).sum()), len(apart))
        yield Doubt("exchanged", "", _exchanges(left, right, height_px), max(len(left) - 1, 0))


def _sides(left: Floats, right: Floats) -> Doubt:
    """In how many pictures with both hands the left one is left of the other; for a person who faces the camera."""
    apart = (left - right)[:, 0]
    known = apart[np.isfinite(apart)]
    return Doubt("sides", "", int((known < 0).sum()), len(known))


def _rarely_seen(rows: Mapping[str, Floats]) -> Iterator[Doubt]:
    for part in (HEAD, *HANDS):
        count = int(np.isfinite(rows[part]).all(axis=1).sum()) if part in rows else 0
        if 0 < count < RARELY * len(rows[part]):
            yield Doubt("rarely", part, count, len(rows[part]))


def _exchanges(left: Floats, right: Floats, height_px: float) -> int:
    """In how many pictures a hand is where the other one was, away from its own last place."""
    last: dict[str, Floats] = {}
    count = 0
    for here in zip(left, right, strict=True):
        now = {hand: place for hand, place in zip(HANDS, here, strict=True) if np.isfinite(place).all()}
        for hand, other in (HANDS, HANDS[::-1]):
            if hand in now and hand in last and other in last:
                near = np.linalg.norm(now[hand] - last[other]) / height_px
                far = np.linalg.norm(now[hand] - last[hand]) / height_px
                count += bool(near < EXCHANGED_NEAR and far > EXCHANGED_FAR)
        last |= now
    return count


def _distances(one: Floats, other: Floats) -> Floats:
    """(n,) px between two parts in the pictures in which both are seen."""
    lengths: Floats = np.linalg.norm(one - other, axis=1)
    return lengths[np.isfinite(lengths)]
