"""One room with recorded people, virtual cameras in its corners and the fusion of what they see. SIMULATED."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from common import SECOND_NS
from common.config_people import PeopleConfig
from common.config_sections import FusionConfig
from common.messages import VerdictMessage
from common.posterior import PosteriorMessage
from common.wire import decode, encode
from fusion.engine.engine import FusionEngine
from fusion.people import ScenePeople
from fusion.people_ingest import PeopleIngest
from observer.geometry.placement import PersonPlacement
from observer.geometry.projection import pinhole_matrix
from observer.geometry.views import View
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.projected import ProjectedPeople, placed
from observer.prepared_tracks import PreparedTracker, Resampler
from observer.runtime.people_observer import FloorPlacer, PeopleObserver
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.tracking.person_keeper import of_people
from observer.tracks import WHOLE_BODY, Floats, Frame, Tracker
from studies.performer.perform import minimum_jerk
from studies.trials import strung

CORNERS_DEG = (45, -45, 135, -135)
"""Where the first, the second ... camera stands, seen from the middle of the room; 0 is before the people."""
DISTANCE_M, PITCH_DEG, FOCAL_PX, SIZE_PX = 3.5, 15.0, 520.0, (640, 480)
WALK_S, ASIDE_M = 2.5, 0.3
"""They cross in this time, each so far from the line between their places."""
BEGIN_NS = 1_700_000_000 * SECOND_NS
LATE_NS = 30_000_000
"""From a frame's capture until its posteriors are fused."""


@dataclass(frozen=True, slots=True, eq=False)
class RoomPart:
    """One person's part. positions: (F, P, 3), in the room. crossing: frames, begin and end. spans: as performed."""

    positions: Floats
    crossing: tuple[int, int]
    spans: Sequence[Span]


@dataclass(slots=True)
class Run:
    """verdicts: ended. places: by person, (frame, x, z). observers_s, fusion_s: processor time of all frames."""

    verdicts: list[VerdictMessage] = field(default_factory=list)
    places: dict[str, list[tuple[int, float, float]]] = field(default_factory=dict)
    observers_s: float = 0.0
    fusion_s: float = 0.0

    def id_at(self, frame: int, at: Floats) -> str | None:
        """Who was nearest to a place in that frame."""
        near = {
            person: float(np.hypot(x - at[0], z - at[2]))
            for person, places in self.places.items()
            for n, x, z in places
            if n == frame
        }
        return min(near, key=lambda person: near[person], default=None)

    def id_of(self, person: RoomPart, first: int, last: int) -> str | None:
        """Who was nearest to a person in most of the frames from `first` up to `last`."""
        ids = Counter(self.id_at(frame, middle_of(person, frame)) for frame in range(first, last))
        del ids[None]
        return max(ids, key=lambda person: ids[person], default=None)


def camera(number: int) -> View:
    """One of the virtual cameras."""
    yaw, pitch = np.radians(CORNERS_DEG[number]), np.radians(PITCH_DEG)
    middle = (SIZE_PX[0] / 2, SIZE_PX[1] / 2)
    matrix = pinhole_matrix(float(yaw), float(pitch), DISTANCE_M, FOCAL_PX, middle, (0.0, 0.9, 0.0))
    return View(f"corner{number}", matrix, None, SIZE_PX)


def performed(recordings: Sequence[Recording], parts: tuple[str, ...], places: tuple[Floats, Floats], aside: float,
              rng: np.random.Generator) -> RoomPart:  # fmt: skip
    """Half of the recordings at the first place, the others at the second, and the walk in between."""
    half = len(recordings) // 2
    halves, spans, frames = [], list[Span](), 0
    for which, at in zip((recordings[:half], recordings[half:]), places, strict=True):
        (stream,) = strung(which, rng)
        archive = MotionArchive(parts, (stream,))
        (stream,) = placed(archive, PersonPlacement(float(at[0]), float(at[1]))).recordings
        halves.append(stream.positions.astype(np.float64))
        spans += [Span(frames + s.start, frames + s.end, s.label) for s in stream.spans]
        frames += len(stream.positions) + (0 if spans[1:] and len(halves) > 1 else round(WALK_S * stream.rate_hz))
    first, second = halves
    share = minimum_jerk(np.linspace(0, 1, round(WALK_S * recordings[0].rate_hz)))[:, None, None]
    between = first[-1] * (1 - share) + second[0] * share
    between[:, :, 2] += aside * np.sin(np.pi * share[:, :, 0])
    walked = np.concatenate([first, between, second])
    return RoomPart(walked, (len(first), len(first) + len(between)), spans)


def together(one: RoomPart, other: RoomPart) -> tuple[RoomPart, RoomPart]:
    """The same, crossing at one time and equally long: who is ready earlier waits."""
    begin = max(one.crossing[0], other.crossing[0])
    padded = [_waiting(each, begin - each.crossing[0], each.crossing[0]) for each in (one, other)]
    length = max(len(each.positions) for each in padded)
    first, second = (_waiting(each, length - len(each.positions), len(each.positions)) for each in padded)
    return first, second


def _waiting(person: RoomPart, frames: int, before: int) -> RoomPart:
    still = np.repeat(person.positions[before - 1 : before], frames, axis=0)
    positions = np.concatenate([person.positions[:before], still, person.positions[before:]])
    begin, end = (at + frames if at >= before else at for at in person.crossing)
    moved = [Span(s.start + frames, s.end + frames, s.label) if s.start >= before else s for s in person.spans]
    return RoomPart(positions, (begin, end), moved)


class Stage:
    """The observers and the fusion of one room, in one process."""

    def __init__(self, models: Sequence[MovementModel], rate_hz: float, most: int = 2) -> None:
        self._vocabulary, self._rate_hz = models[0].header.vocabulary, rate_hz
        parts = of_people(WHOLE_BODY, most)
        names = [f"corner{number}" for number in range(len(models))]
        self._observers = []
        for number, model in enumerate(models):
            view = camera(number)
            tracker = PreparedTracker(ProjectedPeople(view, parts, most), model.header.body_parts, view)
            self._observers.append(PeopleObserver(tracker, _maker(model), FloorPlacer(view, None, alone=False)))
        self._names = names
        self._encoders = [PosteriorEncoder(self._vocabulary, f"s{number}") for number in range(len(models))]
        ids = PeopleConfig(most=most).ids
        config = FusionConfig(quorum=(len(names) + 1) // 2)
        self._engines = {p: FusionEngine("people", names, self._vocabulary, config, p) for p in ids}
        self._people = ScenePeople(ids)
        self._ingest = PeopleIngest(self._people, lambda _: None)

    def run(self, positions: Floats) -> Run:
        """Judge (F, most P, 3)."""
        run = Run()
        for n, content in enumerate(positions):
            at_ns = BEGIN_NS + round(n * SECOND_NS / self._rate_hz)
            now_ns, begun_s = at_ns + LATE_NS, time.process_time()
            payloads = []
            for observer, encoder, name in zip(self._observers, self._encoders, self._names, strict=True):
                posterior = observer.step(Frame(at_ns, content))
                messages = [encoder.encode(each, at_ns, at_ns) for each in (posterior, *posterior.others)]
                payloads += [(name, encode(message)) for message in messages]
            observed_s = time.process_time()
            posteriors = [(name, decode(PosteriorMessage, payload)) for name, payload in payloads]
            for person, own in self._ingest.sort(posteriors, now_ns).items():
                for name, message in own:
                    self._engines[person].receive(name, message, now_ns)
            for person, engine in self._engines.items():
                output = engine.step(now_ns)
                run.verdicts += [verdict for verdict in output.verdicts if verdict.stage == "ended"]
                if (at := self._people.place(person, now_ns)) is not None:
                    run.places.setdefault(person, []).append((n, *at))
            run.observers_s += observed_s - begun_s
            run.fusion_s += time.process_time() - observed_s
        return run


def _maker(model: MovementModel) -> Callable[[Tracker], Observer]:
    def new(tracker: Tracker) -> Observer:
        return Observer(tracker, model, None, Resampler(model.header.rate_hz))

    return new


def middle_of(person: RoomPart, frame: int) -> Floats:
    """(3,) the mean of the body, where it was recorded last up to that frame: recordings have gaps."""
    for body in person.positions[frame::-1]:
        seen = body[np.isfinite(body).all(axis=1)]
        if len(seen):
            middle: Floats = seen.mean(axis=0)
            return middle
    return np.full(3, np.nan)
