"""Whether messages fit a scene: into the largest size, and into its vocabulary. Pure."""

from typing import TYPE_CHECKING

from common.errors import BadInput
from common.message_types import LAST_INTEGER
from common.messages import (
    Agreement,
    JudgementMessage,
    OngoingMovement,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.text import plural
from common.vocabulary import ABSTAIN, Vocabulary
from common.wire import SIZE_LIMIT, BadMessage, size_of

if TYPE_CHECKING:
    from common.config import Scene


def check_vocabulary(message: JudgementMessage, vocabulary: Vocabulary) -> None:
    """Raises BadMessage unless a judgement or verdict is entirely in `vocabulary`: its hash, lengths and labels."""
    if message.vocabulary.hash != vocabulary.digest:
        raise BadMessage("foreign_vocabulary", f"hash {message.vocabulary.hash}, this scene's is {vocabulary.digest}")
    for p in (message.p, *(vote.p for vote in message.votes.values())):
        if p is not None and len(p) != vocabulary.size:
            raise BadMessage("wrong_length", f"{len(p)} probabilities for {vocabulary.size} movements")
    labels = {message.label, *(vote.label for vote in message.votes.values())}
    if message.movement is not None:
        labels |= {message.movement.label, message.movement.revises}
    if isinstance(message, VerdictMessage):
        labels.add(message.revises)
    # While no vote counts, a judgement has an empty label.
    unknown = labels - {*vocabulary.labels, ABSTAIN, "", None}
    if unknown:
        raise BadMessage("malformed", f"label {min(map(str, unknown))!r} is not in the vocabulary")


def largest_judgement(scene: str, observers: tuple[str, ...], vocabulary: Vocabulary, rule: str) -> int:
    """Upper bound in bytes of a judgement or verdict without OPTIONAL_DETAIL, for these observers and movements."""
    label = max(vocabulary.labels, key=len)
    vote = Vote(
        label=label, entropy=1.0, weight=1.0, age_s=1.0, state="counted", rest=1.0, skew_s=1.0, unlearned=1.0,
        reliability=1.0,
    )  # fmt: skip
    longest_id, movement_id, last = "x" * 64, "m" * 128, LAST_INTEGER
    movement = OngoingMovement(
        id=movement_id, began_ns=last, label=label, decided_ns=last, revises=label, outage_ns=last
    )  # fmt: skip
    verdict = VerdictMessage(
        scene=scene, fusion=longest_id, seq=last, at_ns=last, p=[1.0] * vocabulary.size, label=label,
        vocabulary=VocabularyReference(name=vocabulary.name, hash=vocabulary.digest), certainty_bits=1.0, rule=rule,
        votes=dict.fromkeys(observers, vote), agreement=Agreement(k=last, n=last), unlearned=1.0, facing_deg=1.0,
        movement=movement, epoch=last, session=longest_id, id=movement_id, began_ns=last, decided_ns=last,
        ended_ns=last, revises=label,
    )  # fmt: skip
    return size_of(verdict)


def require_fits(scene: "Scene", vocabulary: Vocabulary | None = None) -> None:
    """Raises BadInput, one line, if messages of `scene` cannot fit into SIZE_LIMIT even without optional detail.

    vocabulary: the scene's own if None; a scene that names none is checked for its observers alone.
    """
    known = vocabulary or scene.named_vocabulary
    checked = known or Vocabulary(("a", "b"))
    size = largest_judgement(scene.scene, scene.roster, checked, scene.fusion.rule)
    if size > SIZE_LIMIT:
        parts = [plural(len(scene.roster), "observer"), *([plural(checked.size, "movement")] if known else [])]
        raise BadInput(
            f"scene {scene.scene!r}: {' and '.join(parts)} make judgements of up to {size} bytes, a message holds "
            f"{SIZE_LIMIT}; use fewer of them or shorter names, or several scenes"
        )
    # Without the durations of movements, which are optional detail.
    names = Vocabulary(checked.labels, checked.name)
    size = size_of(VocabularyMessage.of(scene.scene, names))
    if size > SIZE_LIMIT:
        raise BadInput(
            f"scene {scene.scene!r}: the labels of {plural(checked.size, 'movement')} take {size} bytes, a message "
            f"holds {SIZE_LIMIT}; use fewer movements or shorter labels"
        )
