"""The movements that an option names, with sets of movements spelled out."""

from collections.abc import Mapping

from common.text import split_list

MSR_LABELS = (
    *("high_arm_wave", "horizontal_arm_wave", "hammer", "hand_catch", "forward_punch", "high_throw", "draw_x"),
    *("draw_tick", "draw_circle", "hand_clap", "two_hand_wave", "side_boxing", "bend", "forward_kick", "side_kick"),
    *("jogging", "tennis_swing", "tennis_serve", "golf_swing", "pickup_and_throw"),
)
"""Movements 1 to 20 of MSR Action3D."""


def _numbered(*numbers: int) -> tuple[str, ...]:
    return tuple(MSR_LABELS[number - 1] for number in numbers)


SUBSETS: Mapping[str, tuple[str, ...]] = {
    # Li, Zhang and Liu, "Action recognition based on a bag of 3D points", CVPR workshops 2010. Upper case: no label is.
    "AS1": _numbered(2, 3, 5, 6, 10, 13, 18, 20),
    "AS2": _numbered(1, 4, 7, 8, 9, 11, 12, 14),
    "AS3": _numbered(6, 14, 15, 16, 17, 18, 19, 20),
}


def labels_in(text: str, option: str = "--labels") -> tuple[str, ...]:
    """`a,b,AS1` -> the labels, each once, with sets spelled out; raises BadInput for an empty piece."""
    return tuple(dict.fromkeys(label for word in split_list(option, text) for label in SUBSETS.get(word, (word,))))
