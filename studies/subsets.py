"""Names for sets of movements that the literature judges together; upper case, so that no label can be one."""

from collections.abc import Mapping

from common.text import split_list
from observer.motion.importers.msr_action3d import LABELS


def _numbered(*numbers: int) -> tuple[str, ...]:
    return tuple(LABELS[number - 1] for number in numbers)


SUBSETS: Mapping[str, tuple[str, ...]] = {
    # Li, Zhang and Liu, "Action recognition based on a bag of 3D points", CVPR workshops 2010.
    "AS1": _numbered(2, 3, 5, 6, 10, 13, 18, 20),
    "AS2": _numbered(1, 4, 7, 8, 9, 11, 12, 14),
    "AS3": _numbered(6, 14, 15, 16, 17, 18, 19, 20),
}


def labels_in(text: str) -> tuple[str, ...]:
    """`a,b,AS1` -> the labels, subsets spelled out; raises BadInput for an empty piece."""
    return tuple(dict.fromkeys(label for word in split_list("--labels", text) for label in SUBSETS.get(word, (word,))))
