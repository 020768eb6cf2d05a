"""Whose a posterior is, in a scene that judges several people: arrivals are sorted by person. The design: people.md."""

from collections.abc import Callable, Sequence

from common import SECOND_NS
from common.arrival import Arrival
from common.keys import observer_of
from common.messages import PosteriorMessage
from common.wire import BadMessage, decode_from
from fusion.people import ScenePeople, SeenTrack

OLDEST_S = 2.0
"""A posterior that claims to be older was seen when it arrived, as far as places are concerned."""
TRACKS_LIMIT = 8
"""Tracks of one observer in one batch; of more, as a process that invents them sends, only the first count."""


class PeopleIngest:
    """Sorts the posteriors of one scene. skew_s: by which an observer's clock is ahead."""

    def __init__(self, people: ScenePeople, roster: Sequence[str], skew_s: Callable[[str], float | None]) -> None:
        self.people, self._roster, self._skew_s = people, frozenset(roster), skew_s
        self._first = people.ids[0]

    def sort(self, arrivals: Sequence[Arrival], now_ns: int) -> dict[str, list[Arrival]]:
        """The arrivals by person. What cannot be read, or is of no observer, goes to the first, to be counted.

        A posterior without a track is of the one person in the room; if there are several, nobody knows whose it is.
        """
        result: dict[str, list[Arrival]] = {}
        tracks: list[tuple[Arrival, str, str]] = []
        sightings: dict[str, list[SeenTrack]] = {}
        for arrival in arrivals:
            observer, message = observer_of(arrival.key), None
            if observer in self._roster:
                message = _decoded(arrival)
            if message is None:
                result.setdefault(self._first, []).append(arrival)
            elif message.person is None or message.place is None:
                tracks.append((arrival, observer, ""))
            else:
                of_observer = sightings.setdefault(observer, [])
                known = {each.track for each in of_observer}
                if message.person in known or len(known) < TRACKS_LIMIT:
                    at_ns = self._seen_ns(observer, message.captured_ns, now_ns)
                    of_observer.append(SeenTrack(observer, message.person, message.place, at_ns))
                    tracks.append((arrival, observer, message.person))
        self.people.update([each for own in sightings.values() for each in own], now_ns)
        present = self.people.present
        alone = present[0] if present else self._first
        for arrival, observer, track in tracks:
            person = self.people.person_of(observer, track) if track else alone if len(present) < 2 else None
            if person is not None:
                result.setdefault(person, []).append(arrival)
        return result

    def _seen_ns(self, observer: str, captured_ns: int, now_ns: int) -> int:
        at_ns = captured_ns - round((self._skew_s(observer) or 0.0) * SECOND_NS)
        return at_ns if 0 <= now_ns - at_ns <= OLDEST_S * SECOND_NS else now_ns


def _decoded(arrival: Arrival) -> PosteriorMessage | None:
    try:
        return decode_from(arrival.key, PosteriorMessage, arrival.payload)
    except BadMessage:
        return None
