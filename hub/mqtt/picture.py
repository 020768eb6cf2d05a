"""What stands at the broker now: a scene's state as retained messages. Pure.

Numbers are rounded to what a person would tell apart, so that a sensor changes when something has changed.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from common.messages import JudgementMessage, Vote
from hub.anticipation import surest, unlearned_of
from hub.mqtt.names import Names
from hub.scene_state import Judge, SceneState

REST: Final = "rest"
UNDECIDED: Final = "undecided"
ONLINE: Final = "online"
OFFLINE: Final = "offline"
FAST_S = 0.25
SLOW_S = 1.0
AGAIN_S = 10.0
"""A movement's binary sensor is said again this often: it expires at Home Assistant when nobody says it."""
HEARD_S = 1.4
"""Who has neither delivered a picture nor said how it is for so long is not there; a status comes each second."""
SILENT_S = 1.5
"""A scene is not judged any more when no judgement came for so long, and the time of a step on top."""


@dataclass(frozen=True, slots=True)
class Saying:
    """What a topic shall say: at once when `urgent` differs from what was said, else at most each `pace_s` seconds.

    again_s: it is said again after so long though nothing changed; 0: it is not.
    """

    payload: str
    urgent: object = None
    pace_s: float = 0.0
    again_s: float = 0.0


@dataclass(frozen=True, slots=True)
class View:
    """A scene as it is now: what was heard, who has a liveliness token, and how old each observer's status is (s)."""

    state: SceneState
    tokens: frozenset[str] = frozenset()
    status_age_s: Mapping[str, float] | None = None
    step_s: float = 0.1

    @property
    def judged(self) -> bool:
        """Whether a referee judges the scene."""
        return self.state.silence_s <= SILENT_S + self.step_s

    def present(self, judge: Judge) -> bool:
        """Whether an observer is there: its frames come, or its process runs and says how it is."""
        if judge.status is not None and judge.status.state in ("failed", "stopping"):
            return False
        counts = judge.state in ("counted", "stale")
        if counts and judge.age_s is not None and judge.age_s <= HEARD_S:
            return True
        if judge.name not in self.tokens:
            return False
        # A judge of somebody's own may never say how it is: then the referee's word has to do.
        age_s = (self.status_age_s or {}).get(judge.name)
        return judge.state != "silent" if age_s is None else age_s <= HEARD_S


def picture(names: Names, view: View, observers: Sequence[str], movements: Sequence[str]) -> dict[str, Saying]:
    """All states of the scene by topic, availability first."""
    said = dict(_scene(names, view, movements))
    for judge in view.state.judges:
        if judge.name in observers:
            said |= dict(_observer(names, view, judge))
    return said


def _scene(names: Names, view: View, movements: Sequence[str]) -> Iterator[tuple[str, Saying]]:
    yield names.availability, Saying(ONLINE if view.judged else OFFLINE)
    judgement = view.state.judgement
    decided = judgement.movement.label if judgement and judgement.movement else None
    for label in movements:
        on = view.judged and label == decided
        yield names.movement(label), Saying("ON" if on else "OFF", again_s=AGAIN_S)
    if judgement is not None:
        now = _going_on(judgement)
        yield names.state, Saying(_json(now), now["movement"], FAST_S)
        yield names.votes, Saying(_json(votes(judgement)), now["movement"], SLOW_S)


def _going_on(judgement: JudgementMessage) -> dict[str, Any]:
    movement = judgement.movement
    name = REST if movement is None else movement.label or UNDECIDED
    return {
        "movement": name,
        "label": judgement.label,
        "confidence": confidence(judgement),
        "entropy": rounded(judgement.certainty_bits, 2),
        "unlearned": unlearned(judgement),
    }


def confidence(judgement: JudgementMessage) -> int:
    """How probable the most probable movement is among all answers, in percent."""
    return round(100 * surest(judgement))


def unlearned(judgement: JudgementMessage) -> int | None:
    """How probable it is that it is none of the movements, in percent; None where nobody says it."""
    return None if judgement.unlearned is None else round(100 * unlearned_of(judgement.unlearned))


def votes(judgement: JudgementMessage) -> dict[str, Any]:
    """By which rule, how many agree, and each observer's opinion, weight in percent, entropy in bits, and state."""
    agreement = f"{judgement.agreement.k} of {judgement.agreement.n}"
    return {"rule": judgement.rule, "agreement": agreement, "votes": {n: _vote(v) for n, v in judgement.votes.items()}}


def _vote(vote: Vote) -> dict[str, Any]:
    weight = rounded(100 * vote.weight, 0)
    return {"label": vote.label, "weight": weight, "entropy": rounded(vote.entropy, 1), "state": vote.state}


def _observer(names: Names, view: View, judge: Judge) -> Iterator[tuple[str, Saying]]:
    present, status = view.present(judge), judge.status
    yield names.observer(judge.name, "availability"), Saying(ONLINE if present else OFFLINE)
    yield names.observer(judge.name, "connected"), Saying("ON" if present else "OFF")
    # What the referee says of it counts while the referee is heard.
    heard = judge if view.judged else None
    health = {
        "state": status.state if status else None,
        "reason": status.reason if status else "",
        "vote": heard.state if heard else None,
        "opinion": heard.label if heard else None,
    }
    yield names.observer(judge.name, "health"), Saying(_json(health), health["state"], FAST_S)
    numbers = {
        "entropy": rounded(heard.entropy, 2) if heard else None,
        "weight": rounded(100 * heard.weight, 0) if heard else None,
        "reliability": rounded(heard.reliability, 2) if heard else None,
        "age": rounded(heard.age_s, 1) if heard else None,
        "rate": rounded(status.rate_hz, 0) if status else None,
        "skew": rounded(heard.skew_s, 2) if heard else None,
        "rejected": judge.rejected,
    }
    yield names.observer(judge.name, "state"), Saying(_json(numbers), None, SLOW_S)


def rounded(value: float | None, digits: int) -> float | None:
    """`value` with so many digits, None where there is none or it is no number."""
    if value is None or not math.isfinite(value):
        return None
    # Adding 0.0 takes the sign from minus zero.
    return round(value, digits) + 0.0 if digits else round(value)


def _json(said: Mapping[str, Any]) -> str:
    return json.dumps(said, allow_nan=False)
