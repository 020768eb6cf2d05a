"""How times, ages, labels and verdicts are said in one short plain phrase, for every view alike. Pure."""

import math
from datetime import datetime

from common.messages import JudgementMessage, VerdictMessage
from hub.anticipation import Word, unlearned_of
from hub.leanings import facing, facing_words, leanings
from hub.scene_state import SOMETHING_ELSE, is_abstention


def printable(text: str) -> str:
    """`text` without characters that could steer a terminal: a stranger's words are shown, never obeyed."""
    return "".join(character if character.isprintable() else "?" for character in text)


def clock_time(at_ns: int) -> str:
    """Local time of day, `14:03:22`; dashes for a time that no calendar has."""
    try:
        return datetime.fromtimestamp(at_ns / 1e9).astimezone().strftime("%H:%M:%S")
    except (ValueError, OverflowError, OSError):
        return "--:--:--"


def age(seconds: float | None) -> str:
    """`40 ms`, `1.2 s`, `3 min`, or `-` where nothing was heard."""
    if seconds is None or not math.isfinite(seconds):
        return "-"
    if seconds < 1:
        return f"{seconds * 1000:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def bits(entropy: float | None) -> str:
    """`0.41 bits`, or `-` where there is no belief."""
    return "-" if entropy is None or not math.isfinite(entropy) else f"{entropy:.2f} bits"


def percent(share: float) -> str:
    """`62%`, four cells wide."""
    return f"{share:4.0%}"


def agreement(judgement: JudgementMessage) -> str:
    """`3 of 4 agree`."""
    return f"{judgement.agreement.k} of {judgement.agreement.n} agree"


def duration(verdict: VerdictMessage) -> str:
    """How long the movement took, `1.8 s`; `now` while it goes on."""
    return "now" if verdict.ended_ns is None else f"{(verdict.ended_ns - verdict.began_ns) / 1e9:.1f} s"


def dissent(verdict: VerdictMessage) -> str:
    """The counted judges that held another label, `cam1: ok`; empty when all agreed."""
    if is_abstention(verdict):
        votes = [(name, vote) for name, vote in verdict.votes.items() if vote.label]
    else:
        votes = [(name, vote) for name, vote in verdict.votes.items() if vote.label not in (verdict.label, None)]
    counted = [f"{name}: {vote.label}" for name, vote in votes if vote.state == "counted"]
    return printable(", ".join(counted))


def gave(nats: float) -> str:
    """What a judge gave to a verdict, `+0.61`, in nats."""
    return f"{nats:+.2f}" if math.isfinite(nats) else "-"


def contributed(verdict: VerdictMessage) -> str:
    """What each judge gave, `not without cam1; cam1 +0.61, cam2 -0.20`; empty where the referee does not say it."""
    said = verdict.contributions or {}
    needed = [name for name, each in said.items() if not each.stands]
    given = ", ".join(f"{name} {gave(each.nats)}" for name, each in said.items())
    return printable(f"not without {', '.join(needed)}; {given}" if needed else given)


def manner(judgement: JudgementMessage) -> str:
    """How it is done, `sudden 83%, strong 70%, facing 45° left`; empty where nobody says it."""
    # A value between the poles is no word that a reader could place.
    words = [f"{each.value} {each.p:.0%}" for each in leanings(judgement.facets) if each.value in each.poles]
    direction = facing(judgement.facing_deg)
    return ", ".join([*words, *([] if direction is None else [f"facing {facing_words(direction)}"])])


def verdict_line(verdict: VerdictMessage) -> str:
    """A verdict as one plain line."""
    words = [clock_time(verdict.began_ns), "verdict", printable(verdict.label), agreement(verdict)]
    more = (dissent(verdict), contributed(verdict))
    return "  ".join([*words, bits(verdict.certainty_bits), *filter(None, more)])


def word_line(word: Word) -> str:
    """An early word, or what became of it, as one plain line."""
    label, early = printable(word.label), printable(word.early)
    said = {"early": f"{label} {word.p:.0%}", "confirmed": label}.get(word.stage, f"{label}, not {early}")
    return "  ".join([clock_time(word.began_ns), word.stage, said])


def judgement_line(judgement: JudgementMessage) -> str:
    """A judgement as one plain line: what is believed now, and every judge's opinion with its weight."""
    votes = [_opinion(name, vote.label, vote.weight, vote.state) for name, vote in judgement.votes.items()]
    words = [clock_time(judgement.at_ns), "judgement", printable(judgement.label), agreement(judgement)]
    other = unlearned_of(judgement.unlearned)
    more = (printable(", ".join(votes)), f"{SOMETHING_ELSE} {other:.0%}" if other else "", manner(judgement))
    return "  ".join([*words, bits(judgement.certainty_bits), *filter(None, more)])


def _opinion(name: str, label: str | None, weight: float, state: str) -> str:
    return f"{name}: {label} {weight:.2f}" if state == "counted" else f"{name}: {state}"
