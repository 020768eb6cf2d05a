"""How an observer is, from two things that can be wrong: its camera, and what can be made out in the picture. Pure."""

from collections.abc import Callable

from common.messages import ProcessState

Tell = Callable[[ProcessState, str], None]


class Condition:
    """Folds the camera's reports and the tracker's complaints into one state, and tells each change once.

    Starting until the first frame; degraded while the camera is lost or frozen, or else while the tracker complains.
    """

    def __init__(self) -> None:
        self._tell: Tell | None = None
        self._fault, self._complaint, self._started = "", "", False
        self._told: tuple[ProcessState, str] | None = None

    @property
    def complaint(self) -> str:
        """What the tracker complained of last; "" when all is well."""
        return self._complaint

    def tell_to(self, tell: Tell) -> None:
        """From now on each change is told to `tell(state, reason)`, in the thread in which it is heard."""
        self._tell = tell
        self._say()

    def camera(self, state: ProcessState, reason: str) -> None:
        """A `observer.camera.base.Report`: degraded with the reason, or running."""
        self._fault = reason if state == "degraded" else ""
        self._say()

    def frame(self, complaint: str) -> None:
        """A frame was worked on; complaint: why little can be made out in it, "" when all is well."""
        self._started, self._complaint = True, complaint
        self._say()

    def _say(self) -> None:
        reason = self._fault or self._complaint
        if self._tell is None or not (reason or self._started):
            return
        now: tuple[ProcessState, str] = ("degraded" if reason else "running", reason)
        if now != self._told:
            self._told = now
            self._tell(*now)
