"""A storm: processes of one scene are killed, or frozen, every one to three seconds; and what became of the verdicts. A
killed process is started again within a second, as systemd would. What was performed is known to the frame."""

import threading
import time
from dataclasses import dataclass, field

from fault_hearing import is_unheard
from fault_stage import SECOND_NS, SERVICES, SETTLE_S, VIEWS

from common.vocabulary import ABSTAIN

KINDS = {
    "observers": tuple(VIEWS),
    "hub": ("hub",),
    "one fusion": SERVICES[:1],
    "both fusions": SERVICES,
    "router": ("router",),
    "all": (*VIEWS, *SERVICES, "router", "hub"),
}
PAUSE_S, AWAY_S, FROZEN_S = (1.0, 3.0), (0.0, 1.0), (0.2, 1.5)
LINK_PAUSE_S, AWAY_LINK_S = (0.5, 1.5), (0.2, 3.0)
LISTENERS = ("watch", "page", "mqtt")
"""Their lines fail, but they live: what a listener was told is known until it ends."""
FREEZES = 0.25
"""The share of faults that freeze a process in place of killing it."""
QUORUM = 2
"""Votes that a label needs; three observers have this quorum."""


def storm(stage, kind, seconds, chance, history):
    """Faults at the processes of a kind for so long; with "both fusions" both at once."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        names = KINDS[kind]
        victims = names if kind == "both fusions" else (chance.choice(names),)
        if kind == "all" and victims[0] in SERVICES and chance.random() < 0.5:
            victims = SERVICES
        _strike(stage, victims, chance, history)
        _pass(chance.uniform(*PAUSE_S))


def storm_of_links(stage, seconds, chance, history):
    """Kills, freezes, cut lines and black holes of any process, a fault each LINK_PAUSE_S, for so long."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        name = chance.choice((*stage.lines, "router"))
        victims = SERVICES if name in SERVICES and chance.random() < 0.5 else (name,)
        of_process, of_line = ((_kill, _freeze), (_cut, _swallow))
        ways = of_line if name in LISTENERS else of_process if name == "router" else (*of_process, *of_line)
        chance.choice(ways)(stage, victims, chance, history)
        _pass(chance.uniform(*LINK_PAUSE_S))


def _cut(stage, victims, chance, history):
    history.note("cut", victims=victims)
    for name in victims:
        stage.lines[name].cut()
    _heal(stage, victims, chance, history)


def _swallow(stage, victims, chance, history):
    history.note("swallow", victims=victims)
    for name in victims:
        stage.lines[name].swallow()
    _heal(stage, victims, chance, history)


def _heal(stage, victims, chance, history):
    _pass(chance.uniform(*AWAY_LINK_S))
    for name in victims:
        stage.lines[name].heal()
    history.note("heal", victims=victims)


def _strike(stage, victims, chance, history):
    (_freeze if chance.random() < FREEZES else _kill)(stage, victims, chance, history)


def _freeze(stage, victims, chance, history):
    history.note("freeze", victims=victims)
    for name in victims:
        stage.processes[name].freeze()
    _pass(chance.uniform(*FROZEN_S))
    for name in victims:
        stage.processes[name].thaw()
    history.note("thaw", victims=victims)


def _kill(stage, victims, chance, history):
    history.note("kill", victims=victims)
    for name in victims:
        stage.processes[name].kill()
    _pass(chance.uniform(*AWAY_S))
    for name in victims:
        stage.start(name)
    history.note("start", victims=victims)


FAULTS = ("lost", "unheard", "wrong", "doubled", "unended")


@dataclass
class Aftermath:
    """What became of the movements: their numbers, and the ids of verdicts without an end. few: those among the lost of
    which too much was heard by fewer observers than the quorum."""

    movements: int
    right: int = 0
    lost: list = field(default_factory=list)
    unheard: list = field(default_factory=list)
    wrong: list = field(default_factory=list)
    doubled: list = field(default_factory=list)
    unended: list = field(default_factory=list)
    few: list = field(default_factory=list)

    @property
    def harmless(self):
        """Whether only what nobody could hear was lost."""
        return not (self.lost or self.wrong or self.doubled or self.unended)

    def __add__(self, other):
        lists = {kind: [*getattr(self, kind), *getattr(other, kind)] for kind in (*FAULTS, "few")}
        return Aftermath(self.movements + other.movements, self.right + other.right, **lists)

    def __str__(self):
        parts = [f"{len(getattr(self, kind))} {kind}" for kind in FAULTS]
        few = f"; {len(self.few)} of the lost were heard by fewer observers than the quorum" if self.few else ""
        return f"{self.movements} movements: {self.right} right, {', '.join(parts)}{few}"


def aftermath(performed, judgements, verdicts):
    """Compares the verdicts that a witness received with what was performed."""
    words = _words(verdicts, judgements)
    result = Aftermath(len(performed))
    ids = [[] for _ in performed]
    for name, word in words.items():
        shares = [min(word["end"], one.ended_ns) - max(word["began"], one.began_ns) for one in performed]
        best = max(range(len(shares)), key=shares.__getitem__)
        if shares[best] > 0:
            ids[best].append(name)
    # A verdict on the last movements may still be due.
    result.unended = [name for name, word in words.items() if not word["ended"] and word["end"] < _last(performed)]
    for number, (movement, names) in enumerate(zip(performed, ids, strict=True)):
        labels = {words[name]["label"] for name in names} - {ABSTAIN}
        repeated = any(len(words[name]["stages"]) != len(set(words[name]["stages"])) for name in names)
        if len([name for name in names if words[name]["label"] != ABSTAIN]) > 1 or repeated:
            result.doubled.append((number, names))
        if labels - {movement.label}:
            result.wrong.append((number, movement.label, sorted(labels)))
        elif labels:
            result.right += 1
        else:
            unheard = is_unheard(movement, judgements)
            (result.unheard if unheard else result.lost).append((number, movement.label))
            if not unheard and is_unheard(movement, judgements, QUORUM):
                result.few.append(number)
    return result


def _last(performed):
    return max((one.ended_ns for one in performed), default=0)


def _words(verdicts, judgements):
    """By id the last label, span and stages, as a listener has them that follows wire.md, "One movement, one name"."""
    words, joined = {}, {}
    for verdict in verdicts:
        own, said = verdict["id"], (verdict["stage"], verdict["label"])
        is_new = own not in words and own not in joined and verdict.get("same_as") is None
        known = [name for name, word in words.items() if is_new and _is_same(word, verdict, judgements)]
        for name in known:
            joined[own] = name
        name = joined.get(own, own)
        if verdict.get("same_as") is not None:
            if own not in words or words[own]["ended"]:
                continue
            if verdict["same_as"] and verdict["same_as"] not in words:
                joined[verdict["same_as"]] = own
        elif name != own and (
            verdict["ended_ns"] is None or words[name]["ended"] or verdict["label"] != words[name]["label"]
        ):
            continue
        word = words.setdefault(name, {"stages": [], "ended": False, "began": verdict["began_ns"], "first": verdict})
        word["label"], word["end"] = verdict["label"], verdict["ended_ns"] or verdict["decided_ns"]
        if word["stages"][-1:] != [said]:
            # The second of two equal words is ignored by hubs too.
            word["stages"].append(said)
        word["ended"] = word["ended"] or verdict["ended_ns"] is not None
    return words


def _is_same(word, verdict, judgements):
    """Rule 1: two services, one label and person, and half of the shorter time in common. Hubs have applied it."""
    first = word["first"]
    if "fusion" not in verdict or word["label"] != verdict["label"] or first.get("person") != verdict.get("person"):
        return False
    if all(first[name] == verdict[name] for name in ("fusion", "session")):
        return False
    shown = [
        one["at_ns"]
        for one in judgements
        if one["arrived_ns"] < verdict["arrived_ns"] and (one["movement"] or {}).get("id") == first["id"]
    ]
    spans = [
        (word["began"], word["end"] if word["ended"] else max([first["at_ns"], *shown])),
        (verdict["began_ns"], verdict["ended_ns"] or verdict["at_ns"]),
    ]
    shared = min(end for _, end in spans) - max(began for began, _ in spans)
    return shared >= 0 and 2 * shared >= min(end - began for began, end in spans)


def settle(stage, witness):
    """Until the movements that had ended are judged, in every scene; the movements that were performed until now."""
    until_ns = time.time_ns()
    due_ns = until_ns + 2 * SETTLE_S * SECOND_NS
    witness.wait_for(lambda w: all(at_ns > due_ns for at_ns in _judged_until(w)), why="judgements go on")
    return stage.replay.performed(stage.start_ns, stage.start_ns, until_ns)


def _judged_until(witness):
    """Of each scene when it was judged last."""
    return [one["judgement"][-1]["at_ns"] for one in witness.others.values() if one["judgement"]] + [
        witness.last["at_ns"]
    ]


def _pass(seconds):
    threading.Event().wait(seconds)
