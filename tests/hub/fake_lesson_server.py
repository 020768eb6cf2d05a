"""A lesson server in which nothing is taught."""

from common.errors import BadInput
from common.teaching_messages import LearnedReport, ShownTracks, TakeReport, TeachReply
from hub.scene_state import SceneState


class FakeLessonServer:
    """What pages ask and press; nothing is taught."""

    def __init__(self, scene):
        self.scene, self.version, self.silent, self.scene_state = scene, 7, frozenset(), SceneState("interface")
        self.lesson, self.plans, self.pressed, self.stopped, self.looks = None, [], [], [], 0
        self.verdicts, self.corrected, self.forgotten = [], [], []
        reply = TeachReply(
            state="learned", pictures=True, visible=True, takes={"nod": [1, 2], "ok": [1]}, other_s=61.2, labels=["ok"],
            take=TakeReport(label="nod", take=2, state="kept", seconds=1.44),
            learned=LearnedReport(labels=["ok", "nod"], results={"nod": {"nod": 2}}),
            persons={"anna": {"nod": 2, "ok": 1, "": 1}},
        )  # fmt: skip
        self.observers = {"cam1": reply, "cam2": None}

    def looked(self):
        self.looks += 1

    def start(self, plan):
        if self.plans:
            raise BadInput("a lesson is going on")
        self.plans.append(plan)

    def press(self, lesson, number, action):
        self.pressed.append((lesson, number, action))

    def stop(self, lesson):
        self.stopped.append(lesson)

    def correct(self, wanted):
        self.corrected.append(wanted)

    def forget(self, unwanted, *, clips):
        self.forgotten.append((unwanted, clips))

    def now(self, observer):
        if observer != "cam1":
            raise BadInput(f"observer {observer!r} is unknown; known: cam1, cam2")
        return ShownTracks(body_parts=["head"], points=[0, 1000])

    def take(self, observer, label, number):
        return None
