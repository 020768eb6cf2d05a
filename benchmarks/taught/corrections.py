"""Ten corrections: somebody teaches a few takes, and what is named wrongly or missed later is corrected.

1. One person teaches some movements with two takes each, all that MSR Action3D leaves for it. Or, of other people than
   those with whom all this was settled: whole-body movements (nw_ucla), gestures (Florence 3D Actions: one take of what
   is done in the evenings, and the last for later).
2. Evenings: this person and another one do these and other movements, each of their first two takes once, and then
   again in another tempo. The first ten wrong or missed verdicts are corrected as `labanmesh teach --was` does: each
   camera cuts its example out of the tracks that it remembers, by the time of the verdict, or of a missed movement by
   the moment that the person names. All cameras learn anew after each evening.
3. The third takes of both people (of nw_ucla the fourth too) are judged before and after. None of them was learned or
   corrected.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.taught.few_takes import RecordedRoom, streams_of
from benchmarks.taught.households import PEOPLE, TAUGHT_TAKES, Draws, Household, households, one_camera, ordinary_life
from benchmarks.taught.judging import TaughtModels, verdicts_on
from common import SECOND_NS
from common.errors import BadInput
from common.parallel import cores, run_parts
from common.teaching_messages import SOMEONE
from common.vocabulary import ABSTAIN
from observer.learning.learn import of_one_person
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, Recording, Span, retime
from observer.recording.own_tracks import TracksRecorder
from observer.teaching import corrections
from observer.tracks import BODY_PARTS, Frame, Tracks
from studies.spotting import StreamVerdict

Progress = Callable[[int, int], None]
CORRECTIONS = 10
TEMPI = (1.0, 0.8, 1.25)
"""If there were fewer errors, the same takes are done again, slower and then faster."""
LATER_TAKES = 2
NEAR_S = 0.5
"""A verdict this near to a performance is about it."""


@dataclass(frozen=True, slots=True)
class Errors:
    """Performances of taught movements: shown, missed, named wrongly; other movements: shown, named."""

    shown: int = 0
    missed: int = 0
    wrong: int = 0
    others: int = 0
    named: int = 0

    @property
    def share(self) -> float:
        """Of all performances, how many have no verdict or a wrong one."""
        return (self.missed + self.wrong + self.named) / max(self.shown + self.others, 1)

    def plus(self, other: "Errors") -> "Errors":
        """The sum of both."""
        return Errors(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(Errors)))


@dataclass(frozen=True, slots=True)
class JudgedPerformance:
    """A span of a stream in seconds, its movement ("" for one that is not taught), and the verdict about it."""

    begin_s: float
    end_s: float
    label: str
    verdict: StreamVerdict | None

    @property
    def is_right(self) -> bool:
        """Whether the first word of the verdict is right; abstaining is right of what is no movement."""
        name = "" if self.verdict is None or self.verdict.label == ABSTAIN else self.verdict.label
        return name == self.label


@dataclass(frozen=True, slots=True)
class Corrected:
    """Of one household: its errors in later performances, before and after; corrections made, and those that failed."""

    household: Household
    before: Errors
    after: Errors
    made: int
    failed: int


@dataclass(frozen=True, slots=True)
class Evening:
    """One person's performances as a stream of each camera, all of the same body parts."""

    streams: Mapping[str, Recording]
    body_parts: tuple[str, ...] = BODY_PARTS

    def performances(self, labels: Sequence[str], models: Mapping[str, MovementModel]) -> list[JudgedPerformance]:
        """What was done, and what the fusion service said to it."""
        verdicts = verdicts_on(self.streams, self.body_parts, models)
        first = next(iter(self.streams.values()))
        return [_performance(span, first.rate_hz, labels, verdicts) for span in first.spans]

    def recorders(self) -> dict[str, TracksRecorder]:
        """What each camera remembers at the end of it."""
        result = {}
        for name, stream in self.streams.items():
            recorder = TracksRecorder(self.body_parts, stream.rate_hz)
            for n, centres in enumerate(stream.positions):
                at_ns = round(n / stream.rate_hz * SECOND_NS)
                recorder.update(Frame(at_ns, np.empty(0)), Tracks(centres.astype(np.float64)))
            result[name] = recorder
        return result


def _performance(
    span: Span, rate_hz: float, labels: Sequence[str], verdicts: Sequence[StreamVerdict]
) -> JudgedPerformance:
    begin_s, end_s = span.start / rate_hz, span.end / rate_hz
    about = [v for v in verdicts if v.began_s is not None and v.began_s < end_s + NEAR_S and v.at_s > begin_s]
    about = [v for v in about if (v.ended_s or v.at_s) > begin_s]
    verdict = next((v for v in about if v.label != ABSTAIN), about[0] if about else None)
    return JudgedPerformance(begin_s, end_s, span.label if span.label in labels else "", verdict)


def errors_of(performances: Iterable[JudgedPerformance]) -> Errors:
    """Counts over performances."""
    total = Errors()
    for one in performances:
        named = one.verdict is not None and one.verdict.label != ABSTAIN
        if one.label:
            total = total.plus(Errors(1, missed=not named, wrong=named and not one.is_right))
        else:
            total = total.plus(Errors(others=1, named=named))
    return total


def evening(
    room: RecordedRoom, subject: str, labels: Sequence[str], takes: Sequence[str], seed: int, tempo: float = 1.0
) -> Evening | None:
    """These takes of a person, in random order between rests; None if there are none."""
    first = next(iter(room.space.values()))
    shown = [r for r in first.recordings if r.subject == subject and r.label in labels and r.trial in takes]
    shown = [retime(recording, tempo) for recording in shown] if tempo != 1.0 else shown
    return Evening(streams_of(room, shown, seed), room.body_parts) if shown else None


def examples_from(
    part: Evening, wrong: Sequence[JudgedPerformance], name_of_evening: str
) -> tuple[dict[str, list[Recording]], int]:
    """What each camera cuts out of what it remembers, as `labanmesh teach --was`; how many could not be cut."""
    recorders = part.recorders()
    result: dict[str, list[Recording]] = {name: [] for name in recorders}
    failed = 0
    for n, performance in enumerate(wrong):
        for name, recorder in recorders.items():
            try:
                cut, _ = corrections.example_of(recorder, _span(performance), label=performance.label, subject=SOMEONE)
            except BadInput:
                failed += 1
                continue
            result[name].append(replace(cut, trial=f"corrected {name_of_evening}.{n}"))
    return result, failed


def _span(performance: JudgedPerformance) -> corrections.CapturedSpan:
    """The verdict's, or for none the moment that the person names."""
    verdict = performance.verdict
    if verdict is None or verdict.began_s is None:
        middle_ns = round((performance.begin_s + performance.end_s) / 2 * SECOND_NS)
        return corrections.CapturedSpan(middle_ns, middle_ns)
    ended_s = verdict.ended_s
    return corrections.CapturedSpan(
        round(verdict.began_s * SECOND_NS), None if ended_s is None else round(ended_s * SECOND_NS)
    )


Examples = Mapping[str, Sequence[Recording]]
Learn = Callable[[TaughtModels, Mapping[str, MotionArchive], Examples, Sequence[str]], Mapping[str, MovementModel]]


def learned(
    teaching: TaughtModels, taught: Mapping[str, MotionArchive], examples: Examples, labels: Sequence[str]
) -> Mapping[str, MovementModel]:
    """The models of all takes and examples, as an observer learns them."""
    grown = {name: replace(a, recordings=(*a.recordings, *examples[name])) for name, a in taught.items()}
    return teaching.models({name: of_one_person(archive) for name, archive in grown.items()}, labels)


def judge_household(home: Household, room: RecordedRoom, teaching: TaughtModels, learn: Learn = learned) -> Corrected:
    """Teach, play, correct and learn anew, and judge what comes later. learn: from takes and examples by camera."""
    trials = sorted({r.trial for r in next(iter(room.space.values())).recordings}, key=int)
    early, late = trials[:TAUGHT_TAKES], trials[TAUGHT_TAKES : TAUGHT_TAKES + LATER_TAKES]
    people, every = (home.teacher, home.other), (*home.labels, *home.unlearned)
    taught = room.seen({name: _takes(a, home.teacher, home.labels, early) for name, a in room.space.items()})
    examples: dict[str, list[Recording]] = {name: [] for name in taught}
    models = before = learn(teaching, taught, examples, home.labels)
    made = failed = 0
    shown = [(home.other, every, early[:1]), (home.teacher, home.unlearned, early), (home.other, every, early[1:])]
    for n, (tempo, (subject, labels, takes)) in enumerate(product(TEMPI, shown)):
        part = evening(room, subject, labels, takes, home.seed + n, tempo)
        if part is None or made == CORRECTIONS:
            continue
        wrong = [p for p in part.performances(home.labels, models) if not p.is_right][: CORRECTIONS - made]
        cut, bad = examples_from(part, wrong, f"{n}")
        made, failed = made + len(wrong), failed + bad
        examples = {name: [*examples[name], *cut[name]] for name in examples}
        models = learn(teaching, taught, examples, home.labels) if wrong else models
    later = [p for s in people if (p := evening(room, s, every, late, home.seed + len(TEMPI) * 3)) is not None]
    counts = [errors_of(one for part in later for one in part.performances(home.labels, m)) for m in (before, models)]
    return Corrected(home, counts[0], counts[1], made, failed)


def _takes(archive: MotionArchive, subject: str, labels: Sequence[str], takes: Sequence[str]) -> list[Recording]:
    return [r for r in archive.recordings if r.subject == subject and r.label in labels and r.trial in takes]


def rows(data: Path, teaching: TaughtModels, draws: Draws, jobs: int, progress: Progress) -> Iterator[str]:
    """A line for each household, and one for all."""
    room = one_camera(data, draws.recordings, draws.whole_body)
    teaching = replace(teaching, life=ordinary_life(room, data))
    homes = households(room, draws.people or PEOPLE[draws.recordings], draws.count, draws.seed)
    results = run_parts(partial(judge_household, room=room, teaching=teaching), homes, jobs or cores(), progress)
    for one in results:
        home = one.household
        yield f"  {home.teacher} and {home.other}: {', '.join(home.labels)}: {_figures([one])}"
    yield f"{room.name}: {_figures(results)}"


def _figures(results: Sequence[Corrected]) -> str:
    before, after = Errors(), Errors()
    for one in results:
        before, after = before.plus(one.before), after.plus(one.after)
    made, failed = sum(one.made for one in results), sum(one.failed for one in results)
    return f"{_line(before)} -> {_line(after)}; {made} corrections, {failed} examples could not be cut"


def _line(errors: Errors) -> str:
    return (
        f"error {errors.share:.3f} ({errors.missed} missed and {errors.wrong} wrong of {errors.shown}, "
        f"{errors.named} of {errors.others} other movements named)"
    )
