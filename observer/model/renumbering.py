"""New indices of movements when a model forgets some. A negative index is a movement of the background. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from observer.model.base import Header


def indices_of_remaining(header: Header, remaining: Sequence[int]) -> Mapping[int, int]:
    """Old to new index when only these movements of the vocabulary remain, in their order, and all the background."""
    background = {-1 - b: -1 - b for b in range(len(header.background or ()))}
    return {m: n for n, m in enumerate(remaining)} | background


def without_background_movement(header: Header, gone: int) -> tuple[Header, Mapping[int, int]]:
    """The header without one movement of the background, given by its place in it, and old to new indices."""
    labels = header.background or ()
    left = [b for b in range(len(labels)) if b != gone]
    movements = {m: m for m in range(header.vocabulary.size)}
    header = replace(header, background=tuple(labels[b] for b in left))
    return header, movements | {-1 - b: -1 - n for n, b in enumerate(left)}
