"""The contract of movement models, checked for every model in the registry."""

import json

import numpy as np
import pytest

from common.errors import BadInput
from common.probability import entropy_bits
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import LearnsStreams, Onset
from observer.model.model_file import read_model, require_match, write_model
from observer.model.registry import MODELS, model_named
from observer.motion.archive import MotionArchive, Recording
from observer.motion.projected import ProjectedTracker, frames_of, view_tracks
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS, WHOLE_BODY, Frame

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
    return learn_view(archive, DOOR, VOCABULARY, kind=request.param, parameters=small(request.param))


def small(kind):
    """Parameters with which a model learns in a fraction of its time."""
    return {"kernels": 336.0} if kind == "stacked" else {}


@pytest.fixture(scope="module")
def stacked(archive):
    return learn_view(archive, DOOR, VOCABULARY, kind="stacked", parameters=small("stacked"), calibrate=False)


def watched(model, recording, onset):
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, onset)
    return [observer.step(frame) for frame in frames_of(recording)]


@pytest.mark.parametrize("label", VOCABULARY.labels)
def test_recognises_people_it_has_not_seen(model, label):
    recording = move(label, 5)
    posteriors = watched(model, recording, Onset(True, len(recording.positions)))
    assert VOCABULARY.labels[posteriors[-1].p.argmax()] == label


def test_every_posterior_is_a_distribution_and_rest_a_probability(model):
    for posterior in watched(model, move("wave", 6), Onset()):
        assert posterior.p.shape == (3,) and posterior.p.sum() == pytest.approx(1) and (posterior.p >= 0).all()
        assert 0 <= posterior.rest <= 1


def test_facings_and_something_else_fit_the_posterior(model):
    watch = model.watch(Onset())
    for tracks in view_tracks(DOOR, move("wave", 6), BODY_PARTS, BODY_PARTS):
        watch.update(tracks)
        assert watch.joint is None or watch.joint.sum(axis=1) == pytest.approx(watch.p)
        if isinstance(model, LearnsStreams):
            assert watch.unlearned.shape == (1,) and 0 <= watch.unlearned[0] <= 1
        else:
            assert watch.unlearned is None, "it learned nothing but its movements"


def whole_body(label, subject):
    """The same person with all fifteen parts, of which only the right hand and elbow move."""
    hands = move(label, subject).positions
    left, right, head = hands[:, 0], hands[:, 1], hands[:, 2]
    standing = {
        "left_shoulder": (-0.2, -0.2), "right_shoulder": (0.2, -0.2), "left_elbow": (-0.25, -0.4), "neck": (0, -0.15),
        "pelvis": (0, -0.7), "left_hip": (-0.1, -0.7), "right_hip": (0.1, -0.7), "left_knee": (-0.1, -1.1),
        "right_knee": (0.1, -1.1), "left_foot": (-0.1, -1.5), "right_foot": (0.1, -1.5),
    }  # fmt: skip
    size, noise = 1 + 0.1 * subject, np.random.default_rng([7, subject])
    places = {part: np.array([*place, 0.0]) * size for part, place in standing.items()}
    known = {"left_hand": left, "right_hand": right, "head": head}
    known["right_elbow"] = (right + places["right_shoulder"]) / 2
    positions = np.stack([known.get(part, places.get(part, 0)) + np.zeros_like(head) for part in WHOLE_BODY], axis=1)
    positions = positions + noise.normal(0, 0.004, positions.shape)
    return Recording(positions.astype(np.float32), 15.0, label, str(subject), "1")


@pytest.mark.parametrize("kind", KINDS)
def test_a_model_of_fifteen_parts_works_on_with_hands_and_head(kind):
    people = tuple(whole_body(label, s) for label in VOCABULARY.labels for s in range(4))
    whole, options = MotionArchive(WHOLE_BODY, people), {"parameters": small(kind), "calibrate": False}
    model = learn_view(whole, DOOR, VOCABULARY, kind=kind, **options)
    assert model.header.body_parts == WHOLE_BODY
    for label in VOCABULARY.labels:
        shown = whole_body(label, 5)
        tracker = ProjectedTracker(DOOR, WHOLE_BODY, WHOLE_BODY)
        for hidden_from in (0, len(shown.positions) // 3, len(shown.positions)):
            observer = Observer(tracker, model, Onset(True, len(shown.positions)))
            for number, frame in enumerate(frames_of(shown)):
                points = frame.content.copy()
                points[len(BODY_PARTS) if number >= hidden_from else len(points) :] = np.nan
                posterior = observer.step(Frame(frame.captured_ns, points))
            assert posterior.p.sum() == pytest.approx(1)
            assert VOCABULARY.labels[posterior.p.argmax()] == label, hidden_from


def test_each_watch_starts_from_the_prior(model):
    onset = Onset(True, 30)
    first = watched(model, move("wave", 6), onset)
    watched(model, move("raise", 6), onset)
    again = watched(model, move("wave", 6), onset)
    assert all((a.p == b.p).all() for a, b in zip(first, again, strict=True))


def test_the_entropy_never_falls_while_the_person_is_hidden(model):
    observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, Onset(True, 60))
    frames = list(frames_of(move("wave", 6)))
    for frame in frames[:15]:
        posterior = observer.step(frame)
    entropy = entropy_bits(posterior.p)
    for frame in frames[15:]:
        posterior = observer.step(Frame(frame.captured_ns, np.full((3, 3), np.nan)))
        assert entropy_bits(posterior.p) >= entropy - 1e-9
        assert posterior.visible == dict.fromkeys(BODY_PARTS, False)
        entropy = entropy_bits(posterior.p)


def test_a_person_never_seen_is_any_movement(model):
    blank = Recording(np.full((30, 3, 3), np.nan, dtype=np.float32), 15.0, "wave", "1", "1")
    assert watched(model, blank, Onset(True, 30))[-1].p == pytest.approx(np.full(3, 1 / 3))


def test_the_size_and_the_place_of_the_person_do_not_matter(model):
    recording = move("circle", 5)
    moved = Recording(recording.positions * 1.5 + np.float32(2.0), 15.0, "circle", "5", "1")
    onset = Onset(True, len(recording.positions))
    here, there = watched(model, recording, onset), watched(model, moved, onset)
    assert here[-1].p == pytest.approx(there[-1].p, abs=1e-3)


def test_a_stored_model_gives_the_same_posteriors(model, tmp_path):
    path = tmp_path / "a.model"
    write_model(path, model)
    again = read_model(path)
    assert again.header.vocabulary == VOCABULARY and again.header.view == "door" and again.header.rate_hz == 15.0
    assert (again.header.matrix == model.header.matrix).all() and again.header.provenance == model.header.provenance
    onset = Onset(True, 45)
    pairs = zip(watched(model, move("wave", 6), onset), watched(again, move("wave", 6), onset), strict=True)
    assert all(a.p == pytest.approx(b.p, abs=1e-6) and a.unlearned == b.unlearned for a, b in pairs)


def test_a_model_for_another_vocabulary_or_rate_is_rejected(model, tmp_path):
    path = tmp_path / "a.model"
    require_match(path, model, VOCABULARY, 15.0)
    require_match(path, model, None, 15.0)
    with pytest.raises(BadInput, match=r"learned for the vocabulary \[circle, raise, wave\], the scene has \[a, b\]"):
        require_match(path, model, Vocabulary(("a", "b")), 15.0)
    with pytest.raises(BadInput, match=r"learned at 15 Hz, the source gives 30 Hz: labanmesh learn ... --rate 30"):
        require_match(path, model, VOCABULARY, 30.0)


def test_a_movement_without_recordings_is_named(archive):
    with pytest.raises(BadInput, match="jump: no recording shows this movement"):
        learn_view(archive, DOOR, Vocabulary(("wave", "jump")))


def test_a_broken_model_file_is_one_clear_line(model, tmp_path):
    path = tmp_path / "a.model"
    write_model(path, model)
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
    if not model.PARAMETERS:
        pytest.skip("this model has no parameters")
    path = tmp_path / "a.model"
    model.header.parameters.pop(missing := next(iter(model.PARAMETERS)))
    try:
        write_model(path, model)
    finally:
        model.header.parameters[missing] = model.PARAMETERS[missing].default
    with pytest.raises(BadInput, match=f"it lacks '{missing}'; learn it again"):
        read_model(path)


def test_an_unknown_model_is_named_with_the_known_ones():
    with pytest.raises(BadInput, match="model = 'phas': unknown; did you mean phase\\?"):
        model_named("phas")


def rewritten(path, header_changes=(), without=(), **arrays):
    """The model file with other entries in its header, and without some arrays or with others."""
    with np.load(path) as file:
        content = {name: file[name] for name in file.files}
    text = str(content.pop("header"))
    if callable(header_changes):
        document = json.loads(text)
        header_changes(document)
        text = json.dumps(document)
    elif header_changes:
        text = header_changes
    for name in without:
        content.pop(name, None)
    content.update({name: change(content[name]) for name, change in arrays.items() if name in content})
    with path.open("wb") as file:
        np.savez(file, header=np.array(text), **content)


def with_nan(array):
    return np.where(np.arange(array.size).reshape(array.shape) == 0, np.nan, array)


DAMAGE = {
    "rate 0": {"header_changes": lambda h: h.update(rate_hz=0)},
    "rate NaN": {"header_changes": lambda h: h.update(rate_hz=float("nan"))},
    "infinite matrix": {"header_changes": lambda h: h["matrix"][0].__setitem__(0, float("inf"))},
    "no vocabulary": {"header_changes": lambda h: h.pop("vocabulary")},
    "a list": {"header_changes": "[]"},
    "deep JSON": {"header_changes": "[" * 100_000},
    "NaN in its arrays": {"chains": with_nan, "log_table": with_nan, "ended_weights": with_nan},
    "other shapes": {"chains": lambda a: a[..., :-1], "log_table": lambda a: a[:-1], "ended_weights": lambda a: a[1:]},
    "parameter": {"header_changes": lambda h: h["parameters"].update(begin=7.0, smoothing=-1.0, kernels=1.0)},
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_model_file_is_one_clear_line(model, tmp_path, damage):
    if damage is DAMAGE["parameter"] and not model.PARAMETERS:
        pytest.skip("this model has no parameters")
    arrays = [name for name in damage if name != "header_changes"]
    if arrays and not {*arrays} & model.arrays().keys():
        damage = {next(iter(model.arrays())): damage[arrays[0]]}  # of a model that is not named there
    path = tmp_path / "a.model"
    write_model(path, model)
    rewritten(path, **damage)
    with pytest.raises(BadInput, match=r"a\.model: .*learn it again") as caught:
        read_model(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["stacker_weights", "stacker_other"])
@pytest.mark.parametrize("change", [lambda a: a[1:], with_nan], ids=["other shape", "NaN"])
def test_a_stacked_model_whose_weights_are_damaged_is_one_clear_line(stacked, tmp_path, name, change):
    write_model(path := tmp_path / "a.model", stacked)
    rewritten(path, **{name: change})
    with pytest.raises(BadInput, match=rf"a\.model: .*{name} of shape.*learn it again"):
        read_model(path)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"without": ["stacker_weights", "usual_posture"]}, "of another version of labanmesh, or damaged: it lacks"),
        (
            {"header_changes": lambda h: h.update(kind="discriminative")},
            "model kind 'discriminative' is unknown",
        ),
        ({"header_changes": lambda h: h.update(kind="phase-symbols")}, "model kind 'phase-symbols' is unknown"),
    ],
    ids=["stacked", "discriminative", "phase-symbols"],
)
def test_a_model_of_the_version_before_is_refused_with_the_command_that_learns_it(stacked, tmp_path, changes, line):
    write_model(path := tmp_path / "a.model", stacked)
    rewritten(path, **changes)
    with pytest.raises(BadInput, match=rf"a\.model: {line}.*; learn it again\Z"):
        read_model(path)
    for archive_name, view, command in (
        ("msr.npz", "yaw:45", r"learn it again: labanmesh learn msr\.npz --view yaw:45 -o .*a\.model"),
        ("sofa.npz", "camera:sofa", r"learn it again: labanmesh learn sofa\.npz -o .*a\.model"),
        ("\x1b[2J.npz", "door", "learn it again"),
    ):
        rewritten(path, lambda h, own=archive_name, v=view: h.update(provenance={"archive": own}, view=v))
        with pytest.raises(BadInput, match=rf"a\.model: {line}.*; {command}\Z"):
            read_model(path)


def test_a_model_file_with_too_many_facings_is_one_clear_line(stacked, tmp_path):
    path = tmp_path / "a.model"
    write_model(path, stacked)
    rewritten(path, lambda h: h["parameters"].update(facings=1e9))
    with pytest.raises(
        BadInput, match=r"a\.model: parameter facings = 1e\+09: a whole number from 1 to 72 is expected"
    ):
        read_model(path)
