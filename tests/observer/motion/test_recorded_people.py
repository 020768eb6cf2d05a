"""Importers with recordings of real people, and with small invalid files."""

import builtins

import numpy as np
import pytest
from scipy.io import savemat

from common.errors import BadInput, LabanmeshError
from observer.motion.archive import check_archive
from observer.motion.archive_file import read_archive, write_archive
from observer.motion.importers import import_recordings
from observer.motion.label_sets import MSR_LABELS
from observer.tracks import WHOLE_BODY

LEFT, RIGHT, HEAD = range(3)
EXTRAS = ("spine", "left_wrist", "right_wrist", "left_ankle", "right_ankle")


def paths(recording):
    """(P,) metres that each body part goes."""
    return np.nansum(np.linalg.norm(np.diff(recording.positions, axis=0), axis=2), axis=0)


def sequence(frames=5, zeros=()):
    """The text of an MSR Action3D file: joint j of frame f at (j, f, 2)."""
    rows = np.array([[j, f, 2, 1] for f in range(frames) for j in range(1, 21)], float).reshape(frames, 20, 4)
    rows[list(zeros)] = 0
    return "".join(" ".join(f"{number:.6f}" for number in row) + "\n" for row in rows.reshape(-1, 4))


def test_msr_action3d(data, tmp_path):
    steps = []
    result = import_recordings("msr-action3d", data / "msr_action3d", lambda *step: steps.append(step))
    recordings = result.archive.recordings
    assert result.archive.body_parts == (*WHOLE_BODY, *EXTRAS)
    assert len(recordings) == 553 and len(result.notes) == 14 and steps[-1] == (567, 567)
    assert "left out a07_s04_e01: 80 % of its frames are empty" in result.notes
    assert {recording.label for recording in recordings} == set(MSR_LABELS)
    assert {recording.subject for recording in recordings} == set(map(str, range(1, 11)))
    assert {recording.trial for recording in recordings} == {"1", "2", "3"}
    assert {recording.rate_hz for recording in recordings} == {15.0}
    assert sum(np.isnan(recording.positions).any() for recording in recordings) == 6
    write_archive(tmp_path / "msr.npz", result.archive)
    assert len(read_archive(tmp_path / "msr.npz").recordings) == 553


def assert_upright(body_parts, places):
    """The median places of a standing person are in order: from the top down, and from left to right."""
    at = dict(zip(body_parts, places, strict=True))
    arm = ("head", "{side}_shoulder", "{side}_elbow", "{side}_wrist", "{side}_hand")
    leg = ("head", "neck", "spine", "{side}_hip", "{side}_knee", "{side}_ankle", "{side}_foot")
    for side in ("left", "right"):
        for chain in (arm, leg):
            heights = [at[name][1] for name in (part.format(side=side) for part in chain) if name in at]
            assert (np.diff(heights) < 0).all(), chain
    for part in {name.partition("_")[2] for name in at if name.startswith("left")}:
        assert at[f"left_{part}"][0] < at[f"right_{part}"][0], part


def test_florence3d(data):
    result = import_recordings("florence3d", data / "florence3d")
    check_archive(result.archive)
    recordings = result.archive.recordings
    body_parts = result.archive.body_parts
    assert len(recordings) == 215 and set(body_parts) == {*WHOLE_BODY, "spine"} - {"pelvis"}
    assert_upright(body_parts, np.median([np.median(r.positions[:3], axis=0) for r in recordings], axis=0))
    names = {"wave", "drink", "answer_phone", "clap", "tight_lace", "sit_down", "stand_up", "read_watch", "bow"}
    assert {recording.label for recording in recordings} == names
    assert len({(r.label, r.subject, r.trial) for r in recordings}) == 215
    assert {recording.subject for recording in recordings} == set(map(str, range(1, 11)))
    claps = [r.positions for r in recordings if r.label == "clap"]
    assert np.median([np.min(p[:, LEFT, 2] - p[:, HEAD, 2]) for p in claps]) < -0.2


def test_effort_bvh(data):
    result = import_recordings("bvh", data / "effort_bvh")
    recordings = result.archive.recordings
    assert len(recordings) == 97 and {recording.rate_hz for recording in recordings} == {30.0, 60.0}
    assert {recording.label for recording in recordings} == {"pointing", "throwing", "waving"}
    assert len({(recording.label, recording.trial) for recording in recordings}) == 97
    assert result.notes == ("BVH states no unit: took metres (97 of 97 files)",)
    assert result.archive.body_parts == WHOLE_BODY
    # One hand is raised.
    assert_upright(WHOLE_BODY[2:3] + WHOLE_BODY[5:], np.delete(recordings[0].positions[0], (0, 1, 3, 4), axis=0))
    for recording in recordings:
        left, right, *_ = paths(recording)
        assert right > left or recording.label == "waving"
        assert recording.positions[0, LEFT, 0] < recording.positions[0, HEAD, 0] < recording.positions[0, RIGHT, 0]
        assert 1.4 < recording.positions[0, HEAD, 1] < 2.2
        assert np.min(recording.positions[:, RIGHT, 2] - recording.positions[:, HEAD, 2]) < -0.3


def test_joints_and_empty_frames_of_msr_action3d(tmp_path):
    (tmp_path / "a02_s10_e03_skeleton3D.txt").write_text(sequence(10, zeros=[4, 5, 6]))
    (tmp_path / "a01_s01_e01_skeleton3D.txt").write_text(sequence(10, zeros=[4, 5, 6, 7]))
    result = import_recordings("msr-action3d", tmp_path)
    assert result.notes == ("left out a01_s01_e01: 40 % of its frames are empty",)
    (recording,) = result.archive.recordings
    assert (recording.label, recording.subject, recording.trial) == ("horizontal_arm_wave", "10", "3")
    joints = (12, 13, 20, 8, 9, 1, 2, 3, 7, 5, 6, 14, 15, 18, 19, 4, 10, 11, 16, 17)
    np.testing.assert_array_equal(recording.positions[9], [[joint, 9, 2] for joint in joints])
    assert np.flatnonzero(np.isnan(recording.positions).all(axis=(1, 2))).tolist() == [4, 5, 6]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a21_s01_e01", sequence(), "action 21 in its name; 1 to 20"),
        ("a01_s11_e01", sequence(), "subject 11"),
        ("a01_s01_e04", sequence(), "trial 4"),
        ("a1_s1_e1", sequence(), "the name of a sequence is expected"),
        ("a01_s01_e01", "", "is empty"),
        ("a01_s01_e01", sequence()[:-200], "line .*(values|ends within frame)"),
        ("a01_s01_e01", "".join(sequence().splitlines(keepends=True)[:-3]), "line 97: ends within frame 4; 20 lines"),
        ("a01_s01_e01", sequence().replace("7.000000 2.000000", "nan 2.000000", 1), "line 47: 'nan'"),
        ("a01_s01_e01", sequence().replace("2.000000 1.000000", "2.000000", 1), "line 1: 3 values; 4"),
        ("a01_s01_e01", sequence().replace("2.000000", "1e40", 1), "line 1: '1e40'"),
        ("a01_s01_e01", sequence(5, range(5)), "nothing remains"),
    ],
)
def test_an_invalid_file_of_msr_action3d(name, text, words, tmp_path):
    (tmp_path / f"{name}_skeleton3D.txt").write_text(text)
    with pytest.raises(BadInput, match=words) as caught:
        import_recordings("msr-action3d", tmp_path)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_sequence_in_two_folders(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a01_s01_e01_skeleton3D.txt").write_text(sequence())
    with pytest.raises(BadInput, match="the same sequence as"):
        import_recordings("msr-action3d", tmp_path)


def clip(**changes):
    return {"original_skeletal_data": np.zeros((3, 15, 4)), "subject": 1, "action": 2} | changes


def florence(tmp_path, *clips, names=("wave", "answer phone")):
    cells = np.empty((len(clips), 1), object)
    cells[:, 0] = clips
    savemat(tmp_path / "skeletal_data.mat", {"skeletal_data": cells})
    savemat(tmp_path / "action_names.mat", {"action_names": np.array(names, object)})
    return tmp_path


def test_axes_and_trials_of_florence3d(tmp_path):
    joints = np.zeros((3, 15, 4))
    joints[:, 0, 3] = (1, 2, 3)
    joints[:, 5, 3] = (4, 5, 6)
    joints[:, 8, 3] = (7, 8, 9)
    florence(tmp_path, clip(original_skeletal_data=joints), clip(), clip(subject=3))
    result = import_recordings("florence3d", tmp_path)
    np.testing.assert_array_equal(result.archive.recordings[0].positions[3, :3], [[4, 6, 5], [7, 9, 8], [1, 3, 2]])
    named = [(recording.label, recording.subject, recording.trial) for recording in result.archive.recordings]
    assert named == [("answer_phone", "1", "1"), ("answer_phone", "1", "2"), ("answer_phone", "3", "1")]
    assert len(import_recordings("florence3d", tmp_path / "skeletal_data.mat").archive.recordings) == 3


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"action": 3}, "clip 2: action 3: a whole number from 1 to 2"),
        ({"action": 0}, "clip 2: action 0"),
        ({"action": "wave"}, "clip 2: action 'wave'"),
        ({"subject": 0}, "clip 2: subject 0"),
        ({"subject": np.zeros((40, 40))}, "clip 2: subject"),
        ({"original_skeletal_data": np.zeros((3, 20, 4))}, r"clip 2: .*\(3, 20, 4\)"),
        ({"original_skeletal_data": np.full((3, 15, 4), np.nan)}, "clip 2: frame 0: .*not finite"),
        ({"original_skeletal_data": "text"}, "clip 2: "),
    ],
)
def test_an_invalid_clip_of_florence3d(changes, words, tmp_path):
    with pytest.raises(BadInput, match=words) as caught:
        import_recordings("florence3d", florence(tmp_path, clip(), clip(**changes)))
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)


def test_missing_parts_of_florence3d(tmp_path):
    def refused(words):
        with pytest.raises(BadInput, match=words):
            import_recordings("florence3d", tmp_path)

    florence(tmp_path, clip(), {"subject": 1, "action": 1})
    refused("clip 2: field original_skeletal_data is missing")
    florence(tmp_path, clip(), names=("wave", "Wave "))
    refused("different names")
    florence(tmp_path, clip())
    savemat(tmp_path / "skeletal_data.mat", {"other": 1})
    refused("variable skeletal_data is missing")
    whole = (tmp_path / "action_names.mat").read_bytes()
    (tmp_path / "action_names.mat").write_bytes(whole[: len(whole) // 2])
    refused("cannot be read|is missing")
    (tmp_path / "action_names.mat").unlink()
    refused("action_names.mat: no such file")


def test_without_scipy_the_error_names_the_extra(tmp_path, monkeypatch):
    florence(tmp_path, clip())
    real = builtins.__import__

    def without(name, *rest):
        if name.startswith("scipy"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(LabanmeshError, match=r"pip install 'labanmesh\[observer\]'"):
        import_recordings("florence3d", tmp_path)
