"""`phase`: its posterior is that of the plain phase filter, at any frame rate, also from within a movement on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from performances import DOOR, recordings_of, watching
from plain_phase_filter import PhaseFilter

from common.vocabulary import Vocabulary
from observer.features import PostureReader, resampled, without_motion
from observer.learning.learn import learn_view
from observer.model.base import Example, Header, Onset, with_defaults
from observer.model.chain_filter import Dynamics
from observer.model.phase import ENTRY, STEP_SHARES, Phase, chain_dynamics, parts_read, step_probabilities
from observer.motion.archive import MotionArchive, Recording, resample
from observer.motion.projected import ProjectedTracker, frames_of, view_tracks
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS, WHOLE_BODY
from studies.performer import perform, perform_continuously

WORDS = Vocabulary(("ok", "shake", "byebye"))


def test_the_posterior_is_that_of_the_phase_filter():
    people = perform(("1", "2", "3"), WORDS.labels, trials=1, seed=1)
    model = learn_view(recordings_of(people, "12", WORDS.labels), DOOR, WORDS, kind="phase", calibrate=False)
    arrays, shares = model.arrays(), step_probabilities(15.0 / model.header.rate_hz)
    chains, answer_of = arrays["chains"].astype(float), arrays["movement_of"]
    share, parameters = 15.0 / model.header.rate_hz, model.header.parameters
    rates = (1 - (1 - parameters[name]) ** share for name in ("begin", "forget", "abandon"))
    dynamics = Dynamics(shares, np.array(ENTRY), *rates)
    oracle = PhaseFilter(answer_of, chains.shape[1], np.full(3, 1 / 3), dynamics, onset_known=True)
    reader = PostureReader(BODY_PARTS, model.header.rate_hz, parameters["fast"], parameters["apart"])
    (shown,) = recordings_of(people, "3", ("byebye",)).recordings
    frames = iter(view_tracks(DOOR, shown, BODY_PARTS, BODY_PARTS))
    for n, watch in enumerate(watching(model, shown, Onset(known=True))):
        if n == 12:
            break
        features = reader.update(next(frames))
        likelihood = np.exp(-share * parameters["sharpness"] * squared(features, chains))
        log = np.log(likelihood + np.exp(-share * parameters["outlier"]) * likelihood[:, : 4 + 4 * n].max())
        first, last = (
            np.exp(-share * parameters["sharpness"] * squared(features, without_motion(chains[:, k]))) for k in (0, -1)
        )
        rest = (first.mean() + last.mean()) / 2
        after = [max(last[answer_of == a].mean(), rest) for a in range(3)]
        oracle.step(log, float(np.log(rest)), np.log(after), reader.still)
        assert watch.p == pytest.approx(oracle.p, abs=1e-3) and watch.unlearned is None


@pytest.mark.parametrize(
    ("parts", "read"),
    [
        (BODY_PARTS, BODY_PARTS),
        (WHOLE_BODY, (*BODY_PARTS, "left_elbow", "right_elbow", "left_knee", "right_knee", "left_foot", "right_foot")),
        (("neck", "pelvis", "left_hip"), ("neck", "pelvis", "left_hip")),
        (("tail", "neck", "paw"), ("tail", "paw")),
    ],
)
def test_it_reads_the_head_and_the_limbs(parts, read):
    assert parts_read(parts) == read


def test_chains_of_other_parts_are_refused():
    header = Header("phase", WORDS, "door", DOOR.matrix, 15.0, WHOLE_BODY, {}, {})
    movement, facing = np.arange(3), np.zeros(3, np.int64)

    def read(parts):
        return Phase.from_arrays(
            with_defaults(header, Phase.PARAMETERS),
            {"chains": np.zeros((3, 8, 5 * parts + 2), np.float32), "movement_of": movement, "facing_of": facing},
        )

    assert read(len(parts_read(WHOLE_BODY))).header.body_parts == WHOLE_BODY
    for parts in (len(WHOLE_BODY), 7):
        with pytest.raises(ValueError, match="chains"):
            read(parts)


def squared(features, postures):
    return (np.where(np.isfinite(features), features - postures, 0.0) ** 2).sum(axis=-1)


NAMES = Vocabulary(("raise", "wave"))


@given(st.floats(0.05, 4.0))
def test_the_mean_number_of_phases_is_proportional_to_time(share):
    steps = step_probabilities(share)
    assert steps.sum() == pytest.approx(1) and (steps >= 0).all()
    assert steps @ np.arange(len(steps)) == pytest.approx(share * np.dot(STEP_SHARES, range(len(STEP_SHARES))))


def test_probabilities_per_fifteenth_of_a_second_become_those_per_frame():
    parameters = {"begin": 0.05, "forget": 0.01, "abandon": 0.02, "settled": 15.0}
    for frames, share in ((2, 0.5), (4, 0.25)):
        dynamics = chain_dynamics(parameters, share, onset_known=False)
        for name in ("begin", "forget", "abandon"):
            assert (1 - getattr(dynamics, name)) ** frames == pytest.approx(1 - parameters[name])
        assert dynamics.settled == 15.0 * frames
    assert chain_dynamics(parameters, 0.5, onset_known=True).settled == np.inf


def header(rate_hz):
    own = Header("phase", NAMES, "door", DOOR.matrix, rate_hz, BODY_PARTS, {"outlier": 500.0})
    return with_defaults(own, Phase.PARAMETERS)


def log_likelihoods(rate_hz, features):
    """(Φ, 2) up to a constant, of two chains of 8 postures."""
    chains = np.random.default_rng(0).normal(0, 1, (2, 8, 17)).astype(np.float32)
    model = Phase(header(rate_hz), chains, np.arange(2), np.zeros(2, np.int64))
    likelihood, _ = model.evidence().see(features).chains(None, 8)
    return np.log(likelihood)


def test_the_evidence_of_a_frame_is_spread_over_the_frames_of_a_fifteenth_of_a_second():
    features = np.random.default_rng(1).normal(0, 1, 17)
    np.testing.assert_allclose(2 * log_likelihoods(30.0, features), log_likelihoods(15.0, features), rtol=1e-3)


def test_a_phase_lasts_a_fifteenth_of_a_second_at_any_frame_rate():
    rows = np.random.default_rng(0).normal(0, 1, (60, 17))
    examples = [Example((), movement, features=rows[:frames]) for movement in (0, 1) for frames in (24, 40, 60)]
    for rate_hz, phases in ((15.0, 40), (30.0, 20), (7.5, 80)):
        assert Phase.learn(header(rate_hz), examples).arrays()["chains"].shape[1] == phases


@given(frames=st.integers(2, 30), phases=st.integers(2, 30))
def test_phases_lie_evenly_between_the_first_and_the_last_frame(frames, phases):
    rows = np.random.default_rng(frames).normal(0, 1, (frames, 2))
    at = np.linspace(0, frames - 1, phases)
    expected = np.stack([np.interp(at, np.arange(frames), column) for column in rows.T], axis=1)
    np.testing.assert_allclose(resampled(rows, phases), expected, atol=1e-9)


def performed(label, size):
    t = np.linspace(0, 1, 31)
    up = np.sin(np.pi * t)
    aside = 0.3 * np.sin(6 * np.pi * t) * up if label == "wave" else 0 * t
    positions = np.zeros((len(t), 3, 3))
    positions[:, 0] = (-0.25, -0.6, 0)
    positions[:, 1] = np.stack([0.25 + aside, -0.6 + up, 0 * t], axis=1)
    return Recording((positions * size).astype(np.float32), 15.0, label, str(size), "1")


def surety(rate_hz, label):
    people = [resample(performed(name, size), rate_hz) for name in NAMES.labels for size in (0.9, 1.0, 1.1)]
    model = learn_view(MotionArchive(BODY_PARTS, tuple(people)), DOOR, NAMES, calibrate=False)
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, Onset(known=True))
    shown = list(frames_of(resample(performed(label, 1.05), rate_hz)))
    return [observer.step(frame).p[NAMES.index(label)] for frame in shown][round(0.3 * len(shown))]


@pytest.mark.parametrize("label", NAMES.labels)
def test_twice_the_frame_rate_gives_the_same_posterior(label):
    odds = [np.log(p / (1 - p)) for p in (surety(15.0, label), surety(30.0, label))]
    assert odds[1] == pytest.approx(odds[0], abs=max(0.5, 0.4 * abs(odds[0])))


MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
SOON = 3
"""Frames, a fifth of a second."""


@pytest.fixture(scope="module")
def model():
    return learn_view(perform(("2", "3", "4"), MOVEMENTS, trials=2), DOOR, Vocabulary(MOVEMENTS), kind="phase")


@pytest.fixture(scope="module")
def stream():
    return perform_continuously("1", MOVEMENTS, rest_s=(2.0, 2.6))


def started(model, stream, at):
    """Rest and posterior SOON frames after a start with frame `at`."""
    watch = model.watch(Onset())
    tracks = list(view_tracks(DOOR, stream, BODY_PARTS, BODY_PARTS))
    for each in tracks[at : at + SOON]:
        watch.update(each)
    return watch.rest, watch.p


def test_an_observer_that_starts_in_the_middle_of_a_movement_soon_sees_it(model, stream):
    starts = [(at, n) for n, span in enumerate(stream.spans) for at in range(span.start + 5, span.end - 8, 4)]
    outputs = [(*started(model, stream, at), n) for at, n in starts]
    assert np.mean([rest >= 0.5 for rest, _, _ in outputs]) <= 0.05
    assert np.mean([p.max() > 0.6 and p.argmax() != n for _, p, n in outputs]) <= 0.05


def test_an_observer_that_starts_while_the_person_rests_says_so(model, stream):
    ends, begins = [0, *(span.end for span in stream.spans)], [*(span.start for span in stream.spans), None]
    starts = [at for end, begin in zip(ends, begins, strict=True) for at in range(end + 6, (begin or end + 20) - 6, 4)]
    outputs = [started(model, stream, at) for at in starts]
    assert all(rest > 0.5 for rest, _ in outputs)
    assert np.mean([p.max() > 0.6 for _, p in outputs]) <= 0.05
