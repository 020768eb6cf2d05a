"""The cost of one model update: a frame through tracker, features, evidence and belief, once for each model.

Floors: the numpy arithmetic that no implementation of the same model can leave out, on arrays of the same shapes,
written into memory that is there already:
- phase: one float32 matrix-vector product over all chains x features, one exp, one multiplication of the state; with
  facings there are as many times more chains. It can be undercut: chains that no longer count are left out.
- phase-symbols: a sum over body parts out of the table, one exp, one multiplication of the state (speeds included).
- frame-table: the sum over body parts out of one bin of the table, added to the log belief.
"""

import tracemalloc
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path

import numpy as np

from benchmarks.timing import BATCH_S, ROUNDS, Row, compare, row
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning import frames_of, labels_of, learn_view
from observer.model.base import Arrays, MovementModel, Onset
from observer.model.phase_symbols import PhaseSymbols
from observer.model.registry import MODELS
from observer.motion.archive import MotionArchive
from observer.motion.importers import import_recordings
from observer.pipeline import Observer
from observer.projected import ProjectedTracker
from studies.performer import perform

Work = Callable[[], object]
FACINGS = 12
RECORDINGS = 20
"""So many of the other half of the people are watched, one after the other, over and over."""


def rows(data: Path | None, rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Iterator[Row]:
    """One row a model; data: the folder of recordings, None for the synthetic performer."""
    train, test = halves(recorded(data))
    for kind in MODELS:
        yield measure(kind, learned(kind, train), test, rounds, batch_s)
    turning = learned("phase", train, FACINGS)
    yield measure(f"phase with {FACINGS} facings", turning, test, rounds, batch_s)
    yield memory(f"phase with {FACINGS} facings", turning)


def learned(kind: str, train: MotionArchive, facings: int = 1) -> MovementModel:
    """A model of all movements, seen from the Door."""
    parameters = {"facings": float(facings)} if facings > 1 else {}
    vocabulary = Vocabulary(labels_of(train), "bench")
    return learn_view(train, parse_view("door"), vocabulary, kind=kind, parameters=parameters, tried=False)


def measure(
    name: str, model: MovementModel, test: MotionArchive, rounds: int = ROUNDS, batch_s: float = BATCH_S
) -> Row:
    """`Observer.step` of one model against its floor."""
    tracker = ProjectedTracker(parse_view("door"), test.body_parts, test.body_parts)
    observer = Observer(tracker, model)
    frames = cycle([frame for recording in test.recordings for frame in frames_of(recording)])
    told = f"model update, {name}, {model.header.vocabulary.size} movements"
    floor = FLOORS[model.header.kind](model.arrays())
    return compare(told, lambda: observer.step(next(frames)), floor, rounds, batch_s)


def memory(name: str, model: MovementModel) -> Row:
    """Megabytes that a model takes once it is read and watches; the floor is that of its arrays alone."""
    arrays = {key: array.copy() for key, array in model.arrays().items()}
    tracemalloc.start()
    again = type(model).from_arrays(model.header, arrays)
    watch = again.watch(Onset())
    ours = tracemalloc.get_traced_memory()[0] + sum(array.nbytes for array in arrays.values())
    tracemalloc.stop()
    floor = sum(array.nbytes for array in arrays.values())
    return row(f"memory of a model, {name}, {len(watch.p)} movements", ours / 1e6, floor / 1e6, "MB", 1)


def recorded(data: Path | None) -> MotionArchive:
    """MSR Action3D, 20 movements; without it the synthetic performer, 8 movements."""
    return perform() if data is None else import_recordings("msr-action3d", data / "msr_action3d").archive


def halves(archive: MotionArchive) -> tuple[MotionArchive, MotionArchive]:
    """Every other person to learn from; some recordings of the others to watch."""
    learned = sorted({r.subject for r in archive.recordings}, key=lambda s: (len(s), s))[::2]
    train = tuple(r for r in archive.recordings if r.subject in learned)
    others = tuple(r for r in archive.recordings if r.subject not in learned)
    test = others[:: max(len(others) // RECORDINGS, 1)]
    return MotionArchive(archive.body_parts, train), MotionArchive(archive.body_parts, test)


def _phase_floor(arrays: Arrays) -> Work:
    chains = np.asarray(arrays["chains"], np.float32)
    postures, o = chains.reshape(-1, chains.shape[-1]), chains[0, chains.shape[1] // 2].copy()
    state, evidence = np.full(len(postures), 1.0 / len(postures), np.float32), np.empty(len(postures), np.float32)

    def floor() -> None:
        np.matmul(postures, o, out=evidence)
        np.exp(evidence, out=evidence)
        np.multiply(state, evidence, out=evidence)

    return floor


def _phase_symbols_floor(arrays: Arrays) -> Work:
    table = np.asarray(arrays["log_table"], np.float64)
    state = np.full((int(PhaseSymbols.DEFAULTS["speeds"]), *table.shape[:2]), 1.0 / table[..., 0, 0].size)
    parts, symbols, evidence, result = (
        np.arange(table.shape[2]),
        np.arange(table.shape[2]),
        state[0].copy(),
        state.copy(),
    )

    def floor() -> None:
        np.exp(table[:, :, parts, symbols].sum(axis=2, out=evidence), out=evidence)
        np.multiply(state, evidence, out=result)

    return floor


def _frame_table_floor(arrays: Arrays) -> Work:
    table = np.asarray(arrays["log_table"], np.float64)
    parts, symbols, belief = np.arange(table.shape[2]), np.arange(table.shape[2]), np.zeros(len(table))

    def floor() -> None:
        np.add(belief, table[:, 0, parts, symbols].sum(axis=1), out=belief)

    return floor


FLOORS: dict[str, Callable[[Arrays], Work]] = {
    "phase": _phase_floor,
    "phase-symbols": _phase_symbols_floor,
    "frame-table": _frame_table_floor,
}
