"""The contract of importers, checked for every kind in the registry."""

import re

import numpy as np
import pytest

from common.errors import BadInput
from observer.motion.importers import IMPORTERS, import_recordings
from observer.tracks import BODY_PARTS

FILES = ("a01_s01_e01_skeleton3D.txt", "skeletal_data.mat", "action_names.mat",
         "wave.bvh", "wave.csv", "wave.c3d", "wave.trc", "wave.npz")  # fmt: skip
"""Names that some importer reads."""
FOLDERS = {"msr-action3d": "msr_action3d", "florence3d": "florence3d", "bvh": "effort_bvh"}

CONTENTS = {
    "empty": b"",
    "zeros": bytes(4096),
    "noise": np.random.default_rng(7).bytes(4096),
    "words": b"nothing that moves\n" * 20,
    "numbers": b"1 2 3\n" * 400,
    "not finite": b"nan nan nan nan\n" * 400,
}


def refused(kind, path):
    with pytest.raises(BadInput) as caught:
        import_recordings(kind, path)
    message = str(caught.value)
    assert "\n" not in message and "expected" in message and len(message) < 500
    return message


@pytest.mark.parametrize("kind", IMPORTERS)
def test_a_path_without_recordings_is_named(kind, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("nothing that moves\n")
    for name in ("nowhere", "empty", "notes.txt"):
        assert str(tmp_path / name) in refused(kind, tmp_path / name)


@pytest.mark.parametrize("contents", CONTENTS)
@pytest.mark.parametrize("kind", IMPORTERS)
def test_a_broken_file_is_named(kind, contents, tmp_path):
    for name in FILES:
        (tmp_path / name).write_bytes(CONTENTS[contents])
    message = refused(kind, tmp_path)
    assert any(str(tmp_path / name) in message for name in FILES)


@pytest.mark.parametrize("kind", IMPORTERS)
def test_recorded_people_have_the_axes_of_the_archive(kind, data):
    if kind not in FOLDERS:
        pytest.skip(f"no recordings of kind {kind} among the data")
    steps = []
    result = import_recordings(kind, data / FOLDERS[kind], lambda done, total: steps.append((done, total)))
    assert result.archive.body_parts[:3] == BODY_PARTS and len(result.archive.body_parts) >= 15
    assert [done for done, _ in steps] == list(range(1, steps[-1][1] + 1))
    assert all(note and "\n" not in note for note in result.notes)
    everything = np.concatenate([recording.positions for recording in result.archive.recordings])
    left, right, head = np.nanmedian(everything[:, :3], axis=0)
    assert left[0] < right[0] and head[1] > max(left[1], right[1])
    assert np.nanmean(everything[:, :2, 2]) < np.nanmean(everything[:, 2, 2]), "hands work before the body"


@pytest.mark.parametrize(
    ("kind", "hint"), [("bhv", "did you mean bvh?"), ("CSV", "did you mean csv?"), ("xyzzy", "known: msr-action3d")]
)
def test_an_unknown_kind_names_the_nearest_or_all(kind, hint, tmp_path):
    with pytest.raises(BadInput, match=re.escape(f"kind '{kind}': unknown; {hint}")):
        import_recordings(kind, tmp_path)
