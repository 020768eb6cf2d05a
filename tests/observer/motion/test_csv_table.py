"""CSV tables: a valid one by hand, and each defect with its line."""

import numpy as np
import pytest

from common.errors import BadInput
from observer.motion.importers.csv_table import import_files

HEAD = (
    "subject,trial,label,frame,time_s,left_hand_x,left_hand_y,left_hand_z,"
    "right_hand_x,right_hand_y,right_hand_z,head_x,head_y,head_z"
)
GOOD = f"""{HEAD}
anna,1,wave,0,0.00,-0.2,1,0,0.2,1,0,0,1.6,0
anna,1,wave,1,0.05,-0.2,1,0,0.3,1.5,0,0,1.6,0
anna,1,wave,2,0.10,,,,0.4,1.2,-0.1,0,1.6,0
anna,2,,7,5.0,-0.2,1,0,0.2,1,0,0,1.6,0
anna,2,,8,5.1,-0.2,1,0,0.2,1,0,0,1.6,0
"""


def table(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text,
        lambda text: "\ufeff" + text.replace("\n", "\r\n"),
        lambda text: text.replace("anna", '"anna"') + "\n\n",
        lambda text: text.replace(",", " , "),
    ],
    ids=["plain", "spreadsheet", "quoted", "spaced"],
)
def test_a_valid_table(change, tmp_path):
    result = import_files(table(tmp_path, change(GOOD)))
    first, second = result.archive.recordings
    assert (first.subject, first.trial, first.label, first.rate_hz) == ("anna", "1", "wave", 20.0)
    assert (second.subject, second.trial, second.label, second.rate_hz) == ("anna", "2", "", 10.0)
    assert first.positions.shape == (3, 3, 3) and len(second.positions) == 2
    np.testing.assert_array_equal(first.positions[1, 1], np.float32([0.3, 1.5, 0]))
    np.testing.assert_array_equal(np.isnan(first.positions[2]).all(axis=1), [True, False, False])


def test_a_table_of_other_body_parts(tmp_path):
    feet = "".join(f",{side}_foot_{axis}" for side in ("left", "right") for axis in "xyz")
    lines = [line + ("" if n else feet) + ",1,2,3,,," * (n > 0) for n, line in enumerate(GOOD.splitlines())]
    archive = import_files(table(tmp_path, "\n".join(lines))).archive
    assert archive.body_parts == ("left_hand", "right_hand", "head", "left_foot", "right_foot")
    first = archive.recordings[0].positions
    assert first.shape == (3, 5, 3) and first[2, 3].tolist() == [1, 2, 3] and np.isnan(first[:, 4]).all()
    (tmp_path / "wider.csv").write_text(GOOD)
    with pytest.raises(BadInput, match=r"wider.csv: contains left_hand, right_hand, head, but .*the same parts"):
        import_files(tmp_path)


def test_a_folder_of_tables(tmp_path):
    (tmp_path / "below").mkdir()
    for name in ("b.csv", "a.CSV"):
        (tmp_path / "below" / name).write_text(GOOD.replace("anna", name[0]))
    steps = []
    result = import_files(tmp_path, lambda done, total: steps.append((done, total)))
    assert [recording.subject for recording in result.archive.recordings] == ["a", "a", "b", "b"]
    assert steps == [(1, 2), (2, 2)]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("left_hand_x", "left_x", "line 1: the header"),
        (HEAD, HEAD.replace(",", ";"), "line 1: the header"),
        (HEAD, HEAD.replace(",head_z", ",nose_z"), "line 1: the header"),
        (HEAD, HEAD[: HEAD.index(",left")], "line 1: the header"),
        (GOOD[len(HEAD) + 1 :], "", "no rows under the header"),
        ("anna,1,wave,1,0.05,", "anna,1,wave,1,", "line 3: 13 cells; 14"),
        ("0.3,1.5", "0.3,high", "line 3: right_hand_y: 'high'"),
        ("0.3,1.5", "0.3,", "line 3: right_hand: three coordinates"),
        ("wave,1,0.05", "wave,3,0.05", "line 3: frame 3: 1 is expected"),
        ("wave,1,0.05", "wave,1,soon", "line 3: time_s: 'soon'"),
        ("wave,1,0.05", "wave,1,0.051", "line .: time_s grows by .*within 1 %"),
        ("wave,2,0.10", "wave,2,-0.10", "time_s grows by"),
        ("7,5.0", "7,5.1", "line 6: time_s grows by 0"),
        ("anna,1,wave,2,0.10", "anna,1,Big Wave,2,0.10", "line 4: label 'Big Wave': .*such as big_wave"),
        ("anna,1,wave,2,0.10", "anna,1,bow,2,0.10", "line 4: the only row"),
        ("anna,2,,7", ",2,,7", "line 5: subject ''"),
        ("anna,2,,8,5.1", "anna,1,wave,8,5.1", "line 5: the only row"),
        ("anna,2,,7", '"an"na,2,,7', "line 5: "),
        ("anna,2,,7", "an\0na,2,,7", "line 5: "),
    ],
)
def test_a_defect_is_named_with_its_line(old, new, words, tmp_path):
    assert GOOD.count(old) == 1
    path = table(tmp_path, GOOD.replace(old, new))
    with pytest.raises(BadInput, match=words) as caught:
        import_files(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_rows_of_one_recording_must_be_consecutive(tmp_path):
    rows = GOOD.splitlines(keepends=True)
    with pytest.raises(BadInput, match=r"line 7: subject 'anna', trial '1', label 'wave' began on line 2"):
        import_files(table(tmp_path, GOOD + "".join(rows[1:4])))


def test_a_recording_without_any_visible_part(tmp_path):
    unseen = "".join(f"bert,1,bow,{i},{i / 10},,,,,,,,,\n" for i in range(3))
    with pytest.raises(BadInput, match=r"lines 7 to 9: .*no body part is seen"):
        import_files(table(tmp_path, GOOD + unseen))
