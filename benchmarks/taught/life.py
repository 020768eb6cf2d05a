"""Ordinary life: models of three movements of one person, taught beside some people's life, watch other people's.

Life is storytelling, seated, lively hands, and karate without its labels: stances, transitions and techniques. It is
moved to where the taught person stands. Half of the people are learned as something else, the other half are judged:
every verdict that names a movement is false.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from benchmarks.taught.few_takes import Draw, Progress, RecordedRoom, draws, few, moved_into, spread
from benchmarks.taught.judging import Cameras, TaughtModels, names_in, verdicts_on
from common.parallel import cores, run_parts
from observer.motion.archive import MotionArchive, Recording, select
from observer.motion.archive_file import read_archive

SETS = {"storytelling": (("a",), ("b",)), "karate": (("1", "2", "3", "4"), ("5", "6", "7", "8"))}
"""Set -> the people of both halves; each is learned in every second draw."""


@dataclass(frozen=True, slots=True)
class LifeResult:
    """Verdicts that name a movement in `minutes` of others' life. cameras: how many observers there are."""

    kind: str
    cameras: int
    named: int
    minutes: float


def life_of(room: RecordedRoom, data: Path, half: int) -> dict[str, dict[str, MotionArchive]]:
    """Set -> the tracks of each camera of the people of one half."""
    result = {}
    for kind, people in SETS.items():
        archive = select(spread(read_archive(data / kind / f"{kind}.npz"), room.body_parts), list(people[half]))
        result[kind] = room.seen(dict.fromkeys(room.views, moved_into(room, archive)))
    return result


def judge_life(draw: Draw, room: RecordedRoom, teaching: TaughtModels, data: Path) -> list[LifeResult]:
    """All takes of a draw are learned beside one half of the people; the life of the other half is judged."""
    half = draw.seed % 2
    learned, judged = life_of(room, data, half), life_of(room, data, 1 - half)
    background = {
        name: MotionArchive(
            room.body_parts, tuple(r for kind in learned.values() for r in kind[name].recordings), one.camera
        )
        for name, one in next(iter(learned.values())).items()
    }
    takes = {
        name: few([r for r in select(archive, [draw.subject]).recordings if r.label in draw.labels])
        for name, archive in room.space.items()
    }
    models = replace(teaching, life=background).models(room.seen(takes), draw.labels)
    results = []
    for kind, cameras in judged.items():
        for streams in _performances(cameras):
            for chosen in ({name: streams[name]} for name in streams), (streams,):
                for own in chosen:
                    named = len(names_in(verdicts_on(own, room.body_parts, models)))
                    first = next(iter(own.values()))
                    results.append(LifeResult(kind, len(own), named, len(first.positions) / first.rate_hz / 60))
    return results


def _performances(cameras: Cameras) -> Iterator[dict[str, Recording]]:
    """Each recording as all cameras see it."""
    names = list(cameras)
    for seen in zip(*(cameras[name].recordings for name in names), strict=True):
        yield dict(zip(names, seen, strict=True))


def rows(
    room: RecordedRoom, teaching: TaughtModels, data: Path, count: int, seed: int, jobs: int, progress: Progress
) -> Iterator[str]:
    """A line for each set, and for one and for several cameras."""
    parts = draws(room, count, seed)
    judge = partial(judge_life, room=room, teaching=teaching, data=data)
    results = [one for part in run_parts(judge, parts, jobs or cores(), progress) for one in part]
    for kind in (*SETS, "all"):
        for cameras in sorted({one.cameras for one in results}):
            own = [one for one in results if one.cameras == cameras and kind in (one.kind, "all")]
            named, minutes = sum(one.named for one in own), sum(one.minutes for one in own)
            views = f"{cameras} camera{'s' * (cameras > 1)}"
            yield f"{kind:12s} {views}: {named / max(minutes, 1e-9):.2f} a minute ({named} in {minutes:.1f} minutes)"
