"""The examples of the documents work: scene files are read, code blocks run, extensions do what the page says."""

import threading
from pathlib import Path

import numpy as np
import pytest
from doc_pages import DOCS, ROOT, blocks

from common.config import read_scene
from common.vocabulary import Vocabulary
from labanmesh import main
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive, write_archive
from observer.motion.importers import csv_table
from observer.tracks import BODY_PARTS, Frame

REFERENCE = DOCS / "reference"
DESIGN = DOCS / "design"


def scene_files(page):
    return [text for text in blocks(page, "toml") if text.startswith("scene = ")]


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", *(page for page in sorted(DOCS.rglob("*.md")) if scene_files(page))],
    ids=lambda page: page.name,
)
def test_the_scene_files_of_the_documents_are_valid(page, tmp_path):
    for text in scene_files(page):
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        read_scene(tmp_path / "scene.toml", {})


def test_the_scene_file_of_init_begins_as_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "dojo.toml"]) == 0
    (shown,) = blocks(DOCS / "guide" / "doctor.md", "toml")
    written = Path("dojo.toml").read_text("utf-8")
    # The line about `labanmesh camera look` names the first camera of the machine.
    assert all(line in written for line in shown.splitlines() if "labanmesh camera look" not in line)


def test_the_observers_of_two_machines_see_from_where_the_models_of_the_demo_do(tmp_path):
    from studies.demo_scene import DEMO_CORNERS

    (text,) = [block for block in blocks(DOCS / "guide" / "operate.md", "toml") if 'scene = "demo"' in block]
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    observers = read_scene(tmp_path / "scene.toml", {}).observers
    assert {name: section.view for name, section in observers.items()}.items() <= DEMO_CORNERS.items()


def executed(text):
    names = {"__name__": "documented"}
    exec(compile(text, "docs", "exec"), names)  # noqa: S102 - the text is ours
    return names


def test_the_archive_example_is_written_and_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(REFERENCE / "motion.md", "python")
    executed(code)
    assert capsys.readouterr().out == "1 recording\n"
    assert read_archive(Path("mine.npz")).recordings[0].label == "stand"


def test_the_csv_example_is_imported(tmp_path):
    (table,) = blocks(REFERENCE / "motion.md", "csv")
    (tmp_path / "a.csv").write_text(table, encoding="utf-8")
    (recording,) = csv_table.import_files(tmp_path / "a.csv").archive.recordings
    assert recording.label == "wave" and recording.rate_hz == pytest.approx(30, rel=1e-3)
    assert np.isnan(recording.positions[2, 0]).all()


def test_the_worked_example_of_the_stacker_is_what_it_computes():
    from common.probability import softmax
    from observer.model.stacker import evidence, instant_of

    page = (DESIGN / "model.md").read_text("utf-8").split("| k | w_k |")[1].split("\n\n")[0]
    rows = [[cell.strip("* ").split("= ")[-1] for cell in line.split("|")[2:-1]] for line in page.splitlines()[2:]]
    weights, members = [float(row[0]) for row in rows[:5]], np.array([row[1:4] for row in rows[:5]], float)
    segment = np.log([[0.7, 0.2, 0.1], [0.4, 0.4, 0.2]])
    took = np.array([1.1, 1.8, 4.0]), np.array([0.8, 1.2, 0.6])
    instant = instant_of(np.array([0.6, 0.3, 0.1]), np.log([0.5, 0.25, 0.1, 0.15]), segment, *took, False, 0.5)
    assert members == pytest.approx(instant.members, abs=0.01)
    score = weights @ instant.members
    p = softmax(score)
    assert np.array([row[1:4] for row in rows[5:]], float) == pytest.approx(np.array([score, p]), abs=0.01)
    g = np.array([row[5:7] for row in rows[:6]], float)
    assert g[:, 1] == pytest.approx(evidence(instant, p), abs=0.01)
    odds = g[:, 0] @ evidence(instant, p)
    assert [float(cell) for cell in rows[6][5:7]] == pytest.approx([odds, 1 / (1 + np.exp(-odds))], abs=0.01)


def extension(name):
    (code,) = [text for text in blocks(DESIGN / "extend.md", "python") if name in text]
    return executed(code)


def test_the_example_of_a_model_recognises_movements(monkeypatch):
    from observer.geometry.views import parse_view
    from observer.learning.learn import learn_view
    from observer.model import registry
    from observer.motion.projected import ProjectedTracker, frames_of
    from observer.runtime.pipeline import Observer

    def hands_at(height, size, label):
        body = np.array([[-0.3, height, 0], [0.3, -0.7, 0], [0, 0, 0]], dtype=np.float32) * size
        return Recording(np.tile(body, (20, 1, 1)), 15.0, label, str(size), "1")

    monkeypatch.setattr(registry, "MODELS", {**registry.MODELS, "average": extension("class Average:")["Average"]})
    people = [hands_at(h, size, label) for h, label in ((0.3, "up"), (-0.7, "down")) for size in (1, 2)]
    door = parse_view("door")
    model = learn_view(MotionArchive(BODY_PARTS, tuple(people)), door, Vocabulary(("up", "down")), kind="average")
    observer = Observer(ProjectedTracker(door, BODY_PARTS, BODY_PARTS), model)
    opinions = [observer.step(frame) for frame in frames_of(hands_at(0.25, 1.5, "up"))]
    assert opinions[-1].p[0] > 0.8


@pytest.mark.parametrize("place", range(3))
def test_the_examples_of_tests_pass(place, laban_scene):
    names = executed(blocks(DOCS / "guide" / "testing.md", "python")[place])
    (test,) = [value for name, value in names.items() if name.startswith("test_")]
    test(laban_scene)


def test_the_other_examples_of_extensions_work(tmp_path, capsys):
    pooled = extension("quadratic_mean")["RULE"].pool(np.array([[0.6, 0.4], [0.6, 0.4]]), np.full(2, 0.5))
    assert pooled.p == pytest.approx([0.6, 0.4])
    np.save(tmp_path / "wave-anna-1.npy", np.zeros((4, 3, 3)))
    (recording,) = extension("import_files")["import_files"](tmp_path).archive.recordings
    assert (recording.label, recording.subject) == ("wave", "anna")
    polled = extension("class Polled")["Polled"](lambda: np.zeros((3, 3)), 1000.0)
    assert next(polled.frames(threading.Event())).content.shape == (3, 3)
    brightest = extension("class Brightest")["KIND"].build(None)
    lamp = np.zeros((8, 8, 3), np.uint8)
    assert not brightest.update(Frame(0, lamp)).visible.any()
    lamp[2, 5] = 255
    assert brightest.update(Frame(0, lamp)).centres.tolist() == [[5, 2]]
    assert "lamp" in extension("def lamp")
    write_archive(tmp_path / "a.npz", MotionArchive(BODY_PARTS, (recording,)))
    extension("def lengths")["lengths"](tmp_path / "a.npz")
    assert capsys.readouterr().out == "wave anna 0.1 s\n"
