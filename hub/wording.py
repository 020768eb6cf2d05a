"""Times, ages, labels, facets and verdicts as short phrases, the same in every view. Pure."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from common import SECOND_NS
from common.facets import FACETS
from common.fall_messages import FallMessage
from common.message_types import printable
from common.messages import JudgementMessage, VerdictMessage, Vote
from hub.anticipation import EarlyWord
from hub.scene_state import SOMETHING_ELSE, SceneState, is_abstention, is_heard, is_waiting

WAITING = "waiting for observers"


@dataclass(frozen=True, slots=True)
class Leaning:
    """One facet: its likeliest value with its probability, and `lean` from -1 (first pole) to 1 (last pole)."""

    facet: str
    value: str
    p: float
    lean: float

    @property
    def poles(self) -> tuple[str, str]:
        """The names of the two ends."""
        return FACETS[self.facet][0], FACETS[self.facet][-1]


def leanings(facets: Mapping[str, Sequence[float]] | None) -> tuple[Leaning, ...]:
    """The known facets among `facets`, in the order of FACETS; those of another length are left out."""
    pairs = ((facet, (facets or {}).get(facet)) for facet in FACETS)
    return tuple(_leaning(facet, p) for facet, p in pairs if p is not None and len(p) == len(FACETS[facet]))


def _leaning(facet: str, p: Sequence[float]) -> Leaning:
    likeliest = max(range(len(p)), key=lambda place: p[place])
    return Leaning(facet, FACETS[facet][likeliest], p[likeliest], p[-1] - p[0])


def facing(facing_deg: float | None) -> float | None:
    """0 to 360 degrees to the left; None where it is missing."""
    return None if facing_deg is None else facing_deg % 360


def rounded(value: float | None, digits: int) -> float | None:
    """`value` with this many digits; None where it is missing or no number."""
    if value is None or not math.isfinite(value):
        return None
    # Adding 0.0 removes the sign of minus zero.
    return round(value, digits) + 0.0 if digits else round(value)


def facing_words(facing_deg: float) -> str:
    """`front`, `45° left`, `90° right`, `back`."""
    left = (round(facing_deg) + 180) % 360 - 180
    if left in (0, -180):
        return "back" if left else "front"
    return f"{abs(left)}° {'left' if left > 0 else 'right'}"


def calendar_time(at_ns: int) -> datetime | None:
    """The moment in UTC; None for a time outside the calendar."""
    try:
        return datetime.fromtimestamp(at_ns / SECOND_NS, UTC)
    except (ValueError, OverflowError, OSError):
        return None


def moment(at_ns: int) -> str | None:
    """ISO 8601, UTC; None for a time outside the calendar."""
    time = calendar_time(at_ns)
    return None if time is None else time.isoformat(timespec="milliseconds")


def clock_time(at_ns: int) -> str:
    """Local time of day, `14:03:22`; dashes for a time outside the calendar."""
    time = calendar_time(at_ns)
    return "--:--:--" if time is None else f"{time.astimezone():%H:%M:%S}"


def age(seconds: float | None) -> str:
    """`40 ms`, `1.2 s`, `3 min`; `-` where it is unknown."""
    if seconds is None:
        return "-"
    if seconds < 1:
        return f"{seconds * 1000:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def bits(entropy: float | None) -> str:
    """`0.41 bits`; `-` where it is unknown."""
    return "-" if entropy is None else f"{entropy:.2f} bits"


def percent(share: float) -> str:
    """`62%`, four cells wide."""
    return f"{share:4.0%}"


def agreement(judgement: JudgementMessage) -> str:
    """`3 of 4 agree`."""
    return f"{judgement.agreement.k} of {judgement.agreement.n} agree"


def duration(verdict: VerdictMessage) -> str:
    """How long the movement took, `1.8 s`; `now` until it has ended."""
    return "now" if verdict.ended_ns is None else f"{(verdict.ended_ns - verdict.began_ns) / SECOND_NS:.1f} s"


def dissent(verdict: VerdictMessage) -> str:
    """The observers with another label, `cam1: ok`; for an abstention all with a label; empty when all agreed."""
    agreed = None if is_abstention(verdict) else verdict.label
    others = [(name, vote) for name, vote in verdict.votes.items() if is_heard(vote) and vote.label]
    return printable(", ".join(f"{name}: {vote.label}" for name, vote in others if vote.label != agreed))


def contributed(verdict: VerdictMessage) -> str:
    """What each observer contributed in nats, `not without cam1; cam1 +0.61, cam2 -0.20`; empty where unknown."""
    contributions = verdict.contributions or {}
    needed = [name for name, contribution in contributions.items() if not contribution.stands]
    amounts = ", ".join(
        f"{name} {f'{each.nats:+.2f}' if math.isfinite(each.nats) else '-'}" for name, each in contributions.items()
    )
    return printable(f"not without {', '.join(needed)}; {amounts}" if needed else amounts)


def manner(judgement: JudgementMessage) -> str:
    """How the movement is done, `sudden 83%, strong 70%, facing 45° left`; empty where unknown."""
    # A value between the poles ("neither") would not tell a reader which facet it belongs to.
    phrases = [f"{each.value} {each.p:.0%}" for each in leanings(judgement.facets) if each.value in each.poles]
    direction = facing(judgement.facing_deg)
    return ", ".join([*phrases, *([] if direction is None else [f"facing {facing_words(direction)}"])])


def leaning_lines(verdict: VerdictMessage, state: SceneState) -> Iterator[str]:
    """`cam1 leans on right arm 81%, trunk 12%`: of each observer that was heard and knows it, by weight."""
    known = state.vocabulary
    if known is None or known.hash != verdict.vocabulary.hash or verdict.label not in known.labels:
        return
    place = known.labels.index(verdict.label)
    for name, vote in sorted(verdict.votes.items(), key=lambda item: -item[1].weight):
        status = state.observer_status.get(name)
        table = None if status is None else status.leans_on
        if not is_heard(vote) or table is None or table.hash != known.hash or len(table.shares) <= place:
            continue
        pairs = sorted(zip(table.regions, table.shares[place], strict=True), key=lambda pair: -pair[1])
        if regions := ", ".join(f"{region} {share}%" for region, share in pairs if share):
            yield f"{name} leans on {regions}"


def label_words(verdict: VerdictMessage) -> str:
    """The label, `point`; of a revised verdict `wave -> point`; of one of several people `left: point`."""
    labels = [verdict.label] if verdict.revises is None else [verdict.revises, verdict.label]
    return of_person(verdict) + printable(" -> ".join(labels))


def of_person(judgement: JudgementMessage | FallMessage) -> str:
    """`left: ` if the scene judges several people, empty otherwise."""
    return f"{judgement.person}: " if judgement.person else ""


def person_line(judgement: JudgementMessage) -> str:
    """What one of several people does, `left: wave 93%, decided`."""
    if is_waiting(judgement):
        return f"{of_person(judgement)}nobody sees them"
    movement = judgement.movement
    if movement is None:
        return f"{of_person(judgement)}at rest"
    p = max(judgement.p, default=0.0) * (1.0 - (judgement.unlearned or 0.0))
    state = "undecided" if movement.label is None else "decided"
    return f"{of_person(judgement)}{printable(movement.label or judgement.label)} {p:.0%}, {state}"


def verdict_line(verdict: VerdictMessage) -> str:
    """A verdict as one line; a revision begins with `revised`, and an abstention says what a label lacked."""
    kind = "revised" if verdict.stage == "revised" else "verdict"
    phrases = [clock_time(verdict.began_ns), kind, label_words(verdict), agreement(verdict)]
    details = (score_words(verdict), printable(verdict.why or ""), dissent(verdict), contributed(verdict))
    return "  ".join([*phrases, bits(verdict.certainty_bits), *filter(None, details)])


def score_words(verdict: VerdictMessage) -> str:
    """`7.8 of 10; left knee: 12 degrees too straight at 60 %`, or why it is not scored; empty where nobody scores."""
    if verdict.score is None:
        return "" if verdict.unscored is None else printable(f"not scored, {verdict.unscored}")
    return printable("; ".join([f"{verdict.score:.1f} of 10", *(verdict.remarks or ())]))


FALL_WORDS = {
    "unknown": "nobody has been seen up yet",
    "up": "up",
    "low": "somebody lies",
    "fallen": "somebody has fallen",
}


def fall_words(fall: FallMessage) -> str:
    """What a stage means, for people: `somebody has fallen`, `left has fallen`."""
    words = FALL_WORDS[fall.stage]
    if fall.person is None:
        return words
    return words.replace("somebody", fall.person) if "somebody" in words else f"{fall.person}: {words}"


def fall_line(fall: FallMessage) -> str:
    """A stage of the watch for falls as one line: `14:03:22  fall  somebody has fallen  3 of 4 see it  97%`."""
    sight = f"{fall.agreement.k} of {fall.agreement.n} see the person lie" if fall.agreement.n else "nobody sees them"
    sure = "" if fall.lying is None or fall.stage == "up" else percent(fall.lying).strip()
    text = f"{of_person(fall)}up again" if fall.stage == "up" and fall.id else printable(fall_words(fall))
    return "  ".join(filter(None, [clock_time(fall.since_ns), "fall", text, sight if fall.stage != "up" else "", sure]))


def early_line(word: EarlyWord) -> str:
    """An early word, or what became of it, as one line."""
    label, early = printable(word.label), printable(word.early)
    text = {"early": f"{label} {word.p:.0%}", "confirmed": label}.get(word.stage, f"{label}, not {early}")
    return "  ".join([clock_time(word.began_ns), word.stage, text])


def undecided(judgement: JudgementMessage) -> str:
    """Why the movement in progress has no verdict yet: `undecided: wave 59 % of the 60 % needed`; "" if it has one."""
    return f"undecided: {printable(judgement.why)}" if judgement.why else ""


def judgement_line(judgement: JudgementMessage) -> str:
    """A judgement as one line: the fused answer and every observer's vote with its weight."""
    start = (clock_time(judgement.at_ns), "judgement", *filter(None, [of_person(judgement).strip()]))
    votes = printable(", ".join(f"{name}: {_vote(vote)}" for name, vote in judgement.votes.items()))
    if is_waiting(judgement):
        return "  ".join(filter(None, (*start, WAITING, votes)))
    other = judgement.unlearned
    answer = (printable(judgement.label), agreement(judgement), bits(judgement.certainty_bits))
    details = (votes, f"{SOMETHING_ELSE} {other:.0%}" if other else "", manner(judgement), undecided(judgement))
    return "  ".join([*start, *answer, *filter(None, details)])


def _vote(vote: Vote) -> str:
    if not is_heard(vote):
        return vote.state
    if vote.sees_nobody:
        return "sees nobody"
    return f"{vote.label or 'undecided'} {vote.weight:.2f}{' stale' if vote.state == 'stale' else ''}"
