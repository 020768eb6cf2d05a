"""A lesson with observers that only answer: what is asked of them, and what the teacher reads."""

from types import SimpleNamespace

import pytest
from fake_interface import FakeInterface

from common.errors import LabanmeshError
from common.teaching_messages import LearnedReport, TakeDoubt, TakeReport, TaughtPlace, TeachReply
from common.vocabulary import ABSTAIN
from hub.teaching.interface import GO, Action
from hub.teaching.lesson import Lesson, LessonPlan
from hub.teaching.wording import result_lines, step_line

KEYS = {"r": "repeat", "d": "drop", "p": "pause", "s": "skip", ".": "go"}


class Observer:
    """Keeps every take, except those in `faults`; `dies` at a take."""

    def __init__(
        self, faults=(), dies=None, results=None, labels=("old", "older"), can_learn=True, returns=False, doubts=()
    ):
        self.faults, self.dies, self.results, self.labels = dict(faults), dies, results or {}, list(labels)
        self.takes, self.other_s, self.alive, self.learned, self.last = {}, 0.0, True, None, None
        self.fault, self.doubts = "", doubts
        self.visible, self.still, self.claps, self.people, self.side = True, 1.0, 0, 1, None
        self.place = None
        self.is_recording, self.can_learn, self.returns = False, can_learn, returns
        self.referenced = 5

    def answer(self, request):
        match request.command:
            case "begin" if request.label:
                key = request.label, request.take
                if key == self.dies:
                    self.alive, self.dies = self.returns, None
                    return None
                state = "failed" if key in self.faults else "kept"
                self.last = TakeReport(
                    label=request.label,
                    take=request.take,
                    state=state,
                    seconds=1.2,
                    fault=self.faults.get(key, ""),
                    people=self.people,
                    side=self.side,
                )
                if state == "kept":
                    self.takes.setdefault(request.label, []).append(request.take)
            case "begin":
                self.is_recording = True
            case "end" if self.is_recording:
                self.is_recording, self.other_s = False, 60.0
            case "drop":
                self.takes[request.label].remove(request.take)
            case "learn" if self.can_learn:
                references = {label: self.referenced for label in request.references if label == "wave"}
                self.learned = LearnedReport(labels=request.labels, results=self.results, references=references)
            case "learn":
                self.fault = "wave: one take is not enough"
            case "adopt":
                self.labels, self.learned = self.learned.labels, None
        state = "recording" if self.is_recording else "idle" if self.learned is None else "learned"
        return TeachReply(
            state=state, fault=self.fault, pictures=True, visible=self.visible, still=self.still, claps=self.claps,
            doubts=list(self.doubts) if request.command == "check" else [], takes=self.takes, other_s=self.other_s,
            take=self.last, labels=self.labels, learned=self.learned, people=self.people, side=self.side,
            place=self.place,
        )  # fmt: skip


class PressedInterface(FakeInterface):
    """keys: pressed after the takes; presses: where the lesson can wait; both in order."""

    def __init__(self, observers, keys="", presses=()):
        super().__init__(observers)
        self.keys, self.presses, self.asked = list(keys), list(presses), []
        self.decided, self.shown, self.waited = ["wave"], [], []

    def show(self, step):
        if line := step_line(step):
            self.shown.append(line)

    def between(self, step, seconds):
        if not self.keys:
            self.pause(seconds)
            return GO
        return Action(KEYS[self.keys.pop(0)])

    def ready(self, step):
        self.waited.append((step.kind, step.label, step.number))
        return self.presses.pop(0) if self.presses else GO

    def verdicts(self):
        """Those of before, then one for each movement."""
        label = self.decided.pop(0) if self.decided else ""
        verdict = SimpleNamespace(label=label, place=None) if isinstance(label, str) else label
        return [verdict] if verdict.label else []

    def ask(self, request, names):
        self.asked.append(request)
        return super().ask(request, names)


def teach(observers, keys="", presses=(), **plan):
    interface = PressedInterface(observers, keys, presses)
    values = {"labels": ["wave", "clap"], "teacher": "anna", "takes": 2, "background_s": 60.0, **plan}
    Lesson(LessonPlan(**values), interface, interface.ask, list(observers)).run()
    return interface


def takes_asked(interface):
    return [(each.label, each.take) for each in interface.asked if each.command == "begin" and each.label]


def test_takes_that_show_how_it_should_be_done_are_asked_for_and_said():
    interface = teach({"sofa": Observer()}, reference=True, person="eva", takes=5)
    (learn,) = (each for each in interface.asked if each.command == "learn")
    assert (learn.references, learn.person) == (["wave", "clap"], "eva")
    assert "sofa: scores wave by 5 reference takes" in interface.lines
    assert "sofa: cannot score clap: at least three takes have to be kept" in interface.lines
    plain = teach({"sofa": Observer()})
    assert not any("score" in line for line in plain.lines)


def test_the_whole_lesson():
    results = {"wave": {"wave": 2}, "clap": {"clap": 1, "wave": 1}}
    # A peer that names what nobody teaches ends no lesson.
    foreign = {"wave": {"wave": 2, "nod": 2}, "clap": {"clap": 2}, "nod": {"wave": 2}}
    sofa, shelf = Observer(results=results), Observer(results=foreign)
    interface = teach({"sofa": sofa, "shelf": shelf})
    assert takes_asked(interface) == [("wave", 1), ("wave", 2), ("clap", 1), ("clap", 2)]
    assert sofa.labels == shelf.labels == ["wave", "clap"]
    assert "wave 1 of 2: kept by sofa (1.2 s), shelf (1.2 s)" in interface.lines
    assert "sofa: wave 2 of 2, clap 1 of 2" in interface.lines
    assert "wave and clap look alike from sofa" in interface.lines
    assert interface.lines[-1] == "2 observers and the fusion service recognise wave, clap from now on"
    assert interface.seconds > 60
    assert interface.shown[:5] == [
        "wave 1 of 2: 3",
        "wave 1 of 2: 2",
        "wave 1 of 2: 1",
        "wave 1 of 2: now",
        "wave 1 of 2: kept",
    ]
    assert "something else: 60 s to go" in interface.shown and "learning: 0 of 2, 0 s" in interface.shown
    ready = [("ready", "wave", 0), ("review", "wave", 2), ("ready", "clap", 0), ("review", "clap", 2), ("ready", "", 0)]
    assert interface.waited == [*ready, ("learned", "", 0)]


def test_at_the_end_each_movement_is_done_once_more():
    sofa = Observer()
    interface = PressedInterface({"sofa": sofa})
    interface.decided = ["old", "wave", "old", "wave"]
    Lesson(
        LessonPlan(["wave", "clap", "nod"], "anna", takes=2, background_s=0, test=True),
        interface,
        interface.ask,
        ["sofa"],
    ).run()
    assert interface.lines[-4:] == [
        "wave: recognised",
        "clap: taken for wave",
        "nod: nothing was decided",
        "1 of 3 recognised",
    ]


def test_then_verdicts_count_as_false_alarms_and_one_line_sums_up():
    results = {"wave": {"wave": 2}, "clap": {"clap": 1, "wave": 1}}

    def tested(keys):
        interface = PressedInterface({"sofa": Observer(results=results)}, keys)
        interface.decided = ["old", "wave", "old", "clap", "old", "wave", ABSTAIN]
        plan = LessonPlan(["wave", "clap"], "anna", takes=2, background_s=0, test=True, alarm_s=30.0)
        Lesson(plan, interface, interface.ask, ["sofa"]).run()
        return interface

    interface = tested("....")
    assert "false alarm: wave" in interface.lines
    assert "none of the movements: 30 s to go, 0 false alarms" in interface.shown
    alike = "wave and clap look alike from sofa"
    assert interface.lines[-1] == f"2 of 2 recognised, 1 false alarm in 0.5 minutes; {alike}"
    assert tested("....s").lines[-1] == f"2 of 2 recognised; {alike}"


@pytest.mark.parametrize("how", ["still", "clap", "key"])
def test_takes_begin_with_a_sign_and_without_a_keyboard(how):
    sofa, shelf = Observer(), Observer()
    sofa.still = shelf.still = 0.0
    interface = PressedInterface({"sofa": sofa, "shelf": shelf})
    looks = iter(range(100))

    def between(step, seconds):
        interface.pause(seconds)
        look = next(looks) if step.kind == "waiting" else 0
        sofa.still, shelf.claps = float(look > 5), int(look > 7)
        return Action("begin") if look > 20 else GO

    interface.between = between
    plan = LessonPlan(["wave", "clap"], "anna", takes=2, background_s=0, begin=how)
    Lesson(plan, interface, interface.ask, ["sofa", "shelf"]).run()
    waited = interface.shown.index("wave 1 of 2: 3")
    assert waited == {"still": 13, "clap": 9, "key": 22}[how] and "begin" in "".join(interface.lines)


def test_a_lesson_that_waits_for_nobody_ends_with_a_line():
    sofa = Observer()
    sofa.visible = False
    with pytest.raises(LabanmeshError, match="nobody came into the sight of a camera in 3 minutes"):
        teach({"sofa": sofa}, begin="still")
    restless = Observer()
    restless.still = 0.1
    assert "nobody stands still; it begins all the same" in teach({"sofa": restless}, begin="still").lines


def test_takes_that_look_like_another_movement_or_show_two_people_are_offered_again():
    doubt = TakeDoubt(label="wave", take=2, like="clap")
    sofa, shelf = Observer(doubts=[doubt]), Observer(doubts=[doubt, TakeDoubt(label="clap", take=1, like="wave")])
    sofa.people = 2
    interface = teach({"sofa": sofa, "shelf": shelf}, keys="....r")
    assert interface.lines.count("2 people in the picture of sofa: is the take yours? r makes it again") == 1
    assert "wave 2 looks more like clap than like the other takes of wave, from sofa and shelf" in interface.lines
    assert "clap 1 looks more like wave than like the other takes of clap, from shelf" in interface.lines
    assert takes_asked(interface)[4:] == [("wave", 3)] and sofa.takes["wave"] == [1, 3]


def test_a_lesson_says_whom_it_teaches_where_several_are_seen():
    sofa, shelf = Observer(), Observer()
    sofa.people, sofa.side = 2, "left"
    lines = teach({"sofa": sofa, "shelf": shelf}).lines
    assert "sofa: sees 2 people and learns from the one on the left" in lines and "shelf: sees somebody" in lines
    whose = "2 people in the picture of sofa, the take is of the one on the left: is the take yours? r makes it again"
    assert lines.count(whose) == 1


def test_all_cameras_are_told_where_the_one_stands_who_is_taught():
    place = TaughtPlace(at=[0.9, 0.0], covariance=[0.04, 0.0, 0.04])
    sofa, shelf, door = Observer(), Observer(), Observer()
    sofa.people, sofa.side, sofa.place = 2, "left", place
    shelf.people, shelf.side, shelf.place = 2, "right", place
    interface = teach({"sofa": sofa, "shelf": shelf, "door": door})
    begun = [each for each in interface.asked if each.command == "begin"]
    assert begun and all(each.place == place for each in begun)
    assert "door: does not know where people stand: nobody else may be in view while it learns" in interface.lines
    assert sum("nobody else" in line for line in interface.lines) == 1
    alone = teach({"sofa": Observer(), "door": Observer()})
    looks = [sum(each.command == "status" for each in lesson.asked) for lesson in (interface, alone)]
    assert looks[0] > 2 * looks[1], "they are told between two takes, too: people walk"
    assert not any("nobody else" in line for line in alone.lines) and not any(each.place for each in alone.asked)


def test_verdicts_of_somebody_else_do_not_count_in_the_test():
    sofa = Observer()
    sofa.people, sofa.side = 2, "left"
    sofa.place = TaughtPlace(at=[0.9, 0.0], covariance=[0.04, 0.0, 0.04])
    interface = PressedInterface({"sofa": sofa}, "....")
    verdict = lambda label, x: SimpleNamespace(label=label, place=[x, 0.1])  # noqa: E731
    interface.decided = ["old", verdict("clap", -0.9), verdict("wave", 0.8), "old", verdict("wave", -0.9)]
    plan = LessonPlan(["wave", "clap"], "anna", takes=2, background_s=0, test=True)
    Lesson(plan, interface, interface.ask, ["sofa"]).run()
    assert "wave: recognised" in interface.lines and "clap: nothing was decided" in interface.lines


def test_a_lesson_waits_for_a_teacher_that_was_killed():
    sofa = Observer()
    answer, refusals = sofa.answer, iter(["another `labanmesh teach` is at work with this observer"] * 4)

    def busy(request):
        fault = next(refusals, "") if request.command == "start" else ""
        return answer(request).model_copy(update={"fault": fault})

    sofa.answer = busy
    assert sum("another" in line for line in teach({"sofa": sofa}).lines) == 1 and sofa.labels == ["wave", "clap"]


def test_a_camera_that_is_lost_is_said_once_and_its_return_too():
    sofa, shelf = Observer(), Observer()
    pictures = iter([True] * 4 + [False] * 3 + [True] * 100)
    answer = shelf.answer
    shelf.answer = lambda request: answer(request).model_copy(update={"pictures": next(pictures)})
    lines = teach({"sofa": sofa, "shelf": shelf}).lines
    assert lines.count("shelf: no pictures now: is the camera working?") == 1
    assert lines.count("shelf: has pictures again") == 1


def test_observers_record_before_the_signal_so_that_a_busy_machine_cuts_no_beginning(monkeypatch):
    """A performer, and nearly a person, begins 0.2 s after the signal; a busy observer may take seconds to begin."""
    order = []

    def show(interface, step):
        order.append(step.kind)

    def ask(interface, request, names):
        order.append(request.command)
        return FakeInterface.ask(interface, request, names)

    monkeypatch.setattr(PressedInterface, "show", show)
    monkeypatch.setattr(PressedInterface, "ask", ask)
    teach({"sofa": Observer()}, takes=2)
    assert [order[n - 1] for n, kind in enumerate(order) if kind == "now"] == ["begin"] * 4


def test_takes_are_repeated_dropped_and_go_on_where_they_stopped():
    sofa = Observer()
    sofa.takes = {"wave": [1]}
    interface = teach({"sofa": sofa}, keys="rd")
    assert takes_asked(interface) == [("wave", 2), ("wave", 3), ("clap", 1), ("clap", 2)]
    assert sofa.takes == {"wave": [1], "clap": [1, 2]} and {"again", "dropped"} <= set(interface.lines)
    more = teach({"sofa": sofa}, labels=["nod"], add=True)
    assert takes_asked(more) == [("nod", 1), ("nod", 2)] and sofa.labels == ["wave", "clap", "nod"]
    more = teach({"sofa": sofa}, labels=["nod"], add=True)
    assert takes_asked(more) == [("nod", 3), ("nod", 4)] and sofa.takes["nod"] == [1, 2, 3, 4]


def test_a_page_looks_at_the_takes_and_can_leave_parts_out():
    sofa = Observer()
    drop, more = Action("drop", 1), Action("more")
    interface = teach({"sofa": sofa}, presses=[GO, drop, Action("drop", 9), more, GO, GO, GO, Action("skip")])
    assert sofa.takes == {"wave": [2, 3], "clap": [1, 2]} and sofa.other_s == 0 and sofa.labels == ["wave", "clap"]
    assert [each for each in interface.waited if each[0] == "review"][:4] == [
        ("review", "wave", n) for n in (2, 1, 1, 2)
    ]
    # A take that was made again while the takes went on, a pause, and new models that are not wanted.
    sofa = Observer()
    interface = PressedInterface({"sofa": sofa}, presses=[GO, GO, GO, GO, GO, Action("skip")])
    pressed = [Action("repeat", 1), Action("pause")]
    interface.between = lambda step, seconds: pressed.pop(0) if pressed else GO
    Lesson(LessonPlan(["wave", "clap"], "anna", takes=2, background_s=0), interface, interface.ask, ["sofa"]).run()
    assert sofa.takes == {"wave": [2, 3], "clap": [1, 2]} and ("ready", "wave", 1) in interface.waited
    assert sofa.labels == ["old", "older"] and interface.lines[-1] == "nothing has changed; the takes are kept"


def test_a_take_that_one_observer_lacks_counts_and_one_that_all_lack_is_made_again():
    nobody = "nobody was seen"
    sofa = Observer(faults={("wave", 1): nobody, ("wave", 2): nobody})
    shelf = Observer(faults={("wave", 2): nobody})
    interface = teach({"sofa": sofa, "shelf": shelf})
    assert takes_asked(interface)[:3] == [("wave", 1), ("wave", 2), ("wave", 3)]
    assert (sofa.takes["wave"], shelf.takes["wave"]) == ([3], [1, 3])
    assert "  sofa: nobody was seen" in interface.lines
    with pytest.raises(LabanmeshError, match="3 takes in a row"):
        teach({"sofa": Observer(faults={("wave", n): nobody for n in range(1, 9)})})


def test_an_observer_that_dies_costs_only_itself():
    sofa, shelf = Observer(), Observer(dies=("clap", 1))
    interface = teach({"sofa": sofa, "shelf": shelf})
    assert "shelf: no answer any more; the others go on" in interface.lines and sofa.labels == ["wave", "clap"]
    with pytest.raises(LabanmeshError, match="no observer answers any more; what was recorded is kept"):
        teach({"shelf": Observer(dies=("wave", 2))})


def test_an_observer_that_comes_back_goes_on():
    sofa, shelf = Observer(), Observer(dies=("wave", 1), returns=True)
    interface = teach({"sofa": sofa, "shelf": shelf})
    assert "shelf: is back" in interface.lines and shelf.takes == {"wave": [2], "clap": [1, 2]}
    assert interface.lines[-1].startswith("2 observers")
    # The only one, as under a supervisor: the take is asked again.
    only = Observer(dies=("wave", 2), returns=True)
    interface = teach({"only": only})
    assert "only: is back" in interface.lines and only.takes["wave"] == [1, 2] and only.labels == ["wave", "clap"]


def test_all_learn_before_any_changes_and_a_minority_does_not_take_the_others_along():
    observers = {"sofa": Observer(), "shelf": Observer(can_learn=False), "door": Observer(can_learn=False)}
    with pytest.raises(LabanmeshError, match="most observers could not learn; nothing changes"):
        teach(observers)
    assert all(each.labels == ["old", "older"] for each in observers.values())
    observers["shelf"].can_learn, observers["shelf"].fault = True, ""
    observers["door"].fault = ""
    interface = teach(observers)
    assert "door: wave: one take is not enough" in interface.lines and observers["door"].labels == ["old", "older"]
    assert interface.lines[-1].startswith("2 observers and the fusion service")


def test_movements_look_alike_from_where_they_are_confused():
    def report(wave, periods):
        return LearnedReport(labels=["wave", "clap"], results={"wave": wave, "clap": {"clap": 5}}, periods=periods)

    lines = result_lines(
        {"sofa": report({"wave": 4, "clap": 1}, {"wave": 0.82}), "door": report({"wave": 3, "clap": 2}, {})}
    )
    assert lines == [
        "sofa: wave 4 of 5, clap 5 of 5",
        "door: wave 3 of 5, clap 5 of 5",
        "repeated: wave every 0.8 s; any other movement is a new one each time",
        "wave and clap look alike from door",
    ]
    assert "foreign" not in str(result_lines({"sofa": report({"wave": 5}, {"foreign": 1.0})}))
