"""The lesson of the scene on a phone's page: how it stands, and what is pressed there.

Whoever was admitted as a camera may teach: its tracks decide what the observer believes anyhow. Forgetting and
corrections stay with the Teach page and the terminal.
"""

import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from common.errors import BadInput
from hub.phone.phone_messages import LessonRequest
from hub.teaching.lesson_data import action_of, lesson_server_data, plan_of
from hub.teaching.lesson_server import TEACHER_LEASE_S
from hub.teaching.wording import known_labels

if TYPE_CHECKING:
    from hub.teaching.lesson_server import LessonServer


@dataclass(slots=True)
class PhoneLessons:
    """clock: seconds of a monotonic clock."""

    server: "LessonServer"
    clock: Callable[[], float] = time.monotonic
    _looked_s: float = field(default=float("-inf"), init=False)

    def ask(self, request: LessonRequest) -> str:
        """Do what a phone asks; why that cannot be done, one line, or ""."""
        try:
            self._do(request)
        except BadInput as error:
            return str(error)
        return ""

    def data(self) -> Mapping[str, object] | None:
        """What the pages show; None while nobody looks at a lesson."""
        return lesson_server_data(self.server) if self.clock() - self._looked_s < TEACHER_LEASE_S else None

    def _do(self, request: LessonRequest) -> None:
        self._looked_s = self.clock()
        self.server.looked()
        if request.ask == "start":
            self.server.start(plan_of(request.plan, known_labels(self.server.observers), secrets.token_hex(8)))
        elif request.ask == "press":
            self.server.press(request.lesson, request.number, action_of(request.model_dump()))
        elif request.ask == "stop":
            self.server.stop(request.lesson)
