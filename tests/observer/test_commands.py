"""`labanmesh import` and `labanmesh learn` on the command line, with valid and with invalid input."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from observer.model.model_file import read_model
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive_file import read_archive, write_archive
from studies.performer import perform


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "people.npz"
    write_archive(path, perform(("1", "2"), ("ok", "shake"), trials=1))
    return path


def csv_of(frames):
    head = "subject,trial,label,frame,time_s," + ",".join(
        f"{part}_{axis}" for part in ("left_hand", "right_hand", "head") for axis in "xyz"
    )
    rows = [f"1,1,ok,{n},{n / 10},0,1,0,0.1,1.{n},0,0,1.7,0" for n in range(frames)]
    return "\n".join([head, *rows]) + "\n"


def test_import_writes_an_archive_and_counts_its_contents(run, tmp_path):
    (tmp_path / "one.csv").write_text(csv_of(9))
    status, out, _ = run("import", "csv", tmp_path / "one.csv", "-o", tmp_path / "one.npz")
    assert status == 0 and "1 recording, 1 movement, 1 person, 9 frames at 10 Hz" in out
    assert read_archive(tmp_path / "one.npz").recordings[0].label == "ok"


def test_a_failed_import_writes_nothing(run, tmp_path):
    (tmp_path / "one.csv").write_text(csv_of(9).replace("1.5", "one"))
    status, _, err = run("import", "csv", tmp_path / "one.csv", "-o", tmp_path / "one.npz")
    assert status == 2 and err.count("\n") == 1 and "one.csv" in err and "'one'" in err
    assert [p.name for p in tmp_path.iterdir()] == ["one.csv"]


QUICK = ("--parameter", "kernels=336")


def test_learn_writes_a_model_with_its_provenance(run, archive, tmp_path):
    model = tmp_path / "corner.model"
    words = ["learn", archive, "--view", "yaw:45,pitch:10", "-o", model, "--subjects", "1", "--rate", "30", *QUICK]
    status, out, _ = run(*words)
    assert status == 0 and f"{DEFAULT_MODEL} for yaw:45,pitch:10, 2 movements from 2 examples of 1 person, 30 Hz" in out
    header = read_model(model).header
    assert (header.view, header.rate_hz, header.vocabulary.labels) == ("yaw:45,pitch:10", 30.0, ("ok", "shake"))
    assert header.provenance["archive"] == "people.npz" and len(header.provenance["archive_sha256"]) == 64
    assert header.provenance["subjects"] == "1"


def test_learn_writes_a_model_for_each_sensor_with_one_vocabulary(run, archive, tmp_path):
    whole = read_archive(archive)
    write_archive(tmp_path / "other.npz", replace(whole, recordings=whole.recordings[::-1]))
    words = ["learn", "--sensor", f"left={archive}", "--sensor", f"right={tmp_path}/other.npz@wheel"]
    status, out, err = run(*words, "-o", tmp_path / "models", "--body-parts", "right_hand,head", "--jobs", "2", *QUICK)
    assert status == 0 and out.count("2 movements from 4 examples") == 2 and "learning: 2 of 2" in err
    assert out.index("left.model") < out.index("right.model")
    left, right = (read_model(tmp_path / "models" / f"{name}.model").header for name in ("left", "right"))
    assert (left.view, right.view) == ("door", "wheel") and left.vocabulary == right.vocabulary
    assert left.body_parts == ("right_hand", "head") and right.provenance["archive"] == "other.npz"
    few = tuple(r for r in whole.recordings if r.label == "ok")
    write_archive(tmp_path / "other.npz", replace(whole, recordings=few))
    for more, error in (
        ([], "--sensor right: no recording shows shake; record it with this sensor too, or leave it out: --labels ok"),
        ([archive], "--sensor: takes the place of ARCHIVE and --view"),
        (["--effort"], "--sensor: only for new models of movements"),
    ):
        status, _, err = run(*words, *more, "-o", tmp_path / "models")
        assert status == 2 and error in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--view", "dor"], "did you mean door?"),
        (["--view", "door", "--labels", "shak"], "shak: no recording shows this movement; did you mean shake?"),
        (["--view", "door", "--labels", "ok,AS1"], "--labels horizontal_arm_wave: no recording shows this movement"),
        (["--view", "door", "--labels", "ok"], "at least two movements"),
        (["--view", "door", "--subjects", "7"], "subject '7': not in the archive; it has 1, 2"),
        (["--view", "door", "--model", "phaze"], "did you mean phase?"),
        (["--view", "door", "--rate", "0"], "--rate"),
        ([], "--view"),
    ],
)
def test_what_cannot_be_learned_is_one_line_and_exit_2(run, archive, tmp_path, words, error):
    status, _, err = run("learn", archive, "-o", tmp_path / "a.model", *words)
    assert status == 2 and error in err and err.count("\n") == 1
    assert not (tmp_path / "a.model").exists()


@pytest.mark.parametrize(
    ("kind", "parameter", "error"),
    [
        ("phase", "begin=5", "parameter begin = 5: a number from 0 to 1 is expected"),
        ("phase", "fast=nan", "parameter fast = nan: a number from 1e-06 to 1e+06 is expected"),
        ("phase", "facings=1.5", "facings = 1.5: a whole number from 1 to 72 is expected"),
        ("phase", "fats=1", "parameter 'fats': not of the model phase; did you mean fast?"),
        ("stacked", "kernels=10", "parameter kernels = 10: a whole number from 84 to 20000 is expected"),
        ("frame-table", "bins=inf", "parameter bins = inf: a whole number from 1 to 1000 is expected"),
    ],
)
def test_a_parameter_outside_its_range_is_one_line_and_exit_2(run, archive, tmp_path, kind, parameter, error):
    words = ["--view", "door", "--model", kind, "--parameter", parameter]
    status, _, err = run("learn", archive, "-o", tmp_path / "a.model", *words)
    assert status == 2 and error in err and err.count("\n") == 1


def test_a_model_that_cannot_be_written_is_refused_before_it_is_learned(run, archive, tmp_path, monkeypatch):
    monkeypatch.setattr("observer.learning.learn.learn_view", None)
    status, _, err = run("learn", archive, "--view", "door", "-o", tmp_path / "none" / "a.model")
    assert status == 2 and "none/a.model: no such file or directory. Choose another path with -o" in err


def test_the_error_of_a_model_that_cannot_be_written_names_a_way_out(run, archive, tmp_path, monkeypatch):
    learn = ["learn", archive, "--view", "door", "--model", "phase", "-o"]
    status, _, err = run(*learn, tmp_path / "none" / "a.model")
    assert status == 2 and err.count("\n") == 1
    assert f"cannot write {tmp_path}/none/a.model: no such file or directory. Choose another path with -o" in err
    status, _, err = run(*learn, tmp_path)
    assert status == 2 and f"cannot write {tmp_path}: is a directory. Choose another path with -o" in err

    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("observer.files.replace_file", denied)
    status, _, err = run(*learn, tmp_path / "a.model")
    assert status == 2
    assert err == f"labanmesh: cannot write {tmp_path}/a.model: permission denied. Choose another path with -o\n"


def test_a_pipe_or_a_device_is_written_to_and_not_replaced(run, archive, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        status, _, _ = run("import", "csv", _small_csv(tmp_path), "-o", pipe)
        assert status == 0 and pipe.is_fifo() and os.read(reader, 2) == b"PK"
    finally:
        os.close(reader)
    status, out, _ = run("learn", archive, "--view", "door", "--model", "phase", "-o", "/dev/null")
    assert status == 0 and "/dev/null: phase for door" in out and Path("/dev/null").is_char_device()


def _small_csv(folder):
    (folder / "small.csv").write_text(csv_of(2))
    return folder / "small.csv"
