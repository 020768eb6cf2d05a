"""The lesson of a scene for pages: one at a time, the same for everybody who looks. Safe for several threads.

1. The lesson runs in a thread of this process. A page only shows `state` and presses, so that it may be reloaded or
   sleep, and a second one sees the same.
2. Observers are asked how they stand only while somebody looks, or a lesson waits; its own requests count too.
3. While a lesson waits it stays the teacher of its observers, until nobody has looked for LESSON_LEFT_S.
"""

import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence

from common import SECOND_NS
from common.config import Scene
from common.errors import BadInput, LabanmeshError
from common.link import Link
from common.messages import VerdictMessage
from common.teaching_messages import ShownTracks, TeachReply, TeachRequest, Unwanted
from hub.scene_state import SceneState
from hub.session import ArrivedVerdict, SceneUpdate, newly_decided
from hub.teaching.correcting import clock_offsets, fusion_ns
from hub.teaching.forgetting import clip_keepers_of, forget, untouched_line
from hub.teaching.interface import Action, Answers
from hub.teaching.lesson import Lesson, LessonPlan
from hub.teaching.page_interface import MOVED_ON, PageInterface, PageLesson, Purpose
from hub.teaching.page_memory import WantedCorrections, corrections_of, learn_from
from hub.teaching.participants import Participants
from hub.teaching.teaching_client import TeachingClient, names_of, presence_of
from hub.teaching.wording import NO_RIGHT, TYPED, reworded

log = logging.getLogger("labanmesh.hub")
REPLY_LOOK_S, FIRST_S = 0.5, 0.1
"""How often observers are asked, and while none has answered yet."""
TEACHER_LEASE_S = 5.0
"""So long after the last page has asked, observers are still asked."""
LESSON_LEFT_S = 1800.0
LESSON_VERDICTS_LIMIT = 100
LESSON_END_S = 5.0
TEACH_KEPT, FORGET_KEPT = "every take is kept", "what was removed stays removed; forget it again for the rest"
"""What stopping loses: nothing."""
BUSY = "a lesson is going on, perhaps from another phone; it is shown here"


class LessonServer:
    """Where pages look at the lesson of a scene and press; `close` ends it.

    lesson: that which goes on, or the last one. silent: the observers that run and do not answer. scene_state: what the
    fusion service says.
    """

    def __init__(self, scene: Scene, link: Link) -> None:
        self.scene = scene
        self._client = TeachingClient(link, scene.keys)
        self._quick_client = TeachingClient(link, scene.keys, answer_s=1.0, attempts=1)
        self._presence = presence_of(scene, link)
        self._lock = threading.Lock()
        self.lesson: PageLesson | None = None
        self._replies: dict[str, TeachReply] = {}
        self.silent: frozenset[str] = frozenset()
        self.scene_state = SceneState(scene.scene, scene.roster)
        self._arrived: deque[ArrivedVerdict] = deque(maxlen=LESSON_VERDICTS_LIMIT)
        self._looked_s = float("-inf")
        self._own_id, self._closed = secrets.token_hex(8), threading.Event()
        self.version = 0
        self._thread = threading.Thread(target=self._look, name="teach-look", daemon=True)
        self._thread.start()

    @property
    def observers(self) -> dict[str, TeachReply | None]:
        """The newest reply of every observer of the scene file; None for one that does not run or answer."""
        return {name: self._replies.get(name) for name in self.scene.roster}

    def looked(self) -> None:
        """A page asks how things stand."""
        self._looked_s = time.monotonic()

    def note(self, update: SceneUpdate) -> None:
        """Take in what a listener to the scene has received, in its thread."""
        changed = update.state.labels != self.scene_state.labels or isinstance(update.message, VerdictMessage)
        self.scene_state = update.state
        if isinstance(update.message, VerdictMessage):
            self._arrived.append(ArrivedVerdict(update.message, update.answered))
        if changed:
            self._changed()

    @property
    def verdicts(self) -> list[VerdictMessage]:
        """The verdicts that can be corrected, newest first."""
        state, kept_s = self.scene_state, 60 * self.scene.teaching.remember_minutes
        now_ns = fusion_ns(state, state.now_ns)
        return [each for each in state.verdicts if now_ns - each.began_ns < kept_s * SECOND_NS]

    def start(self, plan: LessonPlan) -> None:
        """Begin a lesson; raises BadInput, one line, if it cannot."""

        def teach(lesson: PageLesson, present: Sequence[str]) -> None:
            Lesson(plan, lesson.interface, self._ask, present).run()

        self._require_teachable()
        self._begin(plan.teacher, plan, teach)

    def correct(self, wanted: WantedCorrections) -> None:
        """Learn what movements really were; raises BadInput, one line, if it cannot begin."""
        self._require_teachable()
        state = self.scene_state
        corrections = corrections_of(
            wanted, self.verdicts, fusion_ns(state, time.time_ns()), 60 * self.scene.teaching.remember_minutes
        )

        def learn_anew(lesson: PageLesson, present: Sequence[str]) -> None:
            participants, offsets = self._participants(lesson, present), clock_offsets(state)
            learn_from(participants, corrections, offsets, wanted.person, lesson.examples)

        self._begin(secrets.token_hex(8), None, learn_anew, "correct")

    def forget(self, unwanted: Unwanted, *, clips: bool) -> None:
        """Remove a person's takes, a movement's, or everything; raises BadInput, one line, if it cannot begin.

        clips: delete clips of verdicts too.
        """

        def forget_everywhere(lesson: PageLesson, present: Sequence[str]) -> None:
            missing = [name for name in self.scene.roster if name not in present]
            forget(self._participants(lesson, present), unwanted, missing, clips=clips)
            lesson.interface.say(untouched_line(clip_keepers_of(self.scene), clips=clips))

        self._begin(secrets.token_hex(8), None, forget_everywhere, "forget")

    def _participants(self, lesson: PageLesson, present: Sequence[str]) -> Participants:
        return Participants(lesson.id, lesson.interface, self._ask, list(present), add=True)

    def _require_teachable(self) -> None:
        if self.scene.vocabulary is not None:
            raise BadInput(
                "the scene file names its vocabulary, so nothing else can be taught; remove that line and start the "
                "processes again"
            )

    def _begin(
        self,
        lesson_id: str,
        plan: LessonPlan | None,
        work: Callable[[PageLesson, Sequence[str]], None],
        purpose: Purpose = "lesson",
    ) -> None:
        present = names_of(self._presence, self.scene)
        if not present:
            raise BadInput("no observer runs; start them with: labanmesh up, and the scene file")
        with self._lock:
            if self.lesson is not None and not self.lesson.over:
                raise BadInput(BUSY)
            self._arrived.clear()
            interface = PageInterface(
                self._changed, lambda: self.scene_state.labels, lambda: newly_decided(self._arrived)
            )
            lesson = PageLesson(lesson_id, plan, interface, purpose)
            lesson.thread = threading.Thread(target=self._run, args=(lesson, present, work), name="lesson", daemon=True)
            self.lesson = lesson
        self._changed()
        lesson.thread.start()

    def press(self, lesson_id: str, number: int, action: Action) -> None:
        """Somebody presses, who saw that step of that lesson; raises BadInput, one line, if it cannot be done."""
        lesson = self.lesson
        if lesson is None or lesson.over or lesson.id != lesson_id:
            raise BadInput(MOVED_ON)
        lesson.interface.press(number, action)

    def stop(self, lesson_id: str) -> None:
        """End the lesson with that id; what was recorded is kept. One that is over is put away."""
        lesson = self.lesson
        if lesson is None or lesson.id != lesson_id:
            return
        lesson.interface.end()
        if lesson.over:
            self.lesson = None
        self._changed()

    def now(self, observer: str) -> ShownTracks | None:
        """What an observer sees now, None if it does not answer; raises BadInput for an unknown one."""
        return self._show(observer, TeachRequest(command="show", teacher=self._own_id))

    def take(self, observer: str, label: str, number: int) -> ShownTracks | None:
        """A take on an observer's disk, None if it does not answer; raises BadInput for an unknown observer."""
        return self._show(observer, TeachRequest(command="show", teacher=self._own_id, label=label, take=number))

    def close(self) -> None:
        """End the lesson and all requests."""
        self._closed.set()
        lesson = self.lesson
        if lesson is not None and lesson.thread is not None:
            lesson.interface.end()
            lesson.thread.join(LESSON_END_S)
        self._thread.join(LESSON_END_S)

    def _show(self, observer: str, request: TeachRequest) -> ShownTracks | None:
        if observer not in self.scene.roster:
            raise BadInput(f"observer {observer!r} is unknown; known: {', '.join(self.scene.roster)}")
        reply = self._quick_client.ask(request, [observer]).replies.get(observer)
        return None if reply is None else reply.tracks

    def _run(
        self, lesson: PageLesson, present: Sequence[str], work: Callable[[PageLesson, Sequence[str]], None]
    ) -> None:
        try:
            replies = self._ask(TeachRequest(command="status", teacher=lesson.id), present).replies
            if not replies:
                raise LabanmeshError(NO_RIGHT)
            work(lesson, list(replies))
        except KeyboardInterrupt:
            lesson.fault, lesson.stopped = FORGET_KEPT if lesson.purpose == "forget" else TEACH_KEPT, True
        except LabanmeshError as error:
            lesson.fault = reworded(str(error), TYPED)
        except Exception:
            lesson.fault = "an error of labanmesh ended this; its log says more"
            log.exception("lesson")
        finally:
            if lesson.purpose != "lesson":
                self._ask(TeachRequest(command="leave", teacher=lesson.id), present)
            lesson.over = True
            self._changed()

    def _ask(self, request: TeachRequest, observers: Collection[str]) -> Answers:
        answers = self._client.ask(request, observers)
        self._take_in(answers)
        return answers

    def _look(self) -> None:
        """Ask the observers for their state while a page is open or a lesson waits: it stays their teacher."""
        while not self._closed.is_set():
            lesson = self.lesson
            idle_s = time.monotonic() - self._looked_s
            goes_on = lesson is not None and not lesson.over
            waits = goes_on and lesson is not None and lesson.interface.shown.waits
            if lesson is not None and waits and idle_s > LESSON_LEFT_S:
                lesson.interface.end()
            if waits or (idle_s < TEACHER_LEASE_S and not goes_on):
                teacher = lesson.id if lesson is not None and waits else self._own_id
                status = TeachRequest(command="status", teacher=teacher)
                self._take_in(self._quick_client.ask(status, names_of(self._presence, self.scene)))
            self._closed.wait(REPLY_LOOK_S if self._replies else FIRST_S)

    def _take_in(self, answers: Answers) -> None:
        alive = names_of(self._presence, self.scene)
        with self._lock:
            replies = {name: each for name, each in {**self._replies, **answers.replies}.items() if name in alive}
            silent = (self.silent | set(answers.silent)) - set(answers.replies)
            changed = replies != self._replies or silent != self.silent
            self._replies, self.silent = replies, frozenset(silent & set(alive))
        if changed:
            self._changed()

    def _changed(self) -> None:
        self.version += 1
