"""Which movements are shown without having been learned, and which are learned as something else. Seeded, pure."""

from collections.abc import Sequence

import numpy as np

from common.errors import BadInput
from common.text import split_list
from observer.background import BLENDS

OTHERS = "others"
Labels = tuple[str, ...]


def strangers(
    unlearned: str, background: str, learned: Labels, known: Labels, seed: int = 0
) -> tuple[Labels, Labels | None]:
    """The texts of --unlearned and --background-labels -> the movements of each; known: all of the archive.

    `others` are all that are neither learned nor background. A number of background is drawn from the unlearned, which
    are then not shown. Raises BadInput for a movement that would be two of learned, background and unlearned.
    """
    chosen = _background(background)
    shown = tuple(m for m in known if m not in learned) if unlearned == OTHERS else split_list("--unlearned", unlearned)
    _require_apart("--unlearned", shown, learned)
    if isinstance(chosen, int):
        chosen = _drawn(chosen, shown, seed)
        return tuple(m for m in shown if m not in chosen), chosen
    if chosen is None:
        return shown, None
    _require_apart("--background-labels", chosen, learned)
    if unlearned == OTHERS:
        return tuple(m for m in shown if m not in chosen), chosen
    for label in shown:
        if label in chosen:
            raise BadInput(f"--background-labels: {label!r} is among --unlearned, which must not be known; name others")
    return shown, chosen


def _background(text: str) -> Labels | int | None:
    if not text:
        return None
    if text == BLENDS:
        return ()
    return int(text) if text.isdecimal() else split_list("--background-labels", text)


def _drawn(count: int, shown: Sequence[str], seed: int) -> Labels:
    if not 0 < count < len(shown):
        raise BadInput(
            f"--background-labels {count}: of {len(shown)} movements of --unlearned; "
            f"one at least must be drawn and one left, e.g. --unlearned others"
        )
    chosen = np.random.default_rng([seed, 3]).permutation(len(shown))[:count]
    return tuple(shown[n] for n in sorted(chosen.tolist()))


def _require_apart(option: str, named: Sequence[str], learned: Sequence[str]) -> None:
    for label in named:
        if label in learned:
            raise BadInput(f"{option}: {label!r} is among the movements that are learned; name others in --labels")
