"""Takes that were set aside: no lesson loses those of another, and they can be listed, restored and forgotten."""

import numpy as np
import pytest

from common.errors import BadInput, LabanmeshError
from common.teaching_messages import EARLIER_LIMIT, Unwanted
from observer.motion.archive import Recording, TracksCamera
from observer.motion.archive_file import read_archive
from observer.teaching.takes_file import TakesFile
from observer.tracks import BODY_PARTS

LABELS, TYPO = ["wave", "point"], ["wave", "pont"]
POSITIONS = np.zeros((9, len(BODY_PARTS), 2), np.float32)


@pytest.fixture
def takes(tmp_path):
    return TakesFile(tmp_path / "sofa.tracks.npz", BODY_PARTS, TracksCamera("sofa"))


def add(takes, *labels, subject="anna"):
    for label in labels:
        takes.add(Recording(POSITIONS, 15.0, label, subject, str(takes.free_take(label))))


def start(takes, labels, lesson, add=False):
    takes.start(labels, add=add, lesson=lesson)


def held(takes):
    """The takes of now, and those of each earlier set."""
    return takes.takes, {each.id: each.takes for each in takes.earlier}


def test_a_start_with_a_typo_loses_nothing_and_the_right_words_go_on(takes):
    start(takes, LABELS, "l1")
    add(takes, *LABELS * 5)
    start(takes, TYPO, "l2")
    add(takes, "pont")
    start(takes, LABELS, "l3")
    assert held(takes) == ({"wave": [1, 2, 3, 4, 5], "point": [1, 2, 3, 4, 5]}, {"l3": {"pont": 1}})
    # The typo's lesson had not ended either.
    assert takes.earlier[0].labels == TYPO and takes.earlier[0].at_ns > 0
    start(takes, TYPO, "l4"), start(takes, LABELS, "l5")
    assert held(takes) == ({"wave": [1, 2, 3, 4, 5], "point": [1, 2, 3, 4, 5]}, {"l5": {"pont": 1}})


def test_a_set_stays_until_a_lesson_with_its_movements_has_ended_well_and_the_newest_in_any_case(takes):
    start(takes, LABELS, "l1"), add(takes, *LABELS), takes.finish()
    start(takes, ["nod", "bow"], "l2"), add(takes, "nod", "bow"), takes.finish()
    assert held(takes)[1] == {"l2": {"wave": 1, "point": 1}}
    start(takes, ["bow", "nod"], "l3"), add(takes, "nod"), takes.finish()
    assert list(held(takes)[1]) == ["l2", "l3"], "neither is of these movements alone, or the newest"
    start(takes, [*LABELS, "clap"], "l4"), add(takes, "clap"), takes.finish()
    assert held(takes)[1] == {"l3": {"nod": 1, "bow": 1}, "l4": {"nod": 1}}, "wave and point were taught again"


def test_an_earlier_set_is_restored_once_however_often_it_is_asked_for(takes):
    start(takes, LABELS, "l1"), add(takes, *LABELS), takes.finish()
    start(takes, ["nod", "bow"], "l2"), add(takes, "nod")
    with pytest.raises(BadInput, match=r"no earlier takes '?x.*known: l2"):
        takes.restore("x", "l3")
    takes.restore("l2", "l3")
    takes.restore("l2", "l3")
    assert held(takes) == ({"wave": [1], "point": [1]}, {"l3": {"nod": 1}})
    start(takes, LABELS, "l4")
    assert takes.takes == {"wave": [1], "point": [1]}, "the lesson goes on with them"


def test_of_too_many_sets_the_one_with_the_fewest_takes_goes(takes):
    start(takes, LABELS, "best"), add(takes, *LABELS)
    for n in range(EARLIER_LIMIT + 2):
        start(takes, TYPO, f"l{n}", add=True), takes.finish(), start(takes, [f"m{n}", "nod"], f"k{n}")
        add(takes, "nod")
    sets = held(takes)[1]
    assert len(sets) == EARLIER_LIMIT and sets["k0"] == {"wave": 1, "point": 1}


def test_forgetting_reaches_every_set_and_the_one_of_an_earlier_version(takes):
    start(takes, LABELS, "l1"), add(takes, *LABELS, subject="ben"), add(takes, "wave")
    start(takes, TYPO, "l2"), add(takes, *TYPO)
    for suffix in (".npz", ".json"):
        takes.path.with_suffix(suffix).replace(takes.path.with_suffix(f".before{suffix}"))
    takes = TakesFile(takes.path, BODY_PARTS, TracksCamera("sofa"))
    assert held(takes) == ({}, {"l2": {"wave": 2, "point": 1}, "before": {"wave": 1, "pont": 1}})
    assert len(takes.forget(Unwanted(person="anna"))) == 3
    assert held(takes) == ({}, {"l2": {"wave": 1, "point": 1}})
    assert not takes.path.with_suffix(".before.json").exists()
    assert len(takes.forget(Unwanted(label="point"))) == 1 and held(takes)[1] == {"l2": {"wave": 1}}
    broken = takes.path.with_name("sofa.tracks.before-x.npz")
    broken.write_bytes(b"PK")
    with pytest.raises(LabanmeshError, match="before-x"):
        takes.forget(Unwanted(person="ben"))
    assert held(takes)[1] == {"x": {}}, "what can be read is forgotten all the same"
    takes.forget(Unwanted(everything=True))
    assert list(takes.path.parent.iterdir()) == []


def test_on_a_disk_without_space_what_is_forgotten_goes_and_the_rest_waits(takes, monkeypatch, full_disk):
    start(takes, LABELS, "l1"), add(takes, *LABELS, subject="ben"), add(takes, "wave")

    full_disk()
    with pytest.raises(LabanmeshError):
        add(takes, "point")
    assert takes.drop("point", "2") == 1 and takes.drop("wave", "1") == 1
    assert not takes.path.exists() and takes.persons == {"anna": {"wave": 1}, "ben": {"point": 1}}
    assert len(takes.forget(Unwanted(person="anna"))) == 1
    monkeypatch.undo()
    takes.write_waiting()
    assert [(r.label, r.subject) for r in read_archive(takes.path).recordings] == [("point", "ben")]


def test_nobody_else_may_read_what_teaching_leaves(takes):
    start(takes, LABELS, "l1"), add(takes, "wave"), start(takes, TYPO, "l2"), add(takes, "wave")
    paths = sorted(takes.path.parent.iterdir())
    assert len(paths) == 4 and {path.stat().st_mode & 0o777 for path in paths} == {0o600}
    for path in paths:
        path.chmod(0o644)
    TakesFile(takes.path, BODY_PARTS, TracksCamera("sofa"))
    assert {path.stat().st_mode & 0o777 for path in paths} == {0o600}, "files of an earlier version, too"
