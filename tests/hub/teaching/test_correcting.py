"""Corrections and forgetting with observers that only answer: what is asked of them, and what a person reads."""

from datetime import UTC, datetime, timedelta

import pytest
from fake_interface import FakeInterface

import labanmesh
from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.messages import Agreement, VerdictMessage, VocabularyReference
from common.teaching_messages import CorrectedReport, EarlierTakes, ForgottenReport, LearnedReport, TeachReply, Unwanted
from hub.teaching.correcting import Correction, correct, correction_of, learn_corrections
from hub.teaching.forgetting import forget, list_earlier, restore, untouched_line
from hub.teaching.participants import Participants

NOON = datetime(2026, 11, 22, 12, 0, 0, tzinfo=UTC)
NOON_NS = round(NOON.timestamp() * SECOND_NS)


class Observer:
    """Remembers everything unless `fault` says why not; people: who taught which movement."""

    alive = True

    def __init__(self, fault="", people=None, labels=("wave", "clap")):
        self.fault, self.labels, self.learned, self.examples, self.asked = fault, list(labels), None, {}, []
        self.people = {"anna": ["wave", "clap"]} if people is None else people
        self.in_model, self.was_removed, self.earlier = set(self.people), False, []

    @property
    def takes(self):
        return {label: [1] for labels in self.people.values() for label in labels}

    def answer(self, request):
        self.asked.append(request)
        corrected = forgotten = None
        fault = ""
        match request.command:
            case "correct" if self.fault:
                fault = self.fault
            case "correct":
                begin_ns, end_ns = request.from_ns - SECOND_NS, (request.to_ns or request.from_ns) + SECOND_NS
                self.examples[request.correction] = request.label
                corrected = CorrectedReport(
                    id=request.correction, label=request.label, from_ns=begin_ns, to_ns=end_ns, seconds=2.0
                )
            case "learn":
                self.learned = LearnedReport(labels=request.labels)
            case "adopt":
                self.labels, self.learned, self.in_model = self.learned.labels, None, set(self.people)
            case "forget":
                forgotten = self._forget(request)
            case "restore":
                fault = self.fault
        return TeachReply(
            state="learned" if self.learned else "idle", fault=fault, pictures=True, takes=self.takes,
            labels=self.labels, learned=self.learned, corrected=corrected, forgotten=forgotten, earlier=self.earlier,
            persons={name: dict.fromkeys(labels, 1) for name, labels in self.people.items()},
        )  # fmt: skip

    def _forget(self, request):
        gone = [p for p in self.people if request.everything or p == request.person]
        takes = sum(len(self.people.pop(person)) for person in gone)
        for labels in self.people.values():
            takes += labels.count(request.label)
            labels[:] = [label for label in labels if label != request.label]
        if request.everything or request.models:
            self.labels, self.in_model, self.was_removed = [], set(), True
        in_model = request.person in self.in_model or request.label in self.labels
        return ForgottenReport(takes=takes, in_model=in_model)


def participants_of(**observers):
    interface = FakeInterface(observers)
    return Participants("anna", interface, interface.ask, list(observers), add=True), interface


def verdict(began_s, label="wave", ended_s=None):
    at_ns = NOON_NS + round(began_s * SECOND_NS)
    vocabulary, agreement = VocabularyReference(name="m", hash="0"), Agreement(k=1, n=1)
    ended_ns = None if ended_s is None else at_ns + round(ended_s * SECOND_NS)
    return VerdictMessage(
        scene="home", fusion="f", seq=1, at_ns=at_ns, vocabulary=vocabulary, p=[0.5, 0.5], label=label,
        certainty_bits=1.0, rule="r", votes={}, agreement=agreement, id=f"home-{at_ns // 1_000_000}",
        began_ns=at_ns, decided_ns=at_ns + SECOND_NS, ended_ns=ended_ns,
    )  # fmt: skip


VERDICTS = (verdict(-10, "clap"), verdict(-60, "wave", ended_s=2.0))


@pytest.mark.parametrize(
    ("when", "correction"),
    [
        ("last", Correction(VERDICTS[0].id, "nod", NOON_NS - 10 * SECOND_NS)),
        (VERDICTS[1].id, Correction(VERDICTS[1].id, "nod", NOON_NS - 60 * SECOND_NS, NOON_NS - 58 * SECOND_NS)),
        ("11:59:01", Correction(VERDICTS[1].id, "nod", NOON_NS - 60 * SECOND_NS, NOON_NS - 58 * SECOND_NS)),
        ("home-1795233753790", Correction("home-1795233753790", "nod", 1795233753790 * 1_000_000)),
    ],
)
def test_a_verdict_is_named_by_its_id_or_its_time(when, correction):
    assert correction_of(when, "nod", VERDICTS, NOON) == correction


def test_a_movement_without_a_verdict_is_named_by_its_moment():
    missed = correction_of("30s", "wave", VERDICTS, NOON)
    assert missed.is_moment and missed.began_ns == NOON_NS - 30 * SECOND_NS
    assert correction_of("2min", "nothing", VERDICTS, NOON).label == ""
    span = correction_of("11:58:00..11:58:03", "wave", VERDICTS, NOON)
    assert (span.ended_ns - span.began_ns, span.is_moment) == (3 * SECOND_NS, False)
    # A time of day that has not come yet was yesterday.
    began_ns = correction_of("23:00:00", "wave", (), NOON).began_ns
    assert began_ns == NOON_NS - timedelta(hours=13).total_seconds() * SECOND_NS


@pytest.mark.parametrize("when", ["", "yesterday", "25:00:00", "11:58:03..11:58:00", "11:58:03..x"])
def test_a_moment_that_is_none_is_refused_with_what_is_expected(when):
    with pytest.raises(BadInput, match="expected"):
        correction_of(when, "wave", VERDICTS, NOON)
    with pytest.raises(BadInput, match=r"home-\d+ \(.*clap\)"):
        correction_of("yesterday", "wave", VERDICTS, NOON)
    for long_ago in ("9" * 400 + "s", "500000000000s", "99999999999min"):
        with pytest.raises(BadInput, match="or how long ago"):
            correction_of(long_ago, "wave", VERDICTS, NOON)
    participants, _ = participants_of(sofa=Observer())
    with pytest.raises(BadInput, match="correct: from_ns"):
        correct(participants, [correction_of(f"home-{'9' * 14}", "wave", VERDICTS, NOON)], {}, "anna")


def test_each_observer_is_asked_in_its_own_time_and_those_that_can_learn_and_change():
    participants, interface = participants_of(sofa=Observer(), shelf=Observer("remembers no tracks"), door=Observer())
    wrong, missed = Correction("home-1", "clap", NOON_NS, NOON_NS + SECOND_NS), Correction("m", "", NOON_NS, NOON_NS)
    made = correct(participants, [wrong, missed], {"sofa": 2.0}, "anna")
    assert made == {"sofa": 2, "shelf": 0, "door": 2}
    sofa, door = interface.observers["sofa"], interface.observers["door"]
    at_ns = [[r.from_ns - NOON_NS for r in each.asked if r.command == "correct"] for each in (sofa, door)]
    # Of the missed one the sofa found when it was, and the door was asked for the same.
    assert at_ns == [[2 * SECOND_NS, 2 * SECOND_NS], [0, -SECOND_NS]]
    assert "  shelf: remembers no tracks" in interface.lines and any(
        "was something else" in line for line in interface.lines
    )
    learn_corrections(participants, ["sofa", "door"])
    assert interface.lines[-1] == "2 observers and the fusion service recognise wave, clap from now on"
    assert interface.observers["shelf"].learned is None and sofa.examples == {"home-1": "clap", "m": ""}


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("teach x.toml --was last", "--was 1 times, and 0 labels: each --was WHEN is followed by what it was"),
        ("teach x.toml", "name the movements"),
        ("teach x.toml nothing wave", "this word stands for something else"),
        ("teach x.toml abstain --add", "this word stands for something else"),
        ("teach x.toml Wave --add", "use 1 to 64 lower case letters"),
        (f"teach x.toml wave nod --person {'x' * 65}", "at most 64 printable characters"),
        (f"teach x.toml --was last wave --person {'x' * 65}", "at most 64 printable characters"),
        (f"forget x.toml --yes --person {'x' * 40_000}", "at most 64 printable characters"),
        ("forget x.toml --yes --label Wave!", "use 1 to 64 lower case letters"),
        ("forget x.toml", "name one of --person NAME, --label LABEL, --all"),
        ("forget x.toml --all --label wave", "name one of"),
        ("forget x.toml --person anna", "all takes by anna cannot be brought back; add --yes"),
        ("forget x.model --labels wave -o y.model", "x.model: no such model file"),
    ],
)
def test_a_command_that_is_not_complete_is_refused_in_a_line(words, error, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.toml").write_text('scene = "home"\n[observers.sofa]\nsource = "0"\n')
    assert labanmesh.main(words.split()) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and error in lines[0]


@pytest.mark.parametrize(
    ("people", "person", "stored"),
    [
        (({"anna": ["wave"]}, {"anna": ["wave"]}), "", "anna"),
        (({"anna": ["wave"]}, {"ben": ["wave"]}), "", "someone"),
        (({"anna": ["wave"]}, {"anna": ["wave"]}), "ben", "ben"),
    ],
)
def test_a_correction_is_by_the_only_person_who_was_taught_unless_somebody_is_named(people, person, stored):
    sofa, shelf = (Observer(people=dict(each), labels=("wave",)) for each in people)
    participants, interface = participants_of(sofa=sofa, shelf=shelf)
    correct(participants, [Correction("home-1", "wave", NOON_NS)], {}, person)
    assert {r.person for o in (sofa, shelf) for r in o.asked if r.command == "correct"} == {stored}
    assert f"was wave{'' if stored == 'someone' else f' by {stored}'}: kept by sofa" in interface.lines[0]


def test_what_cannot_be_corrected_is_said_in_a_line():
    participants, _ = participants_of(sofa=Observer())
    with pytest.raises(BadInput, match=r"nod is not taught \(known: wave, clap\); teach it first"):
        correct(participants, [Correction("a", "nod", NOON_NS)], {}, "anna")
    participants, interface = participants_of(sofa=Observer("remembers no tracks"))
    with pytest.raises(LabanmeshError, match="no observer could make an example"):
        correct(participants, [Correction("a", "wave", NOON_NS)], {}, "anna")
    participants, interface = participants_of(sofa=Observer(people={}), shelf=Observer(labels=()))
    with pytest.raises(LabanmeshError, match="no observer can be corrected"):
        correct(participants, [Correction("a", "wave", NOON_NS)], {}, "anna")
    assert (
        "sofa: its model was not made by labanmesh teach, and cannot be corrected; the others go on" in interface.lines
    )


def test_a_person_is_forgotten_and_what_others_taught_stays():
    people = {"anna": ["wave"], "ben": ["wave", "clap"]}
    participants, interface = participants_of(sofa=Observer(people=people), shelf=Observer())
    forget(participants, Unwanted(person="anna"))
    sofa, shelf = interface.observers["sofa"], interface.observers["shelf"]
    assert "sofa: removed 1 take; learns anew without it" in interface.lines and sofa.labels == ["wave", "clap"]
    # Only anna had taught the shelf: nothing is left to learn from.
    assert shelf.was_removed and not sofa.was_removed and sofa.in_model == {"ben"}


def test_a_misspelt_name_is_answered_with_what_is_known():
    for unwanted, line in (
        (Unwanted(label="wavve"), "nobody had anything of wavve: did you mean wave?"),
        (Unwanted(person="otto"), "nobody had anything of otto: known: anna"),
    ):
        participants, interface = participants_of(sofa=Observer(), shelf=Observer())
        forget(participants, unwanted)
        assert interface.lines[-1] == line


def test_a_movement_is_forgotten_by_all_and_everything_leaves_no_model():
    observers = {
        name: Observer(people={"anna": ["wave", "clap", "nod"]}, labels=("wave", "clap", "nod")) for name in "ab"
    }
    participants, _ = participants_of(**observers)
    forget(participants, Unwanted(label="clap"))
    assert all(each.labels == ["wave", "nod"] and not each.was_removed for each in observers.values())
    forget(participants, Unwanted(label="nod"))
    assert all(each.was_removed for each in observers.values()), "one movement alone cannot be told from others"
    participants, _ = participants_of(sofa=Observer())
    forget(participants, Unwanted(everything=True))
    assert participants.observers == ["sofa"]


def test_what_is_not_forgotten_is_said_with_the_way_out():
    assert untouched_line(["sofa"], clips=False).startswith(
        "not touched: clips of verdicts by sofa (--clips), and files"
    )
    assert "clips" not in untouched_line(["sofa"], clips=True) and "capture" in untouched_line([], clips=False)


def test_earlier_takes_are_listed_and_restored_on_every_observer_that_has_them():
    participants, interface = participants_of(sofa=Observer(), shelf=Observer(), door=Observer())
    list_earlier(participants, "s.toml")
    assert interface.lines == ["no takes were set aside"]
    best = EarlierTakes(id="l1", takes={"wave": 5, "clap": 1}, labels=["clap", "wave"], other_s=61.0, at_ns=NOON_NS)
    interface.observers["sofa"].earlier = [best, EarlierTakes(id="l2", takes={"nod": 1}, at_ns=NOON_NS + SECOND_NS)]
    interface.observers["shelf"].earlier = [EarlierTakes(id="l1", at_ns=NOON_NS)]
    list_earlier(participants, "s.toml")
    newest, other, hint = interface.lines[1:]
    assert newest.startswith("l2, set aside on 22 November at ") and newest.endswith(": sofa: 1 take of nod")
    assert other.startswith("l1, ") and ", lesson not finished: sofa: 5 takes of wave, 1 take of clap, 61 s" in other
    assert other.endswith("; shelf: cannot be read") and hint.endswith("labanmesh teach s.toml --restore ID")
    with pytest.raises(BadInput, match="--restore l9: no observer has such takes; known: l1, l2"):
        restore(participants, "l9", "s.toml")
    restore(participants, "l1", "s.toml")
    assert interface.lines[-1] == "restored by sofa, shelf; go on with them: labanmesh teach s.toml clap wave"
    assert [[r.earlier for r in each.asked if r.command == "restore"] for each in interface.observers.values()] == [
        ["l1"], ["l1"], []
    ]  # fmt: skip
    interface.observers["shelf"].fault = "learns now"
    with pytest.raises(LabanmeshError, match="not restored by shelf: the lines above say why"):
        restore(participants, "l1", "s.toml")
