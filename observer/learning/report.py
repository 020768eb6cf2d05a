"""What a person is told of a model that was just learned or edited. Pure."""

from collections import Counter
from collections.abc import Sequence

from observer.model.base import Header
from observer.model.posterior_calibration import FEW, Tried
from observer.motion.archive import MotionArchive
from observer.motion.transforms import movements_in

ENOUGH = 3
"""Recordings of a movement below which a person is warned."""


def believed(header: Header) -> str:
    """How far the model can be believed, from what its provenance and its certainty say."""
    tried, right = int(header.provenance.get("tried", "0")), int(header.provenance.get("right", "0"))
    found = f"right {100 * right / tried:.0f} %" if tried else "so nothing is known of how good it is"
    return f"tried on {tried or 'no'} left-out examples: {found}, {_certainty(header)}"


def believed_of_new(tried: Sequence[Tried], labels: Sequence[str], header: Header) -> str:
    """The same for movements that a model got later; its certainty is still that of the old ones."""
    right = sum(int(t.beliefs[-1].argmax()) == t.truth for t in tried)
    found = f": right {100 * right / len(tried):.0f} %" if tried else ""
    return f"tried on {len(tried) or 'no'} left-out examples of {', '.join(labels)}{found}; {_certainty(header)}"


def knows_else(header: Header) -> str:
    """By what the model knows that something is none of its movements."""
    shown = f" and by {', '.join(header.background)}" if header.background else ""
    return f"something else is known by blends of the movements{shown}"


def edited(header: Header) -> str:
    """What has to be done with the other observers of the scene, who would not be understood any more."""
    words = header.vocabulary
    return (
        f"{words.size} movements now: edit the models of all the scene's observers alike, "
        f"for judges of another vocabulary (this is {words.digest}) are not heard"
    )


def too_few(archive: MotionArchive, labels: Sequence[str]) -> list[str]:
    """A warning for each of these movements with fewer than three recordings."""
    counts = Counter(recording.label for recording in movements_in(archive))
    return [
        f"warning: {label}: {counts[label]} recording{'s' * (counts[label] > 1)}; record it at least {ENOUGH} times"
        for label in labels
        if counts[label] < ENOUGH
    ]


def _certainty(header: Header) -> str:
    found = header.certainty
    cautious = found.temperature >= FEW.temperature and found.doubt >= FEW.doubt and not found.foreseen
    # Of a model that knows something else nothing is foreseen, however well it was tried.
    cautious = cautious and header.background is None
    why = ", cautiously: other people may do it otherwise" if cautious else ""
    return f"temperature {found.temperature:.1f}, doubt {found.doubt:.2g}{why}"
