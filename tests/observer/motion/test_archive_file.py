"""Motion archives are read as they were written; each defect of a file is named in one line."""

import itertools
import re
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, Span, TracksCamera, clean_label, is_label
from observer.motion.archive_file import read_archive, write_archive

PARTS = ("left_hand", "right_hand", "head")


def contract_arrays():
    """A file as contract.md describes it, built by hand: two recordings of 3 and 2 frames, the second with spans."""
    positions = np.arange(45, dtype=np.float32).reshape(5, 3, 3)
    positions[1, 0] = np.nan
    return {
        "positions": positions,
        "lengths": np.array([3, 2], np.int64),
        "rate_hz": np.array(15.0),
        "body_parts": np.array(PARTS),
        "labels": np.array(["wave", ""]),
        "subjects": np.array(["1", "2"]),
        "trials": np.array(["1", "1"]),
        "span_recording": np.array([1, 1], np.int64),
        "span_start": np.array([1, 0], np.int64),
        "span_end": np.array([2, 1], np.int64),
        "span_label": np.array(["bend", "wave"]),
    }


def saved(tmp_path, **changes):
    contents = {name: array for name, array in (contract_arrays() | changes).items() if array is not None}
    path = tmp_path / "motion.npz"
    np.savez(path, **contents)
    return path


def same(one, other):
    assert one.body_parts == other.body_parts
    assert len(one.recordings) == len(other.recordings)
    for a, b in zip(one.recordings, other.recordings, strict=True):
        assert (a.rate_hz, a.label, a.subject, a.trial, a.spans) == (b.rate_hz, b.label, b.subject, b.trial, b.spans)
        assert a.positions.dtype == b.positions.dtype == np.float32
        np.testing.assert_array_equal(a.positions, b.positions)


def refused(path):
    """The message of the one BadInput that reading `path` gives: a single line that begins with the file."""
    with pytest.raises(BadInput) as caught:
        read_archive(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message


def small(**changes):
    fields = {"positions": np.zeros((4, 3, 3), np.float32), "rate_hz": 15.0, "label": "wave"} | changes
    return MotionArchive(PARTS, (Recording(**({"subject": "1", "trial": "1"} | fields)),))


def test_reads_the_file_of_the_contract(tmp_path):
    archive = read_archive(saved(tmp_path))
    first, second = archive.recordings
    assert archive.body_parts == PARTS
    np.testing.assert_array_equal(first.positions[2, 1], [21, 22, 23])
    assert np.isnan(first.positions[1, 0]).all()
    assert (first.label, first.subject, first.rate_hz, first.spans) == ("wave", "1", 15.0, ())
    np.testing.assert_array_equal(second.positions[0, 0], [27, 28, 29])
    assert (second.label, second.subject) == ("", "2")
    assert second.spans == (Span(0, 1, "wave"), Span(1, 2, "bend"))


def test_writes_the_file_of_the_contract(tmp_path):
    archive = read_archive(saved(tmp_path))
    write_archive(tmp_path / "again.npz", archive)
    with np.load(tmp_path / "again.npz", allow_pickle=False) as file:
        assert set(file.files) == set(contract_arrays())
        for name, array in contract_arrays().items():
            assert file[name].dtype.kind == array.dtype.kind and file[name].shape == array.shape
        assert file["positions"].dtype == np.float32 and file["lengths"].dtype == np.int64
        assert file["span_label"].tolist() == ["wave", "bend"]


labels = st.text("abz09_", max_size=8)
words = st.text(st.characters(categories=("L", "N", "P", "S")), max_size=6)
numbers = st.floats(-1e6, 1e6, width=32) | st.just(float("nan"))


@st.composite
def recordings(draw):
    frames = draw(st.integers(1, 6))
    positions = draw(arrays(np.float32, (frames, 2, 3), elements=numbers))
    positions[draw(st.integers(0, frames - 1)), 0] = 0.5
    edges = sorted(draw(st.sets(st.integers(0, frames))))
    spans = tuple(Span(a, b, draw(labels.filter(bool))) for a, b in itertools.pairwise(edges))
    return Recording(positions, draw(st.floats(0.1, 1000)), draw(labels), draw(words), draw(words), spans)


@settings(max_examples=50)
@given(few=st.lists(recordings(), min_size=1, max_size=4))
def test_a_written_archive_is_read_unchanged(few, tmp_path_factory):
    path = tmp_path_factory.mktemp("archive") / "motion.npz"
    archive = MotionArchive(("left_hand", "head"), tuple(few))
    write_archive(path, archive)
    same(read_archive(path), archive)
    assert [entry.name for entry in path.parent.iterdir()] == ["motion.npz"]


INFINITE = contract_arrays()["positions"].copy()
INFINITE[4, 1, 2] = np.inf
UNSEEN = contract_arrays()["positions"].copy()
UNSEEN[3:] = np.nan


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": None}, "positions is missing"),
        ({"span_end": None}, "span_end is missing"),
        ({"labels": np.array(["wave", None], object)}, "labels: .*pickle"),
        ({"positions": np.zeros((5, 3, 3))}, "positions .*float64.*float32"),
        ({"lengths": np.array([3.0, 2.0])}, "lengths .*float64.*int64"),
        ({"labels": np.array([1, 2])}, "labels .*int64.*text"),
        ({"positions": np.zeros((5, 9), np.float32)}, r"positions .*\(5, 9\).*\(5, 3, 3\)"),
        ({"body_parts": np.array(["left_hand", "head"])}, r"positions .*\(5, 3, 3\).*\(5, 2, 3\)"),
        ({"body_parts": np.array(["head", "head", "head"])}, "body_parts .*each different"),
        ({"lengths": np.array([[3, 2]])}, r"lengths .*\(1, 2\)"),
        ({"lengths": np.array([3, 1])}, "lengths sum to 4.*5"),
        ({"lengths": np.array([5, 0])}, "lengths, recording 1: 0 frames"),
        ({"lengths": np.array([8, -3])}, "lengths, recording 0: 8 frames"),
        ({"lengths": np.array([2**62, 2**62 + 5])}, "lengths, recording 0"),
        ({"rate_hz": np.array(0.0)}, r"recording 0: rate_hz = 0.0.*positive"),
        ({"rate_hz": np.array(np.nan)}, "rate_hz = nan"),
        ({"rate_hz": np.array([15.0, np.inf])}, "recording 1: rate_hz = inf"),
        ({"rate_hz": np.array([15.0, 15.0, 15.0])}, r"rate_hz .*\(3,\).*\(2,\)"),
        ({"subjects": np.array(["1"])}, r"subjects .*\(1,\).*\(2,\)"),
        ({"subjects": np.array(["1", "a\nb"])}, r"recording 1: subject 'a\\nb'"),
        ({"labels": np.array(["wave", "High Wave"])}, "recording 1: label 'High Wave'.*lower case"),
        ({"positions": INFINITE}, "recording 1: positions, frame 1, body part 1: infinite"),
        ({"positions": UNSEEN}, "recording 1: .*no body part is seen"),
        ({"span_recording": np.array([1, 2])}, "span 1: 2; 0 to 1"),
        ({"span_end": np.array([3, 1])}, "recording 1: span 1: frames 1 to 3.*<= 2"),
        ({"span_start": np.array([2, 0])}, "recording 1: span 1: frames 2 to 2"),
        ({"span_start": np.array([-1, 0])}, "span 0: frames -1 to 2"),
        ({"span_end": np.array([2, 2])}, "span 1: starts at frame 1.*overlap"),
        ({"span_label": np.array(["bend", ""])}, "span 0: label ''"),
        ({"span_label": np.array(["bend"])}, r"span_recording .*\(2,\).*\(1,\)"),
        (
            {
                "positions": np.zeros((0, 3, 3), np.float32),
                "lengths": np.zeros(0, np.int64),
                **{name: np.zeros(0, "U1") for name in ("labels", "subjects", "trials", "span_label")},
                **{name: np.zeros(0, np.int64) for name in ("span_recording", "span_start", "span_end")},
            },
            "no recordings",
        ),
    ],
)
def test_a_broken_rule_is_named(changes, words, tmp_path):
    assert re.search(words, refused(saved(tmp_path, **changes)))


def test_files_of_other_formats(tmp_path):
    path = tmp_path / "motion.npz"
    assert "cannot be read: no such file" in refused(path)
    np.save(tmp_path / "one.npy", np.zeros(3))
    assert "not a whole .npz file" in refused(tmp_path / "one.npy")
    assert "cannot be read" in refused(tmp_path)
    with zipfile.ZipFile(path, "w") as file:
        for name in contract_arrays():
            file.writestr(f"{name}.npy", "no array")
    assert "cannot be read (positions: not an array)" in refused(path)


def test_a_truncated_file(tmp_path):
    whole = saved(tmp_path).read_bytes()
    path = tmp_path / "cut.npz"
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        assert "not a whole .npz file" in refused(path)


def test_a_damaged_file_is_read_completely_or_rejected_in_one_line(tmp_path):
    whole = saved(tmp_path).read_bytes()
    path = tmp_path / "damaged.npz"
    draw = np.random.default_rng(1)
    for place in draw.integers(0, len(whole), 200):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            read_archive(path)
        except BadInput as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)


@pytest.mark.parametrize(
    ("archive", "words"),
    [
        (MotionArchive((), small().recordings), "body_parts"),
        (small(spans=(Span(2, 3, "b"), Span(0, 1, "a"))), "in order"),
    ],
)
def test_an_invalid_archive_is_not_written(archive, words, tmp_path):
    with pytest.raises(BadInput, match=words):
        write_archive(tmp_path / "motion.npz", archive)
    assert not list(tmp_path.iterdir())


def test_a_link_is_written_through(tmp_path):
    (tmp_path / "link.npz").symlink_to(tmp_path / "target.npz")
    write_archive(tmp_path / "link.npz", small())
    assert (tmp_path / "link.npz").is_symlink() and (tmp_path / "target.npz").is_file()


@given(text=st.text())
def test_a_cleaned_label_is_a_label(text):
    assert is_label(clean_label(text)) and len(clean_label(text)) <= 64


@pytest.mark.parametrize(("text", "label"), [("Answer phone", "answer_phone"), (" High-Throw (2) ", "high_throw_2")])
def test_cleaned_labels(text, label):
    assert clean_label(text) == label


def tracks_arrays(**changes):
    """The contract's file as the tracks of one camera."""
    arrays = contract_arrays()
    tracks = {"positions": None, "tracks": arrays["positions"][..., :2].copy()}
    return tracks | {"camera": np.array("sofa")} | changes


def test_tracks_of_one_camera_are_read_and_written(tmp_path):
    archive = read_archive(saved(tmp_path, **tracks_arrays()))
    assert archive.camera == TracksCamera("sofa")
    np.testing.assert_array_equal(archive.recordings[0].positions[2, 1], [21, 22])
    write_archive(tmp_path / "again.npz", archive)
    again = read_archive(tmp_path / "again.npz")
    same(archive, again)
    assert again.camera == archive.camera
    assert read_archive(saved(tmp_path, **tracks_arrays(camera=None))).camera == TracksCamera()


def test_tracks_with_times_come_at_the_nominal_rate(tmp_path):
    times = np.array([5.0, 5.05, 5.2, 7.0, 7.2])
    first, second = read_archive(saved(tmp_path, **tracks_arrays(times_s=times, rate_hz=np.array(10.0)))).recordings
    assert first.positions.shape == (3, 3, 2) and second.positions.shape == (3, 3, 2)
    np.testing.assert_allclose(second.positions[1, 0], [31.5, 32.5])
    assert second.spans == (Span(0, 2, "wave"), Span(2, 3, "bend"))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"positions": np.zeros((5, 3, 3), np.float32)}, "has positions and tracks"),
        ({"tracks": np.zeros((5, 3, 3), np.float32)}, r"tracks has shape (5, 3, 3): (5, 3, 2) is expected"),
        ({"tracks": np.full((5, 3, 2), np.nan, np.float32)}, "tracks: no body part is seen in any frame"),
        ({"camera": np.array(["a", "b"])}, "camera has shape (2,)"),
        ({"times_s": np.array([0.0, 0.1, 0.1, 0, 1])}, "times_s, recording 0: seconds that rise"),
        ({"times_s": np.array([0.0, 0.1, 1e9, 0, 1])}, "times_s, recording 0: seconds that rise"),
        ({"times_s": np.array([0.0, 0.1])}, "times_s has shape (2,): (5,) is expected"),
    ],
)
def test_defects_of_tracks_are_named_in_one_line(tmp_path, changes, reason):
    assert reason in refused(saved(tmp_path, **tracks_arrays(**changes)))
