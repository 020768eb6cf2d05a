"""What every movement model must keep: any model put into the registry is held to this."""

import numpy as np
import pytest

from common.errors import BadInput
from common.probability import entropy_bits
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.model_file import read_model, require, write_model
from observer.model.posterior_calibration import PosteriorCalibration
from observer.model.registry import MODELS, model_named
from observer.motion.archive import MotionArchive, Recording
from observer.motion.projected import ProjectedTracker, frames_of, view_tracks
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS, Frame

KINDS = list(MODELS)
VOCABULARY = Vocabulary(("circle", "raise", "wave"))
DOOR = parse_view("door")


def move(label, subject, frames=36):
    """A person of its own size and tempo moving the right hand; no recorded person."""
    rng = np.random.default_rng([ord(label[0]), subject])
    size, frames = 1 + 0.1 * subject, frames + 3 * subject
    t = np.linspace(0, 1, frames)
    up = np.sin(np.pi * t)
    path = {
        "raise": np.stack([0.2 + 0 * t, -0.6 + 1.2 * up, 0 * t], 1),
        "wave": np.stack([0.3 + 0.25 * np.sin(6 * np.pi * t) * up, -0.6 + 1.0 * np.minimum(3 * up, 1), 0 * t], 1),
        "circle": np.stack([0.3 * np.sin(4 * np.pi * t), -0.6 + 0.4 * (1 - np.cos(4 * np.pi * t)), 0 * t], 1),
    }[label]
    positions = np.zeros((frames, 3, 3))
    positions[:, 0], positions[:, 1] = (-0.2, -0.6, 0), path
    positions = positions * size + rng.normal(0, 0.004, positions.shape)
    return Recording(positions.astype(np.float32), 15.0, label, str(subject), "1")


@pytest.fixture(scope="module")
def archive():
    return MotionArchive(BODY_PARTS, tuple(move(label, s) for label in VOCABULARY.labels for s in range(4)))


@pytest.fixture(scope="module", params=KINDS)
def model(request, archive):
    return learn_view(archive, DOOR, VOCABULARY, kind=request.param)


def watched(model, recording, onset):
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, onset)
    return [observer.step(frame) for frame in frames_of(recording)]


@pytest.mark.parametrize("label", VOCABULARY.labels)
def test_recognises_people_it_has_not_seen(model, label):
    recording = move(label, 5)
    opinions = watched(model, recording, Onset(True, len(recording.positions)))
    assert VOCABULARY.labels[opinions[-1].p.argmax()] == label


def test_every_belief_is_a_distribution_and_rest_a_probability(model):
    for opinion in watched(model, move("wave", 6), Onset()):
        assert opinion.p.shape == (3,) and opinion.p.sum() == pytest.approx(1) and (opinion.p >= 0).all()
        assert 0 <= opinion.rest <= 1


def test_what_it_says_of_facing_and_of_what_it_has_not_learned_fits_its_belief(model):
    watch = model.watch(Onset())
    for tracks in view_tracks(DOOR, move("wave", 6), BODY_PARTS, BODY_PARTS):
        watch.update(tracks)
        assert watch.joint is None or watch.joint.sum(axis=1) == pytest.approx(watch.p)
        assert watch.foreseen is None or (watch.foreseen.shape == (3,) and np.isfinite(watch.foreseen).all())
        assert watch.unlearned is None, "it was shown nothing but its movements"


def test_it_knows_how_far_it_can_be_believed(model):
    assert model.header.certainty != PosteriorCalibration()


def test_beginning_anew_forgets_everything(model):
    onset = Onset(True, 30)
    first = watched(model, move("wave", 6), onset)
    watched(model, move("raise", 6), onset)
    again = watched(model, move("wave", 6), onset)
    assert all((a.p == b.p).all() for a, b in zip(first, again, strict=True))


def test_a_hidden_person_makes_nobody_surer(model):
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, Onset(True, 60))
    frames = list(frames_of(move("wave", 6)))
    for frame in frames[:15]:
        opinion = observer.step(frame)
    entropy = entropy_bits(opinion.p)
    for frame in frames[15:]:
        opinion = observer.step(Frame(frame.captured_ns, np.full((3, 3), np.nan)))
        assert entropy_bits(opinion.p) >= entropy - 1e-9
        assert opinion.visible == dict.fromkeys(BODY_PARTS, False)
        entropy = entropy_bits(opinion.p)


def test_a_person_never_seen_is_any_movement(model):
    blank = Recording(np.full((30, 3, 3), np.nan, dtype=np.float32), 15.0, "wave", "1", "1")
    assert watched(model, blank, Onset(True, 30))[-1].p == pytest.approx(np.full(3, 1 / 3))


def test_the_size_and_the_place_of_the_person_do_not_matter(model):
    recording = move("circle", 5)
    moved = Recording(recording.positions * 1.5 + np.float32(2.0), 15.0, "circle", "5", "1")
    onset = Onset(True, len(recording.positions))
    here, there = watched(model, recording, onset), watched(model, moved, onset)
    assert here[-1].p == pytest.approx(there[-1].p, abs=1e-3)


def test_what_is_stored_judges_the_same(model, tmp_path):
    path = tmp_path / "a.model"
    write_model(path, model)
    again = read_model(path)
    assert again.header.vocabulary == VOCABULARY and again.header.view == "door" and again.header.rate_hz == 15.0
    assert (again.header.matrix == model.header.matrix).all() and again.header.provenance == model.header.provenance
    assert again.header.certainty == model.header.certainty
    onset = Onset(True, 45)
    pairs = zip(watched(model, move("wave", 6), onset), watched(again, move("wave", 6), onset), strict=True)
    assert all(a.p == pytest.approx(b.p, abs=1e-6) and a.unlearned == b.unlearned for a, b in pairs)


def test_a_model_for_another_vocabulary_or_rate_is_refused(model, tmp_path):
    path = tmp_path / "a.model"
    require(path, model, VOCABULARY, 15.0)
    require(path, model, None, 15.0)
    with pytest.raises(BadInput, match=r"learned for the vocabulary \[circle, raise, wave\], the scene has \[a, b\]"):
        require(path, model, Vocabulary(("a", "b")), 15.0)
    with pytest.raises(BadInput, match=r"learned at 15 Hz, the source gives 30 Hz: labanmesh learn ... --rate 30"):
        require(path, model, VOCABULARY, 30.0)


def test_a_movement_that_nobody_performs_is_named(archive):
    with pytest.raises(BadInput, match="'jump': no recording shows it"):
        learn_view(archive, DOOR, Vocabulary(("wave", "jump")))


@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_model_file_is_one_clear_line(kind, archive, tmp_path):
    path = tmp_path / "a.model"
    write_model(path, learn_view(archive, DOOR, VOCABULARY, kind=kind))
    whole = path.read_bytes()
    for broken in (b"", b"garbage", whole[: len(whole) // 2]):
        path.write_bytes(broken)
        with pytest.raises(BadInput, match=r"a\.model.*labanmesh learn") as caught:
            read_model(path)
        assert "\n" not in str(caught.value)
    np.savez(tmp_path / "b.npz", other=np.zeros(3))
    with pytest.raises(BadInput, match="header"):
        read_model(tmp_path / "b.npz")
    with pytest.raises(BadInput, match="no such model file"):
        read_model(tmp_path / "none.model")


def test_a_model_file_without_a_parameter_is_one_clear_line(model, tmp_path):
    path = tmp_path / "a.model"
    model.header.parameters.pop(missing := next(iter(model.DEFAULTS)))
    try:
        write_model(path, model)
    finally:
        model.header.parameters[missing] = model.DEFAULTS[missing]
    with pytest.raises(BadInput, match=f"lacks the parameter '{missing}'; learn it again"):
        read_model(path)


def test_an_unknown_model_is_named_with_the_known_ones():
    with pytest.raises(BadInput, match="model = 'phas': unknown; did you mean 'phase'\\?; known: phase"):
        model_named("phas")
