"""The part of a session on the mesh that the worker of one of several people of a scene has.

It publishes by itself. What may be declared only once for the scene, `PeopleWorker` declares: the answers to queries,
the subscriptions, the presence of the observers.
"""

from collections.abc import Callable, Iterable, Sequence

from common.inbox import NewestMessages, Presence
from common.subsession import SubSession

Answer = Callable[[], bytes | Sequence[bytes] | None]


class PersonSession(SubSession):
    """answers: by key, what this person's worker has to answer a query with."""

    def __init__(self, scene: SubSession, present: Presence) -> None:
        """scene: whose session it is a part of; present: the observers that are."""
        super().__init__(scene)
        self._present = present
        self.answers: dict[str, Answer] = {}

    def answer(self, key: str, last: Answer) -> None:
        """Keep `last` in `answers`."""
        self.answers[key] = last

    def answer_requests(self, key: str, respond: Callable[[bytes], bytes | None]) -> None:
        """Nothing: the scene is handed over as a whole."""

    def presence(self, key_expression: str, expected: Iterable[str] = ()) -> Presence:
        """The presence of the scene's observers."""
        return self._present

    def newest(self, *keys: str) -> NewestMessages:
        """None ever: the worker is given what has arrived for its person."""
        return NewestMessages()
