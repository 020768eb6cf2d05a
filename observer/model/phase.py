"""`phase`: every training example is a chain of postures for a phase filter (docs/design/model.md).

It needs to know neither where a movement begins nor how fast it is nor, if learned at several facings, which way the
person faces.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from observer.body import TRUNK_POINTS
from observer.features import REFERENCE_HZ, PostureReader, resampled, without_motion
from observer.model.base import Arrays, Example, Header, Onset, Watch, array_in, with_defaults
from observer.model.chain_filter import ChainFilter, Dynamics, PostureEvidence, Postures, RestPostures
from observer.model.parameters import FACINGS, Parameter, Positive, Probability
from observer.tracks import BODY_PARTS, Floats, Integers, Tracks

STEP_SHARES = (0.4, 0.3, 0.15, 0.1, 0.05)
"""P(advance by 0, 1, 2, 3, 4 phases in 1/15 s): people pause and hurry more often than they keep an even pace."""
ENTRY_PHASES = len(STEP_SHARES) - 1
"""A movement is entered in one of the phases that a step can take it to; a chain has at least twice as many."""
ENTRY = np.arange(ENTRY_PHASES, 0, -1) / sum(range(ENTRY_PHASES + 1))
"""P(it is entered in its first, ... fourth phase), which falls evenly."""
UNDER_WAY = 0.2
"""P(the person is in the middle of a movement when an observer starts). With .5 a movement is noticed hardly sooner,
but the probability of rest begins at .7 in place of .9 where the person rests."""


class Phase:
    """Chains (C, Φ, D): Φ postures for each training example and facing; Φ is the examples' median length in 1/15 s."""

    kind: ClassVar[str] = "phase"
    # sharpness: evidence is exp(-sharpness d^2), d in body sizes. fast: PostureReader's max_speed; apart: its
    # hands_weight. outlier: the largest evidence of a frame against a posture, in nats. All chosen by leaving out one
    # of the training subjects 1, 3, 5, 7, 9 of MSR Action3D at a time (docs/design/model.md), abandon and settled too.
    # begin, forget: guesses.
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "sharpness": Positive(1.0),
        "fast": Positive(1.5),
        "apart": Parameter(0.5),
        "outlier": Positive(5.0),
        "begin": Probability(0.05),
        "forget": Probability(0.01),
        "abandon": Probability(0.02),
        "settled": Positive(15.0),
        "facings": FACINGS,
    }

    def __init__(
        self, header: Header, chains: NDArray[np.float32], movement_of: NDArray[np.int64], facing_of: NDArray[np.int64]
    ) -> None:
        self.header = header
        self._chains, self._movement_of, self._facing_of = chains, movement_of, facing_of
        self.facings = int(header.parameters["facings"])
        self._fifteenths = REFERENCE_HZ / header.rate_hz
        # Parts of one body move together: the evidence of four times as many counts as that of twice as many.
        # The parameter `sharpness` was chosen for hands and head.
        self._weight_of_parts = (len(BODY_PARTS) / len(parts_read(header.body_parts))) ** 0.5
        self._cell_of = movement_of * self.facings + facing_of
        self._postures = Postures(chains.transpose(1, 2, 0))
        # A person at rest stands as people stood before and after their movements, without moving.
        first, last = without_motion(chains[:, 0]), without_motion(chains[:, -1])
        self._at_rest = RestPostures(first, last, self._cell_of, (header.vocabulary.size, self.facings))

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Store every example, resampled to Φ phases, its gaps filled.

        A posture with a hole would be near to every other; a part that an example never shows is taken from the mean
        of the other examples of its movement.
        """
        header = with_defaults(header, cls.PARAMETERS)
        features = [e.features if len(e.features) else _read(header, e) for e in examples]
        # A phase is 1/15 s of the median example, whatever the frame rate.
        phases = max(round(np.median([*map(len, features)]) * REFERENCE_HZ / header.rate_hz), 2 * ENTRY_PHASES)
        movement_of, facing_of = np.array([(e.movement, e.facing) for e in examples], np.int64).T
        chains = complete_chains(np.array([resampled(f, phases) for f in features]), movement_of)
        return cls(header, chains.astype(np.float32), movement_of, facing_of)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From chains (C, Φ, D) float32, movement_of (C,) and facing_of (C,) int64; ValueError if they do not fit."""
        chains = array_in(arrays, "chains", (None, None, 5 * len(parts_read(header.body_parts)) + 2), np.float32)
        movement_of, facing_of = (
            array_in(arrays, name, chains.shape[:1], np.int64) for name in ("movement_of", "facing_of")
        )
        if not chains.size:
            raise ValueError(f"chains have shape {chains.shape}: some are expected")
        if movement_of.min() < 0 or movement_of.max() >= header.vocabulary.size:
            raise ValueError("movement_of is outside the vocabulary")
        if facing_of.min() < 0 or facing_of.max() >= header.parameters["facings"]:
            raise ValueError("facing_of is outside the facings")
        return cls(header, chains, movement_of, facing_of)

    def arrays(self) -> Arrays:
        """chains (C, Φ, D) float32, movement_of (C,) and facing_of (C,) int64."""
        return {"chains": self._chains, "movement_of": self._movement_of, "facing_of": self._facing_of}

    def watch(self, onset: Onset) -> "PhaseWatch":
        """Start the filter at rest, or at the first phases if the onset is known."""
        return PhaseWatch(self, onset)

    def chain_filter(self, onset: Onset) -> ChainFilter:
        """The filter before the first frame."""
        dynamics = chain_dynamics(self.header.parameters, self._fifteenths, onset.known)
        shape = self.header.vocabulary.size, self.facings, self._chains.shape[1]
        return ChainFilter(self._cell_of, shape, dynamics, onset.known)

    def evidence(self) -> PostureEvidence:
        """The likelihoods of frames that one person shows."""
        # At twice the frame rate, the evidence of one frame is spread over two.
        sharpness, outlier = (self._fifteenths * self.header.parameters[name] for name in ("sharpness", "outlier"))
        return PostureEvidence(self._postures, self._at_rest, sharpness * self._weight_of_parts, outlier)


class PhaseWatch(Watch):
    """Watches one person with a phase filter."""

    def __init__(self, model: Phase, onset: Onset) -> None:
        self._reader, self._filter = posture_reader(model.header), model.chain_filter(onset)
        self._evidence, self._is_turned = model.evidence(), model.facings > 1

    @property
    def p(self) -> Floats:
        """(M,) posterior over movements."""
        p: Floats = self._filter.posterior.sum(axis=1)
        return p

    @property
    def joint(self) -> Floats | None:
        """(M, K) posterior over movements and facings; None for a model of one facing."""
        return self._filter.posterior if self._is_turned else None

    @property
    def rest(self) -> float:
        """P(at rest now)."""
        return self._filter.rest

    def update(self, tracks: Tracks) -> None:
        """Take in one frame."""
        self.step(self._reader.update(tracks), self._reader.still)

    def step(self, features: Floats, still: float) -> None:
        """Take in the features (D,) of one frame, NaN where not seen, and P(the person is still)."""
        if np.isfinite(features).any():
            self._filter.step(self._evidence.see(features), still)
        else:
            self._filter.step_blind()


def fill_gaps(features: Floats) -> Floats:
    """(F, D) -> the same, gaps filled linearly in time, ends held; a feature that is never seen stays NaN."""
    frames = np.arange(len(features))
    filled = features.copy()
    for column in filled.T:
        known = np.isfinite(column)
        if known.any():
            column[~known] = np.interp(frames[~known], frames[known], column[known])
    return filled


def complete_chains(chains: Floats, movement_of: Integers) -> Floats:
    """(C, Φ, D) -> the same without NaN: a feature that a chain never shows is the mean of other chains.

    Of those of its movement where they show it, else of all chains, else 0. movement_of: (C,).
    """
    result = chains.copy()
    for chain in np.flatnonzero(~np.isfinite(chains).all(axis=(1, 2))):
        hole = ~np.isfinite(chains[chain])
        for others in (chains[movement_of == movement_of[chain]], chains):
            count = np.isfinite(others).sum(axis=0)
            mean = np.nansum(others, axis=0) / np.maximum(count, 1)
            fill = hole & (count > 0)
            result[chain][fill] = mean[fill]
            hole &= count == 0
        result[chain][hole] = 0.0
    return result


def _read(header: Header, example: Example) -> Floats:
    """(F, D) features as an observer would read them, gaps filled."""
    reader = posture_reader(header)
    return fill_gaps(np.array([reader.update(tracks) for tracks in example.tracks]))


def posture_reader(header: Header) -> PostureReader:
    """The reader of the features, with the model's parameters."""
    parameters, parts = header.parameters, parts_read(header.body_parts)
    return PostureReader(header.body_parts, header.rate_hz, parameters["fast"], parameters["apart"], parts)


def parts_read(body_parts: Sequence[str]) -> tuple[str, ...]:
    """The head and the limbs, in the same order; all parts where only the trunk is left.

    Beside them a shoulder, the neck or a hip shows how a person is built, and that is no movement.
    """
    trunk = {part for point in TRUNK_POINTS for part in point if part != "head"}
    limbs = tuple(part for part in body_parts if part not in trunk)
    return limbs if len(limbs) > 1 else tuple(body_parts)


def step_probabilities(share: float) -> Floats:
    """(K,) P(advance by k phases) within `share` fifteenths of a second.

    STEP_SHARES convolved with itself once per whole fifteenth; the remainder is one more step with that probability.
    """
    steps, rest = np.ones(1), share % 1
    for part in [1.0] * int(share) + [rest] * (rest > 0):
        once = part * np.array(STEP_SHARES)
        once[0] += 1 - part
        steps = np.convolve(steps, once)
    return steps


def chain_dynamics(parameters: Mapping[str, float], share: float, onset_known: bool) -> Dynamics:
    """The dynamics of the phase filter; share: of a fifteenth of a second that a frame lasts.

    begin, forget and abandon are probabilities for 1/15 s, settled counts such fifteenths. With a known onset nothing
    settles, because a person who is known to do a movement may hold its pose for long.
    """
    begin, forget, abandon = (1 - (1 - parameters[name]) ** share for name in ("begin", "forget", "abandon"))
    return Dynamics(
        steps=step_probabilities(share),
        entry=ENTRY,
        begin=begin,
        forget=forget,
        abandon=abandon,
        settled=np.inf if onset_known else parameters["settled"] / share,
        under_way=UNDER_WAY,
    )
