"""Listens to the verdicts of a scene as a hub does, and waits for one."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeVar

from common.keys import SceneKeys
from common.link import Link
from common.messages import JudgementMessage, VerdictMessage
from common.same_movement import SameMovement
from common.wire import BadMessage, decode
from labanmesh_testing.mesh import running

LISTENER_TAKE_S = 0.05
"""How long one look into the inbox waits, so that the end of a scene is soon noticed."""
T = TypeVar("T")


class VerdictListener:
    """All verdicts of a scene in the order of arrival, and its newest judgement.

    A movement has a verdict when it is decided, one whenever that is revised, and one when it has ended; they share an
    id, and only the last has `ended_ns`.
    """

    def __init__(self, keys: SceneKeys, link: Link) -> None:
        self.verdicts: list[VerdictMessage] = []
        self.judgement: JudgementMessage | None = None
        self._fault: Exception | None = None
        self._callbacks: list[Callable[[VerdictMessage], object]] = []
        self._same = SameMovement()
        self._changed, self._keys = threading.Condition(), keys
        # One inbox for both, so that a verdict precedes the judgement that shows it.
        self._inbox = link.inbox(keys.verdict, keys.judgement)

    def on_verdict(self, callback: Callable[[VerdictMessage], object]) -> None:
        """Call `callback(verdict)` for each verdict from now on, before `wait_for_verdict` returns it."""
        self._callbacks.append(callback)

    def wait_for_verdict(
        self, label: str | None = None, timeout: float = 10.0, *, ended: bool = False
    ) -> VerdictMessage:
        """The first verdict of `label` that arrived or arrives within `timeout` seconds; None: of any label.

        ended: only one whose movement has ended. Raises AssertionError that lists what arrived instead.
        """

        def first() -> VerdictMessage | None:
            fitting = (v for v in self.verdicts if label in (None, v.label) and not (ended and v.ended_ns is None))
            return next(fitting, None)

        return self._wait(first, timeout, f"no verdict {label or ''}")

    def wait_for_judgement(
        self, fits: Callable[[JudgementMessage], object] = bool, timeout: float = 10.0
    ) -> JudgementMessage:
        """The newest judgement as soon as `fits(judgement)`; raises AssertionError after `timeout` seconds."""

        def newest() -> JudgementMessage | None:
            return self.judgement if self.judgement is not None and fits(self.judgement) else None

        return self._wait(newest, timeout, "no such judgement")

    def check(self) -> None:
        """Raise the exception of a callback, once."""
        fault, self._fault = self._fault, None
        if fault is not None:
            raise fault

    def _wait(self, arrived: Callable[[], T | None], timeout: float, otherwise: str) -> T:
        with self._changed:
            result: list[T | None] = [None]

            def over() -> bool:
                result[0] = arrived()
                return result[0] is not None or self._fault is not None

            self._changed.wait_for(over, timeout)
            self.check()
            if result[0] is None:
                raise AssertionError(f"{otherwise} within {timeout:g} s; {self._state()}")
            return result[0]

    def _state(self) -> str:
        """One line on what arrived."""
        verdicts = ", ".join(f"{v.label}{'' if v.ended_ns is None else ' (ended)'}" for v in self.verdicts) or "none"
        if self.judgement is None:
            return f"verdicts: {verdicts}; no judgement"
        votes = ", ".join(f"{name} {vote.label} ({vote.state})" for name, vote in self.judgement.votes.items())
        return f"verdicts: {verdicts}; the last judgement: {self.judgement.label!r} by {votes}"

    def _listen(self, stop: threading.Event) -> None:
        while not stop.is_set():
            for arrival in self._inbox.take(LISTENER_TAKE_S):
                with suppress(BadMessage):
                    if arrival.key == self._keys.verdict:
                        self._add(self._same.take(decode(VerdictMessage, arrival.payload)))
                    else:
                        self.judgement = self._same.judged(decode(JudgementMessage, arrival.payload))
            with self._changed:
                self._changed.notify_all()

    def _add(self, verdict: VerdictMessage | None) -> None:
        if verdict is None:
            return
        try:
            for callback in tuple(self._callbacks):
                callback(verdict)
        except Exception as error:  # noqa: BLE001 - raised in the test's thread
            self._fault = error
        self.verdicts.append(verdict)


@contextmanager
def listening(keys: SceneKeys, link: Link) -> Iterator[VerdictListener]:
    """A listener with a thread of its own; an exception of a callback is raised by the next wait, or at the end."""
    listener = VerdictListener(keys, link)
    with running(listener._listen):
        yield listener
    listener.check()
