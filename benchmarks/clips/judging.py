"""Verdicts on a film: what happened, how it counts, and the fast way to them, in one process from known tracks.

`judge` passes the tracks through Observer, PosteriorEncoder and FusionEngine as the processes do, at the times at which
they would: a posterior arrives LATENCY_S after its frame, fusion also steps without one, and the observer is gone when
the film has ended.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.from_pixels import RecordedTracks
from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import JudgementMessage, VerdictMessage
from common.vocabulary import ABSTAIN
from observer.model.base import MovementModel, Onset
from observer.prepared_tracks import Resampler
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.runtime.service import FUSION_STEPS
from observer.tracks import Floats, Frame, Tracks
from studies.fusion_engine import FusionEngine

OBSERVER = "camera"
BEGIN_NS = 1_700_000_000 * SECOND_NS
LATENCY_S = 0.05
"""Between a frame and its posterior at the fusion service: MediaPipe takes most of it."""
AFTER_S = 4.0
"""After a film, fusion goes on for this long: longer than drop_s and hold_s, after which nothing happens any more."""


@dataclass(frozen=True, slots=True)
class ClipVerdict:
    """A verdict: its first label, when that was published (seconds after the first frame), and its last label."""

    label: str
    at_s: float
    last: str


@dataclass(frozen=True, slots=True)
class Moment:
    """A judgement: seconds after the first frame, the likeliest label, P(label and learned), P(none), P(rest)."""

    at_s: float
    label: str
    p: float
    unlearned: float
    rest: float | None


@dataclass(frozen=True, slots=True)
class ClipResult:
    """What happened during a film and AFTER_S after it. label: the truth, "" for no movement. seconds: of the film."""

    name: str
    label: str
    seconds: float
    verdicts: tuple[ClipVerdict, ...]
    moments: tuple[Moment, ...]

    @property
    def first_is_right(self) -> bool:
        """Whether the first verdict names the movement, if there is one, and else whether nothing is named."""
        if not self.label:
            return not self.words
        return bool(self.verdicts) and self.verdicts[0].label == self.label

    @property
    def words(self) -> tuple[ClipVerdict, ...]:
        """The verdicts that name a movement, at first or at last."""
        return tuple(v for v in self.verdicts if {v.label, v.last} != {ABSTAIN})

    @property
    def best(self) -> Moment | None:
        """The moment at which a label was most probable while the person moved."""
        moving = [moment for moment in self.moments if (moment.rest or 0.0) < 0.5]
        return max(moving, key=lambda moment: moment.p, default=None)


def collect_verdicts(messages: Sequence[tuple[float, VerdictMessage]]) -> tuple[ClipVerdict, ...]:
    """Messages with the time of their publication in seconds -> one verdict per id, in the order of first words."""
    verdicts: dict[str, ClipVerdict] = {}
    for at_s, message in messages:
        first = verdicts.get(message.id, ClipVerdict(message.label, at_s, message.label))
        verdicts[message.id] = replace(first, last=message.label)
    return tuple(verdicts.values())


def moment(judgement: JudgementMessage, at_s: float) -> Moment:
    """What a judgement says of its likeliest label."""
    unlearned = judgement.unlearned or 0.0
    rests = [vote.rest for vote in judgement.votes.values() if vote.rest is not None]
    rest = sum(rests) / len(rests) if rests else None
    return Moment(at_s, judgement.label, max(judgement.p) * (1.0 - unlearned), unlearned, rest)


def judge(
    name: str,
    label: str,
    centres: Floats,
    rate_hz: float,
    model: MovementModel,
    config: FusionConfig,
) -> ClipResult:
    """The verdicts on tracks (F, P, 2) of the model's parts, NaN where not seen."""
    run = _Run(model, config)
    observer = Observer(
        RecordedTracks(iter(map(Tracks, centres)), model.header.body_parts),
        model,
        Onset(),
        Resampler(model.header.rate_hz),
    )
    encoder = PosteriorEncoder(model.header.vocabulary, "clips")
    step_ns = round(SECOND_NS / config.step_hz)
    run.engine.roster.set_present(frozenset({OBSERVER}))
    captured_ns = sent_ns = BEGIN_NS
    for n in range(len(centres)):
        captured_ns = BEGIN_NS + round(n * SECOND_NS / rate_hz)
        sent_ns = captured_ns + round(LATENCY_S * SECOND_NS)
        run.step_until(sent_ns, step_ns)
        posterior = observer.step(Frame(captured_ns, np.empty(0)))
        run.engine.receive(OBSERVER, encoder.encode(posterior, captured_ns, sent_ns), sent_ns)
        run.step(sent_ns)
    last = observer.end()
    if last is not None:
        run.engine.receive(OBSERVER, encoder.encode(last, captured_ns + 1, sent_ns), sent_ns)
        # The observer stays until fusion has used it.
        for _ in range(FUSION_STEPS):
            run.step(run.now_ns + step_ns)
    run.engine.roster.set_present(frozenset())
    run.step_until(run.now_ns + round(AFTER_S * SECOND_NS), step_ns)
    return ClipResult(name, label, len(centres) / rate_hz, collect_verdicts(run.verdicts), tuple(run.moments))


class _Run:
    """An engine and what it has published, with times in seconds after the first frame."""

    def __init__(self, model: MovementModel, config: FusionConfig) -> None:
        self.engine = FusionEngine("clips", [OBSERVER], model.header.vocabulary, config)
        self.now_ns = BEGIN_NS
        self.verdicts: list[tuple[float, VerdictMessage]] = []
        self.moments: list[Moment] = []

    def step(self, now_ns: int) -> None:
        """One step of the fusion service."""
        self.now_ns = now_ns
        at_s = (now_ns - BEGIN_NS) / SECOND_NS
        output = self.engine.step(now_ns)
        self.verdicts += [(at_s, verdict) for verdict in output.verdicts]
        self.moments.append(moment(output.judgement, at_s))

    def step_until(self, end_ns: int, step_ns: int) -> None:
        """The steps that are due before `end_ns` although nothing arrives."""
        while self.now_ns + step_ns < end_ns:
            self.step(self.now_ns + step_ns)
