"""`phase`, the default: every training example is a chain of postures for the phase filter (docs/design/model.md).

It needs to know neither where a movement begins nor how fast it is done nor, learned at several facings, which way the
person faces.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from observer.features.posture import REFERENCE_HZ, PostureReader, at_rest
from observer.filtering.chain_filter import ChainFilter
from observer.filtering.phase_filter import Dynamics
from observer.model.base import Arrays, Example, Header, Onset, with_defaults
from observer.model.chains import bridged, completed, laid_over, pairs_to_blend
from observer.model.posterior_calibration import given_learned
from observer.model.postures import Chosen, PostureEvidence, Postures
from observer.tracks import Floats, Tracks

STEPS = (0.4, 0.3, 0.15, 0.1, 0.05)
"""P(0, 1, 2, 3, 4 phases in 1/15 s): people dwell, and hurry, more than they keep an even pace."""
ENTRY = (0.4, 0.3, 0.2, 0.1)
"""P(a movement is entered in its first, ... fourth phase)."""
FEWEST_PHASES = 8


def steps_in(share: float) -> Floats:
    """P(k phases) in so many fifteenths of a second: STEPS as often as they go into it, and with a chance the rest."""
    whole, part = int(share), share - int(share)
    steps = np.ones(1)
    for _ in range(whole):
        steps = np.convolve(steps, STEPS)
    if part > 0:
        once = part * np.array(STEPS)
        once[0] += 1 - part
        steps = np.convolve(steps, once)
    result: Floats = steps
    return result


class Phase:
    """Chains (C, Φ, D): per training example and facing Φ postures; Φ is the examples' median length in frames."""

    kind: ClassVar[str] = "phase"
    # sharpness: evidence is exp(-sharpness d^2), d in body sizes. fast, apart: posture.py. outlier: no frame says more
    # against a posture, in nats. All chosen by leaving out one of the training subjects 1, 3, 5, 7, 9 of MSR Action3D
    # at a time (docs/design/model.md). begin, forget: guesses. facings: in how many directions a person may stand.
    DEFAULTS: ClassVar[Mapping[str, float]] = {
        "sharpness": 1.0,
        "fast": 1.5,
        "apart": 0.5,
        "outlier": 5.0,
        "begin": 0.05,
        "forget": 0.01,
        "facings": 1.0,
    }

    def __init__(
        self, header: Header, chains: NDArray[np.float32], movement_of: NDArray[np.int64], facing_of: NDArray[np.int64]
    ) -> None:
        self.header = header
        self._chains, self._movement_of, self._facing_of = chains, movement_of, facing_of
        self.facings = int(header.parameters["facings"])
        self._share = REFERENCE_HZ / header.rate_hz
        # All that is none of the vocabulary is one more answer, the last.
        movements, facings = header.vocabulary.size, self.facings
        self.answers = movements + (header.background is not None)
        self._cell_of = np.where(movement_of < 0, movements, movement_of) * facings + facing_of
        if header.background is not None:
            one, other = pairs_to_blend(movement_of, facing_of)
            chains = np.concatenate([chains, (chains[one] + chains[other]) / np.float32(2)])
            self._cell_of = np.concatenate([self._cell_of, movements * facings + facing_of[one]])
        self._postures = Postures(chains.transpose(1, 2, 0))
        # Somebody at rest stands as people stood before and after their movements, without moving.
        self._first = Postures(at_rest(chains[:, 0]).astype(np.float32).T[None])
        self._last = Postures(at_rest(chains[:, -1]).astype(np.float32).T[None])

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Keep every example, its frames laid over Φ phases, its gaps bridged.

        A posture with a hole would be near to everything; a part that an example never shows is taken from the
        average of the other examples of its movement.
        """
        header = with_defaults(header, cls.DEFAULTS)
        features = [_features_of(e, header) for e in examples]
        # A phase is 1/15 s of the median example, whatever the frame rate.
        lengths = [len(f) for f, e in zip(features, examples, strict=True) if e.movement >= 0]
        phases = max(round(np.median(lengths) * REFERENCE_HZ / header.rate_hz), FEWEST_PHASES)
        chains = np.array([laid_over(f, phases) for f in features])
        movement_of = np.array([e.movement for e in examples], dtype=np.int64)
        facing_of = np.array([e.facing for e in examples], dtype=np.int64)
        return cls(header, completed(chains, movement_of).astype(np.float32), movement_of, facing_of)

    @classmethod
    def read(cls, header: Header, example: Example) -> Floats:
        """(F, D) read as an observer would read them, gaps bridged."""
        reader = _reader(header)
        return bridged(np.array([reader.update(tracks) for tracks in example.tracks]))

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From chains (C, Φ, D) float32, movement_of (C,) and facing_of (C,) int64."""
        movement_of = np.asarray(arrays["movement_of"], np.int64)
        facing_of = np.asarray(arrays["facing_of"], np.int64)
        return cls(header, np.asarray(arrays["chains"], np.float32), movement_of, facing_of)

    def arrays(self) -> Arrays:
        """chains (C, Φ, D) float32, movement_of (C,) and facing_of (C,) int64."""
        return {"chains": self._chains, "movement_of": self._movement_of, "facing_of": self._facing_of}

    def grown(self, header: Header, examples: Sequence[Example]) -> Self:
        """The same for a vocabulary with more movements at its end, of which alone the examples are."""
        movement_of = np.array([e.movement for e in examples], dtype=np.int64)
        facing_of = np.array([e.facing for e in examples], dtype=np.int64)
        laid = [laid_over(_features_of(e, header), self._chains.shape[1]) for e in examples]
        chains = completed(np.array(laid), movement_of).astype(np.float32)
        return type(self)(
            header,
            np.concatenate([self._chains, chains]),
            np.concatenate([self._movement_of, movement_of]),
            np.concatenate([self._facing_of, facing_of]),
        )

    def shrunk(self, header: Header, kept: Sequence[int]) -> Self:
        """The same for a vocabulary of only these movements, in their order."""
        # Where a movement stands in the new vocabulary; its chains keep their own order, and the background its place.
        return self._only(header, {m: n for n, m in enumerate(kept)} | {-1 - b: -1 - b for b in range(self._shown)})

    def without_background(self, gone: int) -> Self:
        """The same without this movement of the background, by its place in the header's."""
        left = [b for b in range(self._shown) if b != gone]
        header = replace(self.header, background=tuple((self.header.background or ())[b] for b in left))
        movements = {m: m for m in range(header.vocabulary.size)}
        return self._only(header, movements | {-1 - b: -1 - n for n, b in enumerate(left)})

    @property
    def _shown(self) -> int:
        """How many movements of the background."""
        return len(self.header.background or ())

    def _only(self, header: Header, place: Mapping[int, int]) -> Self:
        """Only these movements, and where they stand then."""
        chosen = np.isin(self._movement_of, list(place))
        movement_of = np.array([place[m] for m in self._movement_of[chosen].tolist()], dtype=np.int64)
        return type(self)(header, self._chains[chosen], movement_of, self._facing_of[chosen])

    def watch(self, onset: Onset) -> "_PhaseWatch":
        """Start the filter at rest, or at the first phases where the onset is known."""
        given = self.header.parameters
        dynamics = Dynamics(
            steps=steps_in(self._share)[None],
            speeds=np.ones(1),
            jitter=np.ones((1, 1)),
            entry=np.array(ENTRY),
            begin=1 - (1 - given["begin"]) ** self._share,
            forget=1 - (1 - given["forget"]) ** self._share,
        )
        phases = self._chains.shape[1]
        belief = ChainFilter(self._cell_of, self.answers, self.facings, phases, dynamics, onset.known)
        return _PhaseWatch(self, _reader(self.header), belief)

    def chosen(self) -> Chosen:
        """The chains' postures, for one watch."""
        return Chosen(self._postures)

    def evidence(self, features: Floats, chosen: Chosen) -> PostureEvidence:
        """(D,) features, NaN where not seen -> what they say of every chain, phase and rest."""
        given = self.header.parameters
        of_rest = (self._first, self._last, self._cell_of, (self.answers, self.facings))
        # Twice as many frames a second say the same twice.
        sharpness, outlier = given["sharpness"] * self._share, given["outlier"] * self._share
        return PostureEvidence(chosen, of_rest, features, sharpness, outlier)


class _PhaseWatch:
    def __init__(self, model: Phase, reader: PostureReader, belief: ChainFilter) -> None:
        self._model, self._reader, self._belief = model, reader, belief
        self._chosen = model.chosen()
        self._rested = False
        self._movements = model.header.vocabulary.size
        self._frames, self._said = 0, np.zeros(self._movements)

    @property
    def p(self) -> Floats:
        """(M,) posterior over movements."""
        p: Floats = self._learned.sum(axis=1)
        return p

    @property
    def joint(self) -> Floats | None:
        """(M, K) posterior over movements and facings; None where only one facing was learned."""
        return self._learned if self._model.facings > 1 else None

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(something else, facing); None where no background was learned."""
        return self._belief.joint[self._movements] if self._model.answers > self._movements else None

    @property
    def _learned(self) -> Floats:
        joint = self._belief.joint
        return joint if len(joint) == self._movements else given_learned(joint)

    @property
    def rest(self) -> float:
        """P(at rest now)."""
        return self._belief.rest

    @property
    def foreseen(self) -> Floats | None:
        """(M,) mean log probability a frame of the movement that goes on, else of the last; None before any."""
        return self._said / self._frames if self._frames else None

    def update(self, tracks: Tracks) -> None:
        features = self._reader.update(tracks)
        if not np.isfinite(features).any():
            self._belief.step_blind()
            return
        self._belief.step(self._model.evidence(features, self._chosen))
        if self._belief.rest >= 0.5:
            self._rested = True
            return
        if self._rested:
            self._rested, self._frames, self._said = False, 0, np.zeros_like(self._said)
        self._frames, self._said = self._frames + 1, self._said + self._belief.said[: self._movements]


def _reader(header: Header) -> PostureReader:
    return PostureReader(header.body_parts, header.rate_hz, header.parameters["fast"], header.parameters["apart"])


def _features_of(example: Example, header: Header) -> Floats:
    return Phase.read(header, example) if example.features is None else example.features
