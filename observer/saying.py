"""An observer's opinion as the message that says it. Pure."""

from common.facing import surprise_of
from common.messages import Facing, PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from observer.opinion import OpinionLike


class Minutes:
    """Numbers an observer's opinions; a new session begins with each start.

    directed: whether it is known which way the observer looks, so that others can use what it says of facing.
    """

    def __init__(self, scene: str, observer: str, vocabulary: Vocabulary, session: str, directed: bool = True) -> None:
        self._scene, self._observer, self._session, self._directed = scene, observer, session, directed
        self._vocabulary = VocabularyReference(name=vocabulary.name, hash=vocabulary.digest)
        self.seq = 0

    def of(self, opinion: OpinionLike, captured_ns: int, now_ns: int) -> PosteriorMessage:
        """The opinion about the frame captured at `captured_ns`."""
        facing = opinion.facing if self._directed else None
        message = PosteriorMessage(
            scene=self._scene,
            observer=self._observer,
            seq=self.seq,
            session=self._session,
            captured_ns=captured_ns,
            sent_ns=now_ns,
            vocabulary=self._vocabulary,
            p=opinion.p.tolist(),
            rest=opinion.rest,
            unlearned=opinion.unlearned,
            frames=opinion.frames,
            visible=dict(opinion.visible),
            facing=None if facing is None else Facing(surprise=surprise_of(facing).tolist()),
            facets={name: p.tolist() for name, p in opinion.facets.items()} or None,
        )
        self.seq += 1
        return message
