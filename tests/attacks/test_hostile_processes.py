"""A hostile judge in the place of one of four real observers of a recorded person, for one round of the film. What the
three honest ones decide without it, by the pure engine, is what a listener must receive."""

import itertools
import threading
import time

import pytest
from attack_judges import TICK_S
from attack_strategies import HONEST, STRATEGIES, Moment
from attack_trial import Case, by_movement, run

from common import SECOND_NS

PLACE = "side"
PLAYED = ("wrong from the first frame", "rest flapping", "absurd facets")
SETTLE_S = 2.0


def moment(person, stage, seq):
    """What the hostile judge knows now."""
    now_ns = time.time_ns()
    at_s = (now_ns - stage.start_ns) / SECOND_NS
    frame = int(at_s * person.stream.rate_hz) % len(person.stream.positions)
    span = next((s for s in person.spans if s.start <= frame < s.end), None)
    label = None if span is None else person.vocabulary.labels.index(span.label)
    since_s = 0.0 if span is None else (frame - span.start) / person.stream.rate_hz
    own, digest = person.course(PLACE), person.vocabulary.digest
    return Moment(now_ns, seq, own.p[frame], own.rest[frame], label, since_s, digest, TICK_S)


def performed(person, stage, from_ns, until_ns):
    """The movements that lie wholly between two times: begin and end in seconds since the stage began, and label."""
    rate, length = person.stream.rate_hz, len(person.stream.positions)
    rounds = range((until_ns - stage.start_ns) * int(rate) // (length * SECOND_NS) + 1)
    spans = [
        ((n * length + s.start) / rate, (n * length + s.end) / rate, s.label) for n in rounds for s in person.spans
    ]
    first_s, last_s = ((at_ns - stage.start_ns) / SECOND_NS for at_ns in (from_ns, until_ns))
    return [span for span in spans if first_s <= span[0] and span[1] <= last_s]


def expected(person, spans):
    """By movement the label that honest judges give it in one verdict, whatever their rate; None where they do not give
    the right one, or give two at one rate and one at another: that says nothing of the hostile one."""
    rate = person.stream.rate_hz
    once = [(s.start / rate, s.end / rate, s.label) for s in person.spans]
    known = {round(begin): label for begin, _, label in once}
    for strategy, rate_hz in itertools.product(("", HONEST), (rate, 2 * rate)):
        outcome = run(person, Case(strategy, 4, rate_hz))
        for (begin, _, label), ids in zip(once, by_movement(once, outcome.verdicts)[:-1], strict=True):
            if [outcome.verdicts[name][0] for name in ids] != [label]:
                known[round(begin)] = None
    length_s = len(person.stream.positions) / rate
    return [known.get(round(begin % length_s)) for begin, _, _ in spans]


@pytest.mark.parametrize("strategy", PLAYED)
def test_listeners_receive_what_three_honest_observers_decide(stage, person, strategy, long_form):
    if not long_form:
        pytest.skip("it takes a round of the film: make attacks")
    scene, attacker = stage.scenes[0], stage.attacker()
    stage.processes[PLACE].kill()
    from_ns = time.time_ns()
    until_ns = from_ns + len(person.stream.positions) * SECOND_NS // int(person.stream.rate_hz)
    seq = 0
    while time.time_ns() < until_ns:
        seq += 1
        for payload in STRATEGIES[strategy](moment(person, stage, seq)):
            attacker.session.put(scene.keys.posterior(PLACE), payload)
        threading.Event().wait(TICK_S)
    stage.await_judgements(SETTLE_S)
    spans = performed(person, stage, from_ns + SECOND_NS, until_ns)
    verdicts = {m.id: ended(m, stage.start_ns) for at_ns, m in stage.witness.verdicts[scene.scene] if at_ns > from_ns}
    rows = [
        (span, label, [verdicts[name][0] for name in ids])
        for span, label, ids in zip(spans, expected(person, spans), by_movement(spans, verdicts)[:-1], strict=True)
    ]
    stage.history.note("verdicts", rows=rows)
    print(strategy, *rows, sep="\n")
    stage.start(PLACE)
    assert sum(label is not None for _, label, _ in rows) > len(rows) / 2, "the honest agree about most"
    assert [row for row in rows if row[1] is not None and row[2] != [row[1]]] == []


def ended(message, start_ns):
    """A verdict as `by_movement` reads it."""
    times = (message.began_ns, message.ended_ns or message.decided_ns)
    return message.label, tuple((at_ns - start_ns) / SECOND_NS for at_ns in times), message.ended_ns is not None
