"""`labanmesh import` and `labanmesh learn` as a person types them, with good input and with bad."""

import pytest

import labanmesh
from observer.model.model_file import read_model
from observer.motion.archive_file import read_archive, write_archive
from studies.performer import perform


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "people.npz"
    write_archive(path, perform(("1", "2"), ("ok", "shake"), trials=1))
    return path


def run(capsys, *words):
    status = labanmesh.main([str(word) for word in words])
    said = capsys.readouterr()
    return status, said.out, said.err


def csv_of(frames):
    head = "subject,trial,label,frame,time_s," + ",".join(
        f"{part}_{axis}" for part in ("left_hand", "right_hand", "head") for axis in "xyz"
    )
    rows = [f"1,1,ok,{n},{n / 10},0,1,0,0.1,1.{n},0,0,1.7,0" for n in range(frames)]
    return "\n".join([head, *rows]) + "\n"


def test_import_writes_an_archive_and_says_what_is_in_it(capsys, tmp_path):
    (tmp_path / "one.csv").write_text(csv_of(9))
    status, out, _ = run(capsys, "import", "csv", tmp_path / "one.csv", "-o", tmp_path / "one.npz")
    assert status == 0 and "1 recordings, 1 movements, 1 people, 9 frames at 10 Hz" in out
    assert read_archive(tmp_path / "one.npz").recordings[0].label == "ok"


def test_a_bad_import_leaves_nothing_behind(capsys, tmp_path):
    (tmp_path / "one.csv").write_text(csv_of(9).replace("1.5", "one"))
    status, _, err = run(capsys, "import", "csv", tmp_path / "one.csv", "-o", tmp_path / "one.npz")
    assert status == 2 and err.count("\n") == 1 and "one.csv" in err and "'one'" in err
    assert [p.name for p in tmp_path.iterdir()] == ["one.csv"]


def test_learn_writes_a_model_that_says_where_it_came_from(capsys, archive, tmp_path):
    model = tmp_path / "corner.model"
    words = ["learn", archive, "--view", "yaw:45,pitch:10", "-o", model, "--subjects", "1", "--rate", "30"]
    status, out, _ = run(capsys, *words)
    assert status == 0 and "phase for yaw:45,pitch:10, 2 movements from 2 examples of 1 people, 30 Hz" in out
    header = read_model(model).header
    assert (header.view, header.rate_hz, header.vocabulary.labels) == ("yaw:45,pitch:10", 30.0, ("ok", "shake"))
    assert header.provenance["archive"] == "people.npz" and len(header.provenance["archive_sha256"]) == 64
    assert header.provenance["subjects"] == "1"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--view", "dor"], "did you mean door?"),
        (["--view", "door", "--labels", "ok,jump"], "'jump': no recording shows it"),
        (["--view", "door", "--labels", "ok"], "at least two movements"),
        (["--view", "door", "--subjects", "7"], "subject '7': not in the archive; it has 1, 2"),
        (["--view", "door", "--model", "phaze"], "did you mean 'phase'"),
        (["--view", "door", "--rate", "0"], "--rate"),
        ([], "--view"),
    ],
)
def test_what_cannot_be_learned_is_one_line_and_exit_2(capsys, archive, tmp_path, words, said):
    status, _, err = run(capsys, "learn", archive, "-o", tmp_path / "a.model", *words)
    assert status == 2 and said in err and err.count("\n") == 1
    assert not (tmp_path / "a.model").exists()


def test_a_model_that_cannot_be_written_is_one_line(capsys, archive, tmp_path):
    status, _, err = run(capsys, "learn", archive, "--view", "door", "-o", tmp_path / "none" / "a.model")
    assert status == 2 and "a.model: cannot be written" in err and err.count("\n") == 1
