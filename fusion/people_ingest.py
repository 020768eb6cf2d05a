"""Whose a posterior is, in a scene that judges several people: they are sorted by person. The design: people.md."""

from collections.abc import Callable, Iterable

from common import SECOND_NS
from common.messages import ObserverPosterior
from fusion.people import ScenePeople, SeenTrack

OLDEST_S = 2.0
"""A posterior that claims to be older was seen when it arrived, as far as places are concerned."""
TRACKS_LIMIT = 8
"""Tracks of one observer in one batch; of more, as a process that invents them sends, only the first count."""


class PeopleIngest:
    """Sorts the posteriors of one scene. skew_s: by which an observer's clock is ahead."""

    def __init__(self, people: ScenePeople, skew_s: Callable[[str], float | None]) -> None:
        self.people, self._skew_s = people, skew_s

    def sort(self, posteriors: Iterable[ObserverPosterior], now_ns: int) -> dict[str, list[ObserverPosterior]]:
        """The posteriors by person.

        One without a track is of the one person in the room; if there are several, nobody knows whose it is.
        """
        tracks: list[tuple[ObserverPosterior, str]] = []
        sightings: dict[str, list[SeenTrack]] = {}
        for posterior in posteriors:
            observer, message = posterior
            if message.person is None or message.place is None:
                tracks.append((posterior, ""))
            else:
                of_observer = sightings.setdefault(observer, [])
                known = {each.track for each in of_observer}
                if message.person in known or len(known) < TRACKS_LIMIT:
                    at_ns = self._seen_ns(observer, message.captured_ns, now_ns)
                    of_observer.append(SeenTrack(observer, message.person, message.place, at_ns))
                    tracks.append((posterior, message.person))
        self.people.update([each for own in sightings.values() for each in own], now_ns)
        present = self.people.present
        alone = present[0] if present else self.people.ids[0]
        result: dict[str, list[ObserverPosterior]] = {}
        for posterior, track in tracks:
            person = self.people.person_of(posterior[0], track) if track else alone if len(present) < 2 else None
            if person is not None:
                result.setdefault(person, []).append(posterior)
        return result

    def _seen_ns(self, observer: str, captured_ns: int, now_ns: int) -> int:
        at_ns = captured_ns - round((self._skew_s(observer) or 0.0) * SECOND_NS)
        return at_ns if 0 <= now_ns - at_ns <= OLDEST_S * SECOND_NS else now_ns
