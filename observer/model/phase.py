"""`phase`, the default: every training example a chain of postures, followed by the phase filter (docs/model.md).

It needs to know neither where a movement begins nor how fast it is done.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from common.probability import uniform
from observer.belief.phase_filter import FLOOR, Dynamics, FilterWatch, PhaseFilter
from observer.model.base import Arrays, Example, Header, Onset, with_defaults
from observer.posture import PostureReader, at_rest
from observer.tracks import Floats, Tracks

STEPS = (0.25, 0.4, 0.25, 0.1)
"""P(0, 1, 2, 3 phases in one frame): mean 1.2, for people between three times slower and three times faster."""
ENTRY = (0.4, 0.3, 0.2, 0.1)
"""P(a movement is entered in its first, ... fourth phase)."""
FEWEST_PHASES = 8


class Phase:
    """Chains (C, Φ, D): per training example Φ postures; Φ is the examples' median length in frames."""

    kind: ClassVar[str] = "phase"
    # sharpness: evidence is exp(-sharpness d^2), d in body sizes. fast: posture.py. Both were chosen by leaving out
    # one of the training subjects 1, 3, 5, 7, 9 of MSR Action3D at a time (docs/model.md); the others are guesses.
    DEFAULTS: ClassVar[Mapping[str, float]] = {"sharpness": 0.7, "fast": 1.5, "begin": 0.05, "forget": 0.01}

    def __init__(self, header: Header, chains: NDArray[np.float32], movement_of: NDArray[np.int64]) -> None:
        self.header = header
        self._chains, self._movement_of = chains, movement_of
        self._phases = Postures(chains.reshape(-1, chains.shape[-1]))
        # Somebody at rest stands as people stood before and after their movements, without moving.
        self._rests = Postures(at_rest(np.concatenate([chains[:, 0], chains[:, -1]])).astype(np.float32))

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Keep every example, its frames laid over Φ phases, its gaps bridged.

        A posture with a hole would be near to everything; a part that an example never shows is taken from the
        average of the other examples of its movement.
        """
        header = with_defaults(header, cls.DEFAULTS)
        features = [_bridged(_features_of(e, header)) for e in examples]
        phases = max(int(np.median([len(f) for f in features])), FEWEST_PHASES)
        chains = np.array([_laid_over(f, phases) for f in features])
        movement_of = np.array([e.movement for e in examples], dtype=np.int64)
        return cls(header, _completed(chains, movement_of).astype(np.float32), movement_of)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From chains (C, Φ, D) float32 and movement_of (C,) int64."""
        return cls(header, np.asarray(arrays["chains"], np.float32), np.asarray(arrays["movement_of"], np.int64))

    def arrays(self) -> Arrays:
        """chains (C, Φ, D) float32 and movement_of (C,) int64."""
        return {"chains": self._chains, "movement_of": self._movement_of}

    def watch(self, onset: Onset) -> "_PhaseWatch":
        """Start the filter at rest, or at the first phases where the onset is known."""
        dynamics = Dynamics(
            steps=np.array([STEPS]),
            speeds=np.ones(1),
            jitter=np.ones((1, 1)),
            entry=np.array(ENTRY),
            begin=self.header.parameters["begin"],
            forget=self.header.parameters["forget"],
        )
        prior = uniform(self.header.vocabulary.size)
        belief = PhaseFilter(self._movement_of, self._chains.shape[1], prior, dynamics, onset.known)
        return _PhaseWatch(self, _reader(self.header), belief)

    def log_evidence(self, features: Floats) -> tuple[Floats, float]:
        """(D,) features -> (C, Φ) log P(features | chain, phase), and log P(features | rest), up to one constant.

        -sharpness d^2 over the features that are seen, so that a missing part is factor 1 everywhere; the rest is
        the mean over all resting postures.
        """
        sharpness = self.header.parameters["sharpness"]
        chains = -sharpness * self._phases.squared_distances(features)
        rests = np.maximum(-sharpness * self._rests.squared_distances(features), FLOOR)
        log_rest = float(np.log(np.exp(rests).mean()))
        return np.maximum(chains, FLOOR).reshape(self._chains.shape[:2]), log_rest


class Postures:
    """(S, D) postures to which distances are measured, frame after frame."""

    def __init__(self, postures: NDArray[np.float32]) -> None:
        self._postures = postures.astype(np.float64)
        self._squares = self._postures**2
        self._lengths = self._squares.sum(axis=1)

    def squared_distances(self, features: Floats) -> Floats:
        """(D,) features, NaN where not seen -> (S,) squared distances over what is seen.

        |x - o|^2 = |x|^2 - 2 x.o + |o|^2, so that a frame costs one matrix-vector product.
        """
        seen = np.isfinite(features)
        o = np.where(seen, features, 0.0)
        lengths = self._lengths if seen.all() else self._squares @ seen.astype(np.float64)
        distances: Floats = np.maximum(lengths - 2.0 * (self._postures @ o) + o @ o, 0.0)
        return distances


class _PhaseWatch(FilterWatch):
    def __init__(self, model: Phase, reader: PostureReader, belief: PhaseFilter) -> None:
        super().__init__(belief)
        self._model, self._reader = model, reader

    def update(self, tracks: Tracks) -> None:
        features = self._reader.update(tracks)
        if np.isfinite(features).any():
            self.belief.step(*self._model.log_evidence(features))
        else:
            self.belief.step_blind()


def _reader(header: Header) -> PostureReader:
    return PostureReader(header.body_parts, header.rate_hz, header.parameters["fast"])


def _features_of(example: Example, header: Header) -> Floats:
    """(F, D) read as an observer would read them."""
    reader = _reader(header)
    return np.array([reader.update(tracks) for tracks in example.tracks])


def _bridged(features: Floats) -> Floats:
    """(F, D) -> the same, gaps filled linearly in time, the first frame's motion from the second's.

    A feature that is never seen stays NaN.
    """
    frames = np.arange(len(features))
    result = features.copy()
    for column in result.T:
        seen = np.isfinite(column)
        if seen.any():
            column[~seen] = np.interp(frames[~seen], frames[seen], column[seen])
    return result


def _laid_over(features: Floats, phases: int) -> Floats:
    """(F, D) -> (Φ, D), linear between frames."""
    place = np.linspace(0, len(features) - 1, phases)
    before = np.floor(place).astype(int)
    after = np.minimum(before + 1, len(features) - 1)
    share = (place - before)[:, None]
    laid: Floats = features[before] * (1 - share) + features[after] * share
    return laid


def _completed(chains: Floats, movement_of: NDArray[np.int64]) -> Floats:
    """(C, Φ, D) -> the same, what a chain never shows taken from its movement's others, or from all."""
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
