"""The phase filter against a brute-force sum over all paths, and its properties."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_phase_filter import PhaseFilter, SpeedDynamics

from common.probability import entropy_bits


def dynamics(steps, begin=0.3, forget=0.2, entry=(0.6, 0.4), abandon=0.4):
    steps = np.atleast_2d(np.array(steps, dtype=float))
    v = len(steps)
    # Not symmetric: P(v' | v) is not P(v | v').
    jitter = np.array([[0.9, 0.1], [0.4, 0.6]]) if v == 2 else np.eye(v)
    return SpeedDynamics(steps, np.array(entry), begin, forget, abandon, speeds=np.full(v, 1 / v), jitter=jitter)


def paths_oracle(movement_of, phases, prior, d, known, evidence, rests, still):
    """Sum over every path of hidden states, one state a frame: rest, (chain, phase, speed), or after movement m."""
    chains, speeds = len(movement_of), len(d.speeds)
    count = np.bincount(movement_of, minlength=len(prior))
    states = [
        "rest",
        *itertools.product(range(chains), range(phases), range(speeds)),
        *[("after", m) for m in range(len(prior))],
    ]

    def entering(c, f, v):
        return prior[movement_of[c]] / count[movement_of[c]] * d.speeds[v] * (d.entry[f] if f < len(d.entry) else 0)

    def move(a, b):
        if a == "rest":
            return 1 - d.begin if b == "rest" else d.begin * entering(*b) if b[0] != "after" else 0.0
        if a[0] == "after":
            return d.forget if b == "rest" else 1 - d.forget if b == a else 0.0
        c, f, v = a
        if b == "rest":
            # It may leave the chain and forget at once: both happen in one step, in this order.
            return d.forget * leaves(c, f, v) + d.abandon * still * (1 - leaves(c, f, v))
        if b[0] == "after":
            return (1 - d.forget) * leaves(c, f, v) if b[1] == movement_of[c] else 0.0
        if b[0] != c or b[1] < f or b[1] - f >= d.steps.shape[1]:
            return 0.0
        return (1 - d.abandon * still) * d.jitter[v, b[2]] * d.steps[b[2], b[1] - f]

    def leaves(c, f, v):
        return sum(
            d.jitter[v, w] * d.steps[w, k] for w in range(speeds) for k in range(d.steps.shape[1]) if f + k >= phases
        )

    def likelihood(t, s):
        return rests[t] if s == "rest" or s[0] == "after" else evidence[t][s[0], s[1]]

    def initial(s):
        if known:
            return entering(*s) if s != "rest" and s[0] != "after" else 0.0
        chain_prior = prior[movement_of] / count[movement_of]
        anywhere = [a for a in states if a != "rest" and a[0] != "after"]
        middle = sum(chain_prior[a[0]] * d.speeds[a[2]] * move(a, s) for a in anywhere)
        return (1 - d.under_way) * move("rest", s) + d.under_way / phases * middle

    mass = {s: initial(s) * likelihood(0, s) for s in states}
    for t in range(1, len(evidence)):
        mass = {b: sum(mass[a] * move(a, b) for a in states) * likelihood(t, b) for b in states}
    total = sum(mass.values())
    p = np.zeros(len(prior))
    for s, value in mass.items():
        if s == "rest":
            p += value * prior
        elif s[0] == "after":
            p[s[1]] += value
        else:
            p[movement_of[s[0]]] += value
    rest = sum(v for s, v in mass.items() if s == "rest" or s[0] == "after")
    return p / total, rest / total


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("steps", [[[0.2, 0.5, 0.3]], [[0.5, 0.5, 0.0], [0.0, 0.4, 0.6]]])
@given(seed=st.integers(0, 1000), still=st.sampled_from([0.0, 0.7]), under_way=st.sampled_from([0.0, 0.3]))
@settings(max_examples=15)
def test_equals_the_sum_over_all_paths(known, steps, seed, still, under_way):
    rng = np.random.default_rng(seed)
    movement_of, phases, prior = np.array([0, 1, 1]), 3, np.array([0.3, 0.7])
    d = replace(dynamics(steps), under_way=under_way)
    evidence, rests = rng.uniform(0.05, 1, (4, 3, 3)), rng.uniform(0.05, 1, 4)
    belief = PhaseFilter(movement_of, phases, prior, d, known)
    for e, r in zip(evidence, rests, strict=True):
        belief.step(np.log(e), np.log(r), still=still)
    p, rest = paths_oracle(movement_of, phases, prior, d, known, evidence, rests, still)
    assert belief.p == pytest.approx(p)
    assert belief.rest == pytest.approx(rest)


@given(seed=st.integers(0, 1000), seen=st.integers(0, 8), known=st.booleans())
def test_with_all_parts_hidden_the_entropy_never_falls(seed, seen, known):
    rng = np.random.default_rng(seed)
    belief = PhaseFilter(np.array([0, 1, 2, 2]), 4, np.full(3, 1 / 3), dynamics([[0.2, 0.5, 0.3]]), known)
    for _ in range(seen):
        belief.step(np.log(rng.uniform(0.01, 1, (4, 4))), np.log(rng.uniform(0.01, 1)))
    last = -1.0
    for _ in range(30):
        belief.step_blind()
        now = float(entropy_bits(belief.p))
        assert now >= last - 1e-9
        last = now
    assert last == pytest.approx(np.log2(3)) or last > 0.2


def test_a_constant_added_to_all_log_evidence_changes_nothing():
    rng = np.random.default_rng(0)
    a, b = (PhaseFilter(np.array([0, 1]), 3, np.full(2, 0.5), dynamics([[0.2, 0.5, 0.3]]), False) for _ in range(2))
    for _ in range(5):
        e, r = np.log(rng.uniform(0.01, 1, (2, 3))), -0.3
        a.step(e, r)
        b.step(e - 500, r - 500)
    assert a.p == pytest.approx(b.p)


def test_impossible_evidence_leaves_a_distribution():
    belief = PhaseFilter(np.array([0, 1]), 3, np.full(2, 0.5), dynamics([[0.2, 0.5, 0.3]]), True)
    for _ in range(50):
        belief.step(np.full((2, 3), -1e9), -1e9)
    assert np.isfinite(belief.p).all() and belief.p.sum() == pytest.approx(1)
