"""An observer's opinion as the message that says it, no larger than it must be. Pure."""

from common.messages import Facing, PosteriorMessage, VocabularyHash
from common.probability import encode_facing
from common.vocabulary import Vocabulary
from observer.opinion import OpinionLike


class Minutes:
    """Numbers an observer's opinions; a new session begins with each start.

    directed: whether it is known which way the observer looks, so that others can use what it says of facing. What
    the key says, and that all parts are seen, is left out.
    """

    def __init__(self, vocabulary: Vocabulary, session: str, directed: bool = True) -> None:
        self._session, self._directed = session, directed
        self._vocabulary = VocabularyHash(hash=vocabulary.digest)
        self.seq = 0

    def of(self, opinion: OpinionLike, captured_ns: int, now_ns: int) -> PosteriorMessage:
        """The opinion about the frame captured at `captured_ns`."""
        facing = opinion.facing if self._directed else None
        message = PosteriorMessage(
            v=2,
            seq=self.seq,
            session=self._session,
            captured_ns=captured_ns,
            sent_ns=now_ns,
            vocabulary=self._vocabulary,
            p=opinion.p.tolist(),
            rest=opinion.rest,
            unlearned=opinion.unlearned,
            frames=opinion.frames,
            visible={} if all(opinion.visible.values()) else dict(opinion.visible),
            facing=None if facing is None else Facing(surprise=encode_facing(facing).tolist()),
            facets={name: p.tolist() for name, p in opinion.facets.items()} or None,
        )
        self.seq += 1
        return message
