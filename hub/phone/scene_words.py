"""What the phone's page shows of its scene: what its observer believes, what the referee decided. Pure."""

from collections.abc import Mapping

from common import MS_NS
from hub.scene_state import SceneState, is_abstention
from hub.wording import label_words


def scene_words(state: SceneState, observer: str) -> Mapping[str, object]:
    """The scene as the page of the phone `observer` shows it: an object for JSON, with these keys.

    own, judged: the likeliest movement and its probability, by this observer and by the referee; None without one.
    moves: whether a movement is in progress; why: what it lacks for a verdict. verdict: the newest one, None before.
    known: the movements that are recognised. observer: the state of its process, `silent` without one.
    """
    own = next((each for each in state.observers if each.name == observer), None)
    fused = None if state.silent or not state.fused else state.fused[0]
    verdict, ranked = state.verdict, own.ranked if own is not None and own.is_heard else ()
    return {
        "own": {"label": ranked[0].label, "p": round(ranked[0].p, 2)} if ranked else None,
        "judged": None if fused is None else {"label": fused.label, "p": round(fused.p, 2)},
        "moves": bool(state.judgement and state.judgement.movement),
        "why": (state.judgement.why if state.judgement else None) or "",
        "known": list(state.labels),
        "observer": own.status.state if own is not None and own.status is not None else "silent",
        "verdict": None
        if verdict is None
        else {
            "id": verdict.id,
            "label": "undecided" if is_abstention(verdict) else label_words(verdict),
            "k": verdict.agreement.k,
            "n": verdict.agreement.n,
            "began_ms": verdict.began_ns // MS_NS,
            "ended": verdict.ended_ns is not None,
        },
    }
