"""The chain filter against the phase filter and a table of all transitions, and its properties."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from performances import DOOR
from plain_phase_filter import PhaseFilter

from common.probability import entropy_bits, uniform
from common.vocabulary import Vocabulary
from observer.features import PostureReader, without_motion
from observer.learning.learn import learn_view
from observer.model.chain_filter import ChainFilter, Dynamics, PostureEvidence, Postures, RestPostures
from observer.model.phase import ENTRY, STEP_SHARES
from observer.motion.projected import view_tracks
from studies.performer import perform

FACINGS, PHASES = 2, 8
CELL_OF = np.array([0, 1, 2, 3, 3, 2, 4, 5])
"""Three movements at two facings; one has two chains at each."""
MOVEMENTS = 3
SHAPE = MOVEMENTS, FACINGS, PHASES
DYNAMICS = Dynamics(np.array(STEP_SHARES), np.array(ENTRY), begin=0.3, forget=0.2, abandon=0.3)
SEEDS = st.integers(0, 10_000)
some = settings(max_examples=25, deadline=None)


class Table:
    """One frame's evidence as tables: log (C, Φ), rest, (M, K) after."""

    def __init__(self, log, rest, after):
        self.log, self.rest, self.after = log, rest, after

    @classmethod
    def drawn(cls, rng, strength=5.0, facings=FACINGS):
        log = rng.uniform(-strength, 0, (len(CELL_OF), PHASES))
        return cls(log, rng.uniform(-strength, 0), rng.uniform(-strength, 0, (MOVEMENTS, facings)))

    def chains(self, live, phases):
        log = (self.log if live is None else self.log[live]).T[:phases]
        scale = float(log.max())
        return np.exp(log - scale).astype(np.float32), scale


def chain_filter(known, negligible=0.0):
    return ChainFilter(CELL_OF, SHAPE, DYNAMICS, known, negligible)


@some
@given(
    seed=SEEDS,
    known=st.booleans(),
    blind=st.sets(st.integers(0, 11)),
    facings=st.sampled_from([FACINGS, 1]),
    # Also at a frame rate so low that a step can be longer than the chain.
    steps=st.sampled_from([STEP_SHARES, (0.0, *[0.05] * 20)]),
    under_way=st.sampled_from([0.0, 0.3]),
)
def test_equals_the_phase_filter_of_each_movement_at_each_facing(seed, known, blind, facings, steps, under_way):
    rng, dynamics = np.random.default_rng(seed), replace(DYNAMICS, steps=np.array(steps), under_way=under_way)
    cell_of = CELL_OF * facings // FACINGS
    ours = ChainFilter(cell_of, (MOVEMENTS, facings, PHASES), dynamics, known, negligible=0.0)
    oracle, first = PhaseFilter(cell_of, PHASES, uniform(MOVEMENTS * facings), dynamics, known), known
    for n in range(12):
        if n in blind:
            ours.step_blind()
            oracle.step_blind()
        else:
            frame = Table.drawn(rng, facings=facings)
            still = rng.uniform()
            ours.step(frame, still)
            oracle.step(frame.log, frame.rest, frame.after.ravel(), still)
        assert ours.rest == pytest.approx(oracle.rest, abs=1e-5)
        first = first and ours.rest < 0.5
        # During a movement the previous one is not reported, although it keeps its mass.
        if first or (ours.rest >= 0.5 and n not in blind):
            assert ours.posterior.ravel() == pytest.approx(oracle.p, abs=1e-5)


def transitions():
    """(S, S) P(state | state before) of before, C x Φ and M x K rests, and (S,) the movement of each; before is -1."""
    count = np.bincount(CELL_OF)
    chain_states = [(c, f) for c in range(len(CELL_OF)) for f in range(PHASES)]
    states = ["before", *chain_states, *[("after", cell) for cell in range(len(count))]]
    place = {state: n for n, state in enumerate(states)}
    table = np.zeros((len(states), len(states)))
    table[0, 0] = 1 - DYNAMICS.begin
    for c, f in chain_states:
        if f < len(ENTRY):
            table[0, place[c, f]] = DYNAMICS.begin * ENTRY[f] / len(count) / count[CELL_OF[c]]
        for k, share in enumerate(STEP_SHARES):
            if f + k < PHASES:
                table[place[c, f], place[c, f + k]] += share
            else:
                table[place[c, f], place["after", CELL_OF[c]]] += share * (1 - DYNAMICS.forget)
                table[place[c, f], 0] += share * DYNAMICS.forget
    for cell in range(len(count)):
        table[place["after", cell], place["after", cell]] = 1 - DYNAMICS.forget
        table[place["after", cell], 0] = DYNAMICS.forget
    movement = [-1, *(CELL_OF[c] // FACINGS for c, _ in chain_states), *(cell // FACINGS for cell in range(len(count)))]
    return table, np.array(movement)


def exact_filter(seed, frames):
    """Each frame's evidence and likelihoods (S,), and the mass (S,) before it and, not normalised, after it."""
    rng, (table, _) = np.random.default_rng(seed), transitions()
    mass = np.eye(len(table))[0]
    for _ in range(frames):
        frame = Table.drawn(rng)
        likelihood = np.exp(np.concatenate([[frame.rest], frame.log.ravel(), frame.after.ravel()]))
        # The first frame is predicted too: a person at rest may begin with it.
        foreseen = mass @ table
        yield frame, likelihood, foreseen, foreseen * likelihood
        mass = foreseen * likelihood / (foreseen @ likelihood)


@some
@given(SEEDS)
def test_the_previous_movement_is_no_answer_during_a_movement(seed):
    (_, movement), cells = transitions(), np.bincount(CELL_OF).size
    active = movement[1:-cells] * FACINGS + np.repeat(CELL_OF % FACINGS, PHASES)
    done_before, past, moving, ours = np.zeros(cells), np.zeros(cells), False, chain_filter(known=False)
    for frame, likelihood, _, unscaled in exact_filter(seed, 25):
        ours.step(frame)
        mass = unscaled / unscaled.sum()
        past = past if moving else done_before
        past = past * (1 - DYNAMICS.forget) * likelihood[-cells:] / unscaled.sum()
        moving = mass[0] + mass[-cells:].sum() < 0.5
        answers = np.bincount(active, mass[1:-cells], cells) + mass[-cells:] - past * moving + mass[0] / cells
        assert ours.posterior.ravel() == pytest.approx(answers / answers.sum(), abs=1e-4)
        done_before = mass[-cells:]


@some
@given(seed=SEEDS, seen=st.integers(0, 12), settled=st.integers(1, 5))
def test_who_is_still_for_long_enough_rests_whatever_the_posture(seed, seen, settled):
    rng, dynamics = np.random.default_rng(seed), replace(DYNAMICS, abandon=0.0, settled=settled)
    filters = [ChainFilter(CELL_OF, SHAPE, d, False) for d in (dynamics, replace(DYNAMICS, abandon=0.0))]
    frames = [(Table.drawn(rng), rng.uniform(0, 0.4)) for _ in range(seen)]
    frames += [(Table(np.zeros((len(CELL_OF), PHASES)), -9.0, np.full((MOVEMENTS, FACINGS), -9.0)), 0.9)] * settled
    for n, (frame, still) in enumerate(frames):
        for belief in filters:
            belief.step(frame, still)
        if n < seen + settled - 1:
            assert filters[0].rest == filters[1].rest
    assert filters[0].rest >= 0.5 and filters[0].posterior.sum() == pytest.approx(1)


@some
@given(seed=SEEDS, seen=st.integers(0, 12), known=st.booleans(), negligible=st.sampled_from([0.0, 1e-8, 1e-3]))
def test_blind_frames_never_lower_the_entropy_of_movement_or_facing(seed, seen, known, negligible):
    rng = np.random.default_rng(seed)
    belief = chain_filter(known, negligible)
    for _ in range(seen):
        belief.step(Table.drawn(rng))
    last = np.full(2, -1.0)
    for _ in range(25):
        belief.step_blind()
        now = np.array([entropy_bits(belief.posterior.sum(axis=1)), entropy_bits(belief.posterior.ravel())])
        assert (now >= last - 1e-5).all()
        last = now


@some
@given(seed=SEEDS, known=st.booleans(), negligible=st.sampled_from([0.0, 1e-8]), strength=st.sampled_from([5.0, 500.0]))
def test_the_posterior_is_always_a_distribution(seed, known, negligible, strength):
    rng = np.random.default_rng(seed)
    belief = chain_filter(known, negligible)
    for _ in range(30):
        belief.step(Table.drawn(rng, strength))
        assert belief.posterior.shape == (MOVEMENTS, FACINGS) and (belief.posterior >= 0).all()
        assert belief.posterior.sum() == pytest.approx(1) and 0 <= belief.rest <= 1


class CountedEvidence:
    """Evidence that notes how many cells were counts for."""

    def __init__(self, evidence, cells):
        self._evidence, self._cells = evidence, cells
        self.rest, self.after = evidence.rest, evidence.after

    def chains(self, live, phases):
        likelihood, scale = self._evidence.chains(live, phases)
        self._cells.append(likelihood.size)
        return likelihood, scale


@pytest.mark.parametrize("known", [True, False])
def test_skipping_negligible_mass_changes_little_and_saves_most_of_the_work(known):
    labels = ("ok", "shake", "lunging")
    archive = perform(("1", "2"), labels, trials=2, seed=3)
    model = learn_view(archive, DOOR, Vocabulary(labels), parameters={"facings": 4.0}, calibrate=False)
    chains, cell_of = model.arrays()["chains"], model.arrays()["movement_of"] * 4 + model.arrays()["facing_of"]
    postures, ends = Postures(chains.transpose(1, 2, 0)), [without_motion(chains[:, n]) for n in (0, -1)]
    at_rest = RestPostures(*ends, cell_of, (3, 4))
    dynamics = Dynamics(np.array(STEP_SHARES), np.array(ENTRY), 0.05, 0.01)
    counts: dict[float, list[int]] = {0.0: [], 1e-8: []}
    for recording in perform(("3",), labels, seed=4).recordings:
        exact, quick = (ChainFilter(cell_of, (3, 4, chains.shape[1]), dynamics, known, n) for n in counts)
        chosen = [PostureEvidence(postures, at_rest, 1.0, 5.0) for _ in counts]
        reader = PostureReader(archive.body_parts, recording.rate_hz, max_speed=1.5, hands_weight=0.5)
        for tracks in view_tracks(DOOR, recording, archive.body_parts, archive.body_parts):
            features = reader.update(tracks)
            for belief, own, cells in zip((exact, quick), chosen, counts.values(), strict=True):
                belief.step(CountedEvidence(own.see(features), cells))
            assert quick.posterior == pytest.approx(exact.posterior, abs=1e-3)
            assert quick.rest == pytest.approx(exact.rest, abs=1e-3)
    assert sum(counts[1e-8]) < 0.6 * sum(counts[0.0])
