"""Teaching as one observer sees it: what a teacher asks, and what is on the disk then. No network and no clock."""

import numpy as np
import pytest

from common import SECOND_NS
from common.teaching_messages import LearnedReport, TeachRequest
from common.vocabulary import RESERVED
from common.wire import encode
from observer.learning.taught_takes import doubtful_takes
from observer.motion.archive import Recording, TracksCamera
from observer.motion.archive_file import read_archive
from observer.recording.own_tracks import TracksRecorder
from observer.teaching.takes_file import TakesFile
from observer.teaching.teaching import Teaching
from observer.tracks import BODY_PARTS, Frame, Outline, SeenPeople, Tracks

REST = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])
RATE_HZ = 20


class FakeLearner:
    def __init__(self):
        self.busy, self.fault, self.learned, self.asked, self.adopted = False, "", None, [], []
        self.known, self.forgotten = set(), []
        self.references, self.shown = frozenset(), []

    def learn(self, labels, references=()):
        self.asked.append(list(labels))
        self.shown.append(list(references))
        self.learned = LearnedReport(labels=list(labels), results={"wave": {"wave": 5}})

    def adopt(self, in_s):
        self.adopted.append(in_s)
        self.learned = None

    def knows(self, unwanted):
        return unwanted.everything or bool({unwanted.person, unwanted.label} & self.known)

    def forget(self, unwanted, *, in_force):
        self.forgotten.append(in_force)
        return int(in_force)


class Room:
    """One observer and the person in front of it; time passes only in `pass_s`."""

    def __init__(self, folder, refusal=""):
        self.path, self.learner, self.refusal = folder / "sofa.tracks.npz", FakeLearner(), refusal
        self.now_s, self.is_of_any = 1000.0, False
        self.restart()

    def restart(self):
        self.recorder = TracksRecorder(BODY_PARTS)
        takes = TakesFile(self.path, BODY_PARTS, TracksCamera("sofa"))
        self.teaching = Teaching(self.recorder, takes, self.learner, self.refusal)

    def ask(self, command, teacher="anna", **fields):
        return self.teaching.handle(TeachRequest(command=command, teacher=teacher, **fields), self.now_s, ("a", "b"))

    def clap_take(self, take):
        self.ask("begin", label="clap", take=take, person="anna")
        self.pass_s(1.0), self.clap(), self.pass_s(1.5)
        assert self.ask("status").take.state == "kept"

    def pass_s(self, seconds, moving=False, seen=True, complaint="", people=None):
        """The camera films for so long: somebody who waves or rests, or nobody."""
        begun_s = self.now_s
        while self.now_s < begun_s + seconds:
            self.now_s += 1 / RATE_HZ
            centres = REST.copy() if seen else np.full_like(REST, np.nan)
            if moving:
                centres[1, 1] -= 150 * abs(np.sin(3 * (self.now_s - begun_s)))
            self.see(Tracks(centres, people=people), complaint)

    def hold_s(self, seconds):
        """The hand stays up."""
        for _ in range(round(seconds * RATE_HZ)):
            self.now_s += 1 / RATE_HZ
            self.see(Tracks(np.add(REST, [[0, 0], [0, -150], [0, 0]])), "")

    def clap(self):
        """The hands go apart, together, and apart, in a second."""
        for apart in (60, 90, 90, 60, 20, 4, 2, 2, 20, 60, 90, 60, 40, 40, 40, 40):
            self.now_s += 1 / 15
            self.see(Tracks(np.array([[320.0 - apart, 220], [320 + apart, 220], [320, 100]])), "")

    def see(self, tracks, complaint):
        at_ns = round(self.now_s * SECOND_NS)
        self.recorder.update(Frame(at_ns, np.empty(0)), tracks)
        self.teaching.step(at_ns, tracks, complaint, self.now_s, self.is_of_any)

    def perform(self, label, take):
        assert self.ask("begin", label=label, take=take, person="anna").fault == ""
        self.pass_s(1.0)
        assert self.ask("status").take.state == "waiting"
        self.pass_s(1.5, moving=True)
        assert self.ask("status").take.state == "moving"
        self.pass_s(1.5)
        return self.ask("status").take


@pytest.fixture
def room(tmp_path):
    room = Room(tmp_path)
    room.ask("status")
    room.pass_s(2.0)
    return room


def test_takes_are_cut_by_stillness_written_at_once_learned_and_adopted(room):
    assert room.ask("start", labels=["wave", "clap"]).fault == ""
    for take in (1, 2):
        report = room.perform("wave", take)
        assert (report.state, report.take) == ("kept", take) and 1.3 < report.seconds < 2.8
    room.perform("clap", 1)
    recordings = read_archive(room.path).recordings
    assert [(r.label, r.trial, r.subject) for r in recordings] == [
        ("wave", "1", "anna"), ("wave", "2", "anna"), ("clap", "1", "anna"),
    ]  # fmt: skip
    assert room.ask("drop", label="wave", take=1).takes == {"wave": [2], "clap": [1]}
    assert room.ask("begin", take=1).fault == ""
    for _ in range(9):
        room.pass_s(5.0, moving=True)
        room.ask("status")
    # Two pieces are on the disk already; the rest is when it ends.
    assert room.ask("status").other_s == pytest.approx(40, abs=0.5)
    assert room.ask("end").other_s == pytest.approx(45, abs=1)
    reply = room.ask("learn", labels=["wave", "clap"])
    assert room.learner.asked == [["wave", "clap"]] and reply.learned.results == {"wave": {"wave": 5}}
    assert room.ask("adopt", in_s=0.5).state == "idle" and room.learner.adopted == [0.5]
    assert room.ask("adopt").fault == "no new model has been learned"


def test_a_hand_that_is_held_up_does_not_end_a_take_soon(room):
    room.ask("start", labels=["wave", "clap"])
    room.ask("begin", label="wave", take=1)
    room.pass_s(1.0), room.pass_s(1.0, moving=True), room.hold_s(1.5)
    assert room.ask("status").take.state == "moving"
    room.pass_s(1.0, moving=True), room.pass_s(1.5)
    assert room.ask("status").take.state == "kept" and 3.0 < room.ask("status").take.seconds < 5.0
    # Whoever goes on in another posture has ended the movement in the end.
    room.ask("begin", label="wave", take=2)
    room.pass_s(1.0), room.pass_s(1.0, moving=True), room.hold_s(3.0)
    assert room.ask("status").take.state == "kept"


def test_what_cannot_be_used_is_said_and_costs_only_that_take(room):
    room.ask("start", labels=["wave", "clap"])
    room.perform("wave", 1)
    room.ask("begin", label="wave", take=2)
    room.pass_s(9.0)
    assert room.ask("status").take.fault == "nobody moved within 8 s of the signal"
    room.ask("begin", label="wave", take=3)
    room.pass_s(4.0, seen=False)
    assert room.ask("status").take.fault.startswith("nobody was seen")
    room.pass_s(1.0, complaint="too dark: switch on a light")
    reply = room.ask("status")
    assert reply.complaint == "too dark: switch on a light" and reply.takes == {"wave": [1]} and reply.visible
    room.now_s += 5
    reply = room.ask("begin", label="wave", take=4)
    assert reply.fault == "no pictures now: is the camera working?" and not reply.visible
    # A camera that dies within a take: the teacher ends it.
    room.pass_s(1.0)
    room.ask("begin", label="wave", take=5)
    room.now_s += 10
    assert "is the camera working?" in room.ask("end").take.fault
    # Or it is said by itself, and something else goes on when the camera is back.
    room.pass_s(1.0)
    room.ask("begin", label="wave", take=6)
    room.now_s += 3
    reply = room.ask("status")
    assert reply.state == "idle" and "is the camera working?" in reply.take.fault
    room.pass_s(1.0)
    room.ask("begin", take=1)
    room.pass_s(3.0), room.ask("status")
    room.now_s += 3
    assert room.ask("status").state == "recording"
    room.pass_s(3.0)
    assert room.ask("end").other_s > 5


def test_several_people_in_a_take_are_reported_when_they_stay(room):
    two = SeenPeople(Outline(0, 0, 10, 10), (Outline(20, 0, 30, 10),))
    room.pass_s(0.5, people=two)
    assert (room.ask("status").people, room.ask("status").side) == (2, "left"), "also before a lesson"
    room.pass_s(0.5), room.ask("start", labels=["wave", "clap"])
    for take, seconds in ((1, 1.0), (2, 4.0)):
        assert room.ask("begin", label="wave", take=take).people is None
        room.pass_s(seconds, people=two), room.pass_s(1.5, moving=True), room.pass_s(1.5)
        report = room.ask("status").take
        assert (report.state, report.people, report.side) == ("kept", take, "left")
    room.pass_s(0.5, people=two)
    reply = room.ask("status")
    assert (reply.people, reply.side) == (2, "left")
    room.pass_s(0.5, people=SeenPeople(Outline(40, 0, 50, 10), two.others))
    assert room.ask("status").side == "right"
    room.pass_s(0.5, people=SeenPeople(two.followed))
    assert room.ask("status").side is None


def test_claps_are_counted(room):
    assert room.ask("start", labels=["wave", "clap"]).claps == 0
    room.pass_s(1.0), room.clap(), room.pass_s(1.0), room.clap()
    assert room.ask("status").claps == 2


def test_takes_of_one_person_show_how_it_should_be_done_if_there_are_three_and_later_takes_do_not(room):
    labels = ["wave", "clap"]
    room.ask("start", labels=labels)
    for take in (1, 2, 3):
        room.perform("wave", take)
    room.clap_take(1)
    room.ask("learn", labels=labels, references=labels, person="anna")
    assert room.learner.shown[-1] == ["wave:1", "wave:2", "wave:3"], "of clap there is one take"
    room.ask("learn", labels=labels, references=labels, person="bob")
    assert room.learner.shown[-1] == []
    # The model in force knows which they are.
    room.learner.references = frozenset(["wave:1", "wave:2", "wave:3", "jump:1"])
    room.perform("wave", 4)
    room.ask("learn", labels=labels, add=True)
    assert room.learner.shown[-1] == ["wave:1", "wave:2", "wave:3"]
    room.ask("learn", labels=labels)
    assert room.learner.shown[-1] == [], "another lesson"


def test_takes_that_contradict_each_other_are_named_before_anything_is_learned(room):
    room.ask("start", labels=["wave", "clap"])
    for take in (1, 2, 3):
        room.perform("wave", take)
        room.clap_take(take)
    assert doubtful_takes(room.teaching.recorded(), ["wave", "clap"]) == []
    room.perform("clap", 4)
    (doubt,) = doubtful_takes(room.teaching.recorded(), ["wave", "clap"])
    assert (doubt.label, doubt.take, doubt.like) == ("clap", 4, "wave")


def test_an_observer_that_is_killed_goes_on_where_it_stopped(room):
    room.ask("start", labels=["wave", "clap"])
    room.perform("wave", 1)
    room.ask("begin", label="wave", take=2)
    room.restart()
    room.ask("status")
    room.pass_s(2.0)
    assert room.ask("start", labels=["wave", "clap"]).takes == {"wave": [1]}
    room.perform("clap", 1)
    room.ask("learn", labels=["wave", "clap"])
    room.ask("adopt")
    # Learned: the next teaching begins anew, but nothing is deleted; or the old takes are kept.
    assert room.ask("start", labels=["nod", "bow"], add=True).takes == {"wave": [1], "clap": [1]}
    assert room.ask("start", labels=["nod", "shake"]).takes == {}
    (earlier,) = room.ask("earlier").earlier
    assert earlier.takes == {"wave": 1, "clap": 1} and room.ask("status").earlier == []
    assert "known: anna" in room.ask("restore", earlier="x").fault
    assert room.ask("restore", teacher="anna", earlier=earlier.id).takes == {"wave": [1], "clap": [1]}


def test_takes_of_another_tracker_stay_with_what_they_have(tmp_path):
    def take(label, parts):
        return Recording(np.ones((10, parts, 2), np.float32), 15.0, label, "anna", "1")

    path, camera = tmp_path / "sofa.tracks.npz", TracksCamera("sofa")
    TakesFile(path, BODY_PARTS, camera).add(take("wave", 3))
    wider = (*BODY_PARTS, "left_foot")
    TakesFile(path, wider, camera).add(take("kick", 4))
    TakesFile(path, BODY_PARTS, camera).add(take("nod", 3))
    archive = read_archive(path)
    assert archive.body_parts == wider and [r.label for r in archive.recordings] == ["wave", "kick", "nod"]
    assert [bool(np.isfinite(r.positions[:, 3]).all()) for r in archive.recordings] == [False, True, False]


def test_a_full_disk_loses_no_take(room, monkeypatch, full_disk):
    room.ask("start", labels=["wave", "clap"])
    room.perform("wave", 1)

    full_disk()
    report = room.perform("wave", 2)
    assert report.state == "failed" and report.fault.endswith("no space left on device")
    assert "no space left" in room.ask("status").fault
    # What is to be deleted goes all the same, and the teacher may leave.
    assert "no space left" in room.ask("drop", label="wave", take=1).fault and not room.path.exists()
    assert "no space left" in room.ask("leave").fault and room.ask("status", teacher="ben").fault
    monkeypatch.undo()
    assert room.ask("status").takes == {"wave": [2]} and len(read_archive(room.path).recordings) == 1
    full_disk()
    room.ask("start", labels=["wave", "clap"]), room.perform("wave", 3)
    assert room.ask("forget", label="wave").forgotten.takes == 2 and not room.path.exists()


def test_one_teacher_at_a_time(room):
    room.ask("start", labels=["wave", "clap"])
    assert "another `labanmesh teach`" in room.ask("begin", teacher="ben", label="wave", take=1).fault
    assert room.ask("status", teacher="ben").fault == ""
    room.pass_s(11.0)
    assert room.ask("start", teacher="ben", labels=["nod", "bow"]).fault == ""
    assert room.ask("begin", teacher="ben", take=1).state == "recording"
    room.pass_s(5.0)
    assert room.ask("leave", teacher="cleo").fault
    assert room.ask("leave", teacher="ben").other_s == pytest.approx(5, abs=0.5)
    # A teacher that was killed: what it recorded ends by itself.
    assert room.ask("start", labels=["nod", "bow"]).fault == ""
    room.ask("begin", take=2)
    room.pass_s(30.0)
    reply = room.ask("status")
    assert reply.state == "idle" and reply.other_s == pytest.approx(15, abs=1)


@pytest.mark.parametrize(
    ("labels", "refusal", "fault"),
    [
        (["wave"], "", "name at least two movements"),
        (["Wave!", "clap"], "", "lower case letters"),
        (["wave", "clap"], "the scene names its vocabulary", "the scene names its vocabulary"),
    ],
)
def test_a_vocabulary_that_cannot_be_is_refused(tmp_path, labels, refusal, fault):
    assert fault in Room(tmp_path, refusal).ask("start", labels=labels).fault


@pytest.mark.parametrize("label", RESERVED)
def test_no_take_has_a_label_that_stands_for_something_else(room, label):
    room.ask("start", labels=["wave", "clap"])
    assert label in room.ask("begin", label=label, take=1).fault
    assert correct(room, "f", label, 1.0, 0.5).fault.startswith(label)
    assert room.ask("status").takes == {} and room.ask("begin", label="wave", take=1).fault == ""


def test_names_on_the_disk_that_fit_into_no_reply_do_not_disable_teaching(room):
    takes = TakesFile(room.path, BODY_PARTS, TracksCamera("sofa"))
    positions = np.zeros((9, len(BODY_PARTS), 2), np.float32)
    takes.add(Recording(positions, 15.0, "w" * 99, "anna", "1"))
    takes.add(Recording(positions, 15.0, "wave", "x" * 40_000, "9" * 30))
    room.restart()
    reply = room.ask("start", labels=["wave", "clap"], add=True)
    assert encode(reply) and (reply.fault, reply.takes, reply.persons) == ("", {}, {"anna": {}})


def test_a_teacher_is_shown_takes_and_what_is_seen_now(tmp_path):
    room = Room(tmp_path)
    assert room.ask("show").tracks is None, "no picture yet"
    room.pass_s(1.0)
    now = room.ask("show", teacher="somebody").tracks
    assert now.body_parts == list(BODY_PARTS) and (now.left, now.top, now.size) == (280, 100, 200)
    assert now.points[-6:] == [0, 1000, 400, 1000, 200, 0], "the first is left in the picture, the last on top"
    room.ask("start", labels=["wave", "clap"])
    room.ask("begin", label="wave", take=1)
    room.pass_s(1.0), room.pass_s(2.0, moving=True), room.pass_s(1.5)
    reply = room.ask("show", teacher="somebody", label="wave", take=1)
    assert reply.fault == "" and len(reply.tracks.points) == 24 * 3 * 2 and reply.tracks.seconds > 2
    assert len(encode(reply)) < 1500
    assert room.ask("show", label="wave", take=2).fault == "there is no take 2 of wave"
    room.pass_s(1.0, seen=False)
    assert room.ask("show").tracks is None
    assert room.ask("status", teacher="somebody").fault == "", "to look is not to teach"
    assert "another" in room.ask("begin", teacher="somebody", label="wave", take=2).fault


def ago_ns(room, seconds):
    return round((room.now_s - seconds) * SECOND_NS)


def correct(room, verdict, label, begin_s, end_s=None, **fields):
    """end_s None: until the person stands still."""
    to_ns = 0 if end_s is None else ago_ns(room, end_s)
    return room.ask(
        "correct",
        correction=verdict,
        label=label,
        from_ns=ago_ns(room, begin_s),
        to_ns=to_ns,
        **{"person": "anna"} | fields,
    )


def test_a_wrong_verdict_becomes_an_example_cut_by_the_persons_own_motion(room):
    room.ask("leave")
    room.pass_s(3.0), room.pass_s(2.0, moving=True), room.pass_s(30.0)
    # A verdict begins when a movement has become likely and ends when rest has.
    reply = correct(room, "home-1", "wave", 31.2, 29.9)
    assert reply.fault == "" and reply.takes == {"wave": [1]} and 1.8 < reply.corrected.seconds < 3.2
    assert abs(reply.corrected.from_ns - ago_ns(room, 32)) < 0.7 * SECOND_NS
    # The end is not known; only the time is, and not well.
    for verdict, begin_s, end_s in (("home-2", 31.5, None), ("missed-1", 26.0, 26.0)):
        assert correct(room, verdict, "wave", begin_s, end_s).corrected.seconds == pytest.approx(2.5, abs=0.7)
    (first, *_) = read_archive(room.path).recordings
    assert (first.label, first.subject) == ("wave", "anna") and np.isfinite(first.positions).all()
    assert [r.trial for r in read_archive(room.path).recordings] == ["1", "2", "3"]


def test_a_movement_of_one_of_several_people_is_no_example_of_any_of_them(room):
    for room.is_of_any, fault in ((True, "saw several people then"), (False, ""), (True, "saw several people then")):
        room.pass_s(7.0), room.pass_s(2.0, moving=True), room.pass_s(12.0)
        assert correct(room, f"home-{room.now_s:.0f}", "wave", 13.0, 12.0).fault.startswith(fault)
    assert correct(room, "home-0", "wave", 34.0, 33.0).fault == "", "of the time before"
    assert len(room.ask("status").takes["wave"]) == 2


def test_a_correction_may_be_repeated_and_corrected(room):
    room.pass_s(2.0, moving=True), room.pass_s(5.0)
    assert correct(room, "home-1", "wave", 6.0, 5.0).corrected == correct(room, "home-1", "wave", 6.0, 5.0).corrected
    reply = correct(room, "home-1", "", 6.0, 5.0)
    assert reply.takes == {} and reply.other_s == pytest.approx(reply.corrected.seconds)
    assert correct(room, "home-1", "clap", 6.0, 5.0).takes == {"clap": [1]} and room.ask("status").other_s == 0


def test_a_correction_of_nobody_in_particular_is_by_the_only_person_who_was_taught(room):
    assert room.ask("status").persons == {}
    room.pass_s(2.0, moving=True), room.pass_s(5.0)
    assert correct(room, "home-1", "wave", 6.0, 5.0).persons == {"anna": {"wave": 1}}
    assert correct(room, "home-2", "wave", 6.0, 5.0, person="").persons == {"anna": {"wave": 2}}
    reply = correct(room, "home-2", "wave", 6.0, 5.0, person="ben")
    assert list(reply.persons) == ["anna", "ben"] and reply.takes == {"wave": [1, 3]}, "the last word counts"
    assert correct(room, "home-3", "", 6.0, 5.0, person="").persons["someone"] == {"": 1}


def test_what_an_observer_does_not_remember_cannot_be_corrected(room):
    room.pass_s(20.0), room.pass_s(2.0, seen=False), room.pass_s(20.0)
    assert correct(room, "a", "wave", 20.0, 18.0).fault == "saw nobody move then"
    assert "saw nobody" in correct(room, "b", "", 21.5, 20.5).fault
    assert correct(room, "c", "wave", 10.0, 10.0).fault == "saw nobody move within 8 s of that time"
    assert correct(room, "d", "wave", 100.0, 98.0).fault == "remembers only the last 44 s, and this was before"
    assert correct(room, "e", "wave", -60.0, -61.0).fault == "has no pictures from that time"
    assert room.ask("status").takes == {} and not room.path.exists()
    room.restart()
    assert correct(room, "f", "wave", 1.0, 0.5).fault == "remembers no tracks"


def test_a_person_or_a_label_is_forgotten_in_all_files_and_in_memory(room):
    room.ask("start", labels=["wave", "clap"])
    room.perform("wave", 1), room.perform("clap", 1)
    room.ask("learn", labels=["wave", "clap"]), room.ask("adopt")
    room.ask("start", labels=["wave", "clap"])
    room.perform("wave", 1), room.perform("clap", 1)
    room.ask("begin", take=1, person="ben"), room.pass_s(3.0), room.ask("end")
    room.learner.known = {"anna"}
    reply = room.ask("forget", label="clap")
    assert (reply.forgotten.takes, reply.forgotten.in_model) == (2, False) and reply.takes == {"wave": [1]}
    assert correct(room, "a", "wave", 1.0, 0.5).fault == "remembers no tracks"
    reply = room.ask("forget", person="anna")
    assert reply.forgotten.takes == 2 and reply.forgotten.in_model and reply.other_s == pytest.approx(3, abs=0.3)
    assert [r.subject for r in read_archive(room.path).recordings] == ["ben"]
    assert room.ask("earlier").earlier == []
    assert room.ask("forget", everything=True).forgotten.other_s > 2 and list(room.path.parent.iterdir()) == []
    assert room.learner.forgotten == [False, False, True]
