"""The plain phase filter, an oracle, against a brute-force sum over all paths."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_phase_filter import PhaseFilter

from observer.filtering.chain_filter import Dynamics


def paths_oracle(movement_of, phases, prior, d, known, evidence, rests, still):
    """Sum over every path of hidden states, one state a frame: rest, (chain, phase), or after movement m."""
    chains, count = len(movement_of), np.bincount(movement_of, minlength=len(prior))
    states = [
        "rest",
        *itertools.product(range(chains), range(phases)),
        *[("after", m) for m in range(len(prior))],
    ]

    def entering(c, f):
        return prior[movement_of[c]] / count[movement_of[c]] * (d.entry[f] if f < len(d.entry) else 0)

    def move(a, b):
        if a == "rest":
            return 1 - d.begin if b == "rest" else d.begin * entering(*b) if b[0] != "after" else 0.0
        if a[0] == "after":
            return d.forget if b == "rest" else 1 - d.forget if b == a else 0.0
        c, f = a
        if b == "rest":
            # It may leave the chain and forget at once: both happen in one step, in this order.
            return d.forget * leaves(f) + d.abandon * still * (1 - leaves(f))
        if b[0] == "after":
            return (1 - d.forget) * leaves(f) if b[1] == movement_of[c] else 0.0
        if b[0] != c or b[1] < f or b[1] - f >= len(d.steps):
            return 0.0
        return (1 - d.abandon * still) * d.steps[b[1] - f]

    def leaves(f):
        return d.steps[phases - f :].sum()

    def likelihood(t, s):
        return rests[t] if s == "rest" or s[0] == "after" else evidence[t][s[0], s[1]]

    def initial(s):
        if known:
            return entering(*s) if s != "rest" and s[0] != "after" else 0.0
        chain_prior = prior[movement_of] / count[movement_of]
        anywhere = [a for a in states if a != "rest" and a[0] != "after"]
        middle = sum(chain_prior[a[0]] * move(a, s) for a in anywhere)
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
@pytest.mark.parametrize("steps", [[0.2, 0.5, 0.3], [0.0, 0.4, 0.6]])
@given(seed=st.integers(0, 1000), still=st.sampled_from([0.0, 0.7]), under_way=st.sampled_from([0.0, 0.3]))
@settings(max_examples=15)
def test_equals_the_sum_over_all_paths(known, steps, seed, still, under_way):
    rng = np.random.default_rng(seed)
    movement_of, phases, prior = np.array([0, 1, 1]), 3, np.array([0.3, 0.7])
    d = Dynamics(np.array(steps), np.array([0.6, 0.4]), 0.3, 0.2, abandon=0.4, under_way=under_way)
    evidence, rests = rng.uniform(0.05, 1, (4, 3, 3)), rng.uniform(0.05, 1, 4)
    belief = PhaseFilter(movement_of, phases, prior, d, known)
    for e, r in zip(evidence, rests, strict=True):
        belief.step(np.log(e), np.log(r), still=still)
    p, rest = paths_oracle(movement_of, phases, prior, d, known, evidence, rests, still)
    assert belief.p == pytest.approx(p)
    assert belief.rest == pytest.approx(rest)
