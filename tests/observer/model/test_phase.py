"""`phase`: the posterior of a learned model is that of the plain phase filter, with its evidence written down here."""

import numpy as np
import pytest
from performances import DOOR, recordings_of, watching
from plain_phase_filter import PhaseFilter

from common.vocabulary import Vocabulary
from observer.features import PostureReader, without_motion
from observer.filtering.chain_filter import Dynamics
from observer.learning.learn import learn_view
from observer.model.base import Header, Onset, with_defaults
from observer.model.phase import ENTRY, Phase, parts_read, step_probabilities
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, WHOLE_BODY
from studies.performer import perform

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


def test_the_chains_of_all_parts_are_of_another_version():
    header = Header("phase", WORDS, "door", DOOR.matrix, 15.0, WHOLE_BODY, {}, {})
    movement, facing = np.arange(3), np.zeros(3, np.int64)

    def read(parts):
        return Phase.from_arrays(
            with_defaults(header, Phase.PARAMETERS),
            {"chains": np.zeros((3, 8, 5 * parts + 2), np.float32), "movement_of": movement, "facing_of": facing},
        )

    assert read(len(parts_read(WHOLE_BODY))).header.body_parts == WHOLE_BODY
    with pytest.raises(KeyError, match="limbs"):
        read(len(WHOLE_BODY))
    with pytest.raises(ValueError, match="chains"):
        read(7)


def squared(features, postures):
    return (np.where(np.isfinite(features), features - postures, 0.0) ** 2).sum(axis=-1)
