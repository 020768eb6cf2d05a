"""What counting and scoring cost: an observer's frame and a step of fusion with them and without, in turn.

    python -m benchmarks.facet_costs

Hands and head of the package's synthetic performer, nine reference takes of each movement; processor time of this
thread. A score is computed once, when the movement is over: that is the longest frame. The watch for falls has its own
figure: `python -m benchmarks.falls`.
"""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from statistics import mean, median

import msgspec

from benchmarks.command_line import run_command
from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import PosteriorMessage
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.examples import with_references
from observer.learning.learn import learn_view
from observer.model.base import MovementModel
from observer.model.stacked import Stacked
from observer.motion.archive import Recording
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer, PosteriorEncoder
from studies.fusion_engine import FusionEngine, step
from studies.performer import perform, perform_continuously

LABELS = ("byebye", "lunging", "maestro", "stretch")
VIEWS = ("door", "wheel", "yaw:45", "yaw:315")
PERSON, OTHERS = "4", ("1", "2", "3")
ROUNDS = 5


def facet_costs() -> None:
    """Print what counting and scoring cost.

    Example: python -m benchmarks.facet_costs
    """
    shown = perform(people=OTHERS, movements=LABELS, trials=3)
    view = parse_view(VIEWS[0])
    counting = learn_view(shown, view, Vocabulary(LABELS), calibrate=False)
    known = counting.header.vocabulary
    plain = learn_view(shown, view, Vocabulary(LABELS), calibrate=False)
    if not isinstance(plain, Stacked):
        raise TypeError(f"the default model is {type(plain)}; only Stacked counts")
    plain.header = replace(plain.header, vocabulary=replace(known, movements={}))
    scoring = with_references(counting, shown, view, ["all"])
    played = perform_continuously(PERSON, LABELS * 2)
    models = {"neither": plain, "counting": counting, "counting and scoring": scoring}
    print(f"an observer's frame, us: {_compared({name: _frames(model, played) for name, model in models.items()})}")
    messages = _messages(scoring, played)
    bare = [{name: _without(message) for name, message in each.items()} for each in messages]
    works = {"neither": _steps(bare, known), "counting and scoring": _steps(messages, known)}
    print(f"a step of fusion with {len(VIEWS)} observers, us: {_compared(works)}")


def _compared(works: Mapping[str, Callable[[], Sequence[float]]]) -> str:
    """The mean of each work's steps, the median of ROUNDS in turn, and its longest step."""
    means: dict[str, list[float]] = {name: [] for name in works}
    longest = dict.fromkeys(works, float("inf"))
    for _ in range(ROUNDS):
        for name, work in works.items():
            steps_us = work()
            means[name].append(mean(steps_us))
            longest[name] = min(longest[name], max(steps_us))
    return "; ".join(f"{name} {median(own):.0f} (longest {longest[name]:.0f})" for name, own in means.items())


def _frames(model: MovementModel, played: Recording) -> Callable[[], Sequence[float]]:
    parts = model.header.body_parts

    def work() -> Sequence[float]:
        observer = Observer(ProjectedTracker(parse_view(VIEWS[0]), parts, parts), model)
        return [*_timed(partial(observer.step, frame) for frame in frames_of(played))]

    return work


def _steps(messages: Sequence[Mapping[str, PosteriorMessage]], vocabulary: Vocabulary) -> Callable[[], Sequence[float]]:
    def work() -> Sequence[float]:
        engine = FusionEngine("cost", [*messages[0]], vocabulary, FusionConfig())
        return [*_timed(partial(step, engine, each, next(iter(each.values())).captured_ns) for each in messages)]

    return work


def _timed(steps: Iterator[Callable[[], object]]) -> Iterator[float]:
    for work in steps:
        begun_ns = time.thread_time_ns()
        work()
        yield (time.thread_time_ns() - begun_ns) / 1000


def _messages(model: MovementModel, played: Recording) -> list[dict[str, PosteriorMessage]]:
    """At each frame the posterior of one observer, as of four."""
    parts, encoder = model.header.body_parts, PosteriorEncoder(model.header.vocabulary, "cost")
    observer = Observer(ProjectedTracker(parse_view(VIEWS[0]), parts, parts), model)
    messages = []
    for n, frame in enumerate(frames_of(played)):
        at_ns = SECOND_NS + round(n * SECOND_NS / played.rate_hz)
        posterior = observer.step(replace(frame, captured_ns=at_ns))
        if posterior is not None:
            messages.append(dict.fromkeys(VIEWS, encoder.encode(posterior, at_ns, at_ns)))
    return messages


def _without(message: PosteriorMessage) -> PosteriorMessage:
    return msgspec.structs.replace(message, repetitions=None, repeated=None, score=None, unscored=None)


if __name__ == "__main__":
    sys.exit(run_command(facet_costs, "facet_costs"))
