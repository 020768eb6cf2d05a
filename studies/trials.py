"""What is learned and what is judged: movements, people, turns, unknown onsets. Seeded, pure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from common.text import split_list
from observer.geometry.views import turned
from observer.learning.background import BLENDS
from observer.motion.archive import MotionArchive, Recording
from observer.motion.importers.msr_action3d import LABELS
from observer.motion.transforms import labels_of, movements_in, retime

SLOWEST, FASTEST = 0.6, 1.7
IDLE_S = (0.5, 2.0)
IDLE_NOISE_M = 0.01
"""How much a tracked hand that is held still trembles: the quiet half of the recordings moves 0.8 to 3 cm a frame."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One recording to be judged; the movement lies in frames begin..end-1 of it. turn_deg: to his left, 0 to 360."""

    recording: Recording
    begin: int
    end: int
    turn_deg: float = 0.0

    @property
    def name(self) -> str:
        """For people: movement, subject and trial, as the paper's figures cipher them."""
        return f"{self.recording.label} {self.recording.subject}.{self.recording.trial}"

    def frame_at(self, fraction: float) -> int:
        """The last frame that may be used when `fraction` of the true segment has been seen, 0 to 1."""
        return self.begin + max(int(np.ceil(fraction * (self.end - self.begin) - 1e-9)), 1) - 1


@dataclass(frozen=True, slots=True)
class Split:
    """Training and test recordings of different people."""

    train: MotionArchive
    test: tuple[Recording, ...]


def with_labels(archive: MotionArchive, labels: Sequence[str]) -> MotionArchive:
    """Only the recordings of these movements, cut out; raises BadInput for a movement that nobody performs."""
    pieces = tuple(r for r in movements_in(archive) if r.label in labels)
    for label in labels:
        if not any(r.label == label for r in pieces):
            known = ", ".join(labels_of(archive))
            raise BadInput(f"--labels: {label!r} is in no recording; known: {known}")
    return MotionArchive(archive.body_parts, pieces)


def splits(
    archive: MotionArchive, train_subjects: Sequence[str], test_subjects: Sequence[str], leave_one_out: bool
) -> Iterator[Split]:
    """One split by the subjects named, or one a subject: each in turn is the test, the others are learned from.

    With no subject named, every other one is learned from, or each of all left out in turn; with leave_one_out,
    train_subjects are the people among whom this is done, so that choices can be made without the test subjects.
    Raises BadInput for a subject who is unknown, or both learned from and judged, when nobody is left for either, and
    for test subjects beside leave_one_out.
    """
    subjects = sorted({r.subject for r in archive.recordings}, key=lambda s: (len(s), s))
    for subject in [*train_subjects, *test_subjects]:
        if subject not in subjects:
            raise BadInput(f"subject {subject!r}: not in the archive; it has {', '.join(subjects)}")
    if leave_one_out:
        yield from _one_left_out(archive, list(dict.fromkeys(train_subjects)) or subjects, test_subjects)
        return
    if not train_subjects and not test_subjects:
        train_subjects, test_subjects = subjects[0::2], subjects[1::2]
    train = train_subjects or [s for s in subjects if s not in test_subjects]
    test = test_subjects or [s for s in subjects if s not in train_subjects]
    both = [s for s in train if s in test]
    if both:
        raise BadInput(f"subject {both[0]!r}: both in training and in test; a judge must not know who he judges")
    if not train or not test:
        raise BadInput("no subject is left to train or to test on; name them with --train-subjects, --test-subjects")
    yield _split(archive, train, test)


def _one_left_out(archive: MotionArchive, among: Sequence[str], test_subjects: Sequence[str]) -> Iterator[Split]:
    if test_subjects:
        raise BadInput("--leave-one-subject-out judges everybody in turn: leave out --test-subjects")
    if len(among) < 2:
        raise BadInput(f"--leave-one-subject-out: one person only, {among[0]!r}; nobody is left to learn from")
    for subject in among:
        yield _split(archive, [s for s in among if s != subject], [subject])


def _split(archive: MotionArchive, train: Sequence[str], test: Sequence[str]) -> Split:
    learned = tuple(r for r in archive.recordings if r.subject in train)
    return Split(MotionArchive(archive.body_parts, learned), tuple(r for r in archive.recordings if r.subject in test))


def trials(
    recordings: Sequence[Recording], *, onset_known: bool, turn: float | None, rng: np.random.Generator
) -> list[Trial]:
    """What the judges get to see. turn: degrees, or None for any facing, drawn for each trial.

    Unknown onset: retimed by 0.6 to 1.7 and held still, trembling, for 0.5 to 2 s before and after.
    """
    return [_trial(recording, onset_known, turn, rng) for recording in recordings]


def _trial(recording: Recording, onset_known: bool, turn: float | None, rng: np.random.Generator) -> Trial:
    angle = np.deg2rad(rng.uniform(0, 360) if turn is None else turn)
    turn_deg = float(np.rad2deg(angle)) % 360
    if angle:
        recording = replace(recording, positions=turned(recording.positions, float(angle)))
    if onset_known:
        return Trial(recording, 0, len(recording.positions), turn_deg)
    # Evenly in the logarithm, so that as many are slower as are faster.
    tempo = float(np.exp(rng.uniform(np.log(SLOWEST), np.log(FASTEST))))
    moving = retime(recording, tempo).positions
    shortest, longest = (round(s * recording.rate_hz) for s in IDLE_S)
    before, after = (int(n) for n in rng.integers(shortest, longest, size=2, endpoint=True))
    still = np.concatenate([np.repeat(moving[:1], before, axis=0), np.repeat(moving[-1:], after, axis=0)])
    still = (still + rng.normal(0, IDLE_NOISE_M, still.shape)).astype(np.float32)
    whole = np.concatenate([still[:before], moving, still[before:]])
    return Trial(replace(recording, positions=whole), before, before + len(moving), turn_deg)


OTHERS = "others"
Labels = tuple[str, ...]


def strangers(
    unlearned: str, background: str, learned: Labels, known: Labels, seed: int = 0
) -> tuple[Labels, Labels | None]:
    """The texts of --unlearned and --background-labels -> the movements of each; known: all of the archive.

    `others` are all that are neither learned nor background. A number of background is drawn from the unlearned, which
    are then not shown. Raises BadInput for a movement that would be two of learned, background and unlearned.
    """
    chosen = _background(background)
    shown = tuple(m for m in known if m not in learned) if unlearned == OTHERS else split_list("--unlearned", unlearned)
    _require_apart("--unlearned", shown, learned)
    if isinstance(chosen, int):
        chosen = _drawn(chosen, shown, seed)
        return tuple(m for m in shown if m not in chosen), chosen
    if chosen is None:
        return shown, None
    _require_apart("--background-labels", chosen, learned)
    if unlearned == OTHERS:
        return tuple(m for m in shown if m not in chosen), chosen
    for label in shown:
        if label in chosen:
            raise BadInput(f"--background-labels: {label!r} is among --unlearned, which must not be known; name others")
    return shown, chosen


def _background(text: str) -> Labels | int | None:
    if not text:
        return None
    if text == BLENDS:
        return ()
    return int(text) if text.isdecimal() else split_list("--background-labels", text)


def _drawn(count: int, shown: Sequence[str], seed: int) -> Labels:
    if not 0 < count < len(shown):
        raise BadInput(
            f"--background-labels {count}: of {len(shown)} movements of --unlearned; "
            f"one at least must be drawn and one left, e.g. --unlearned others"
        )
    chosen = np.random.default_rng([seed, 3]).permutation(len(shown))[:count]
    return tuple(shown[n] for n in sorted(chosen.tolist()))


def _require_apart(option: str, named: Sequence[str], learned: Sequence[str]) -> None:
    for label in named:
        if label in learned:
            raise BadInput(f"{option}: {label!r} is among the movements that are learned; name others in --labels")


def _numbered(*numbers: int) -> tuple[str, ...]:
    return tuple(LABELS[number - 1] for number in numbers)


SUBSETS: Mapping[str, tuple[str, ...]] = {
    # Li, Zhang and Liu, "Action recognition based on a bag of 3D points", CVPR workshops 2010.
    "AS1": _numbered(2, 3, 5, 6, 10, 13, 18, 20),
    "AS2": _numbered(1, 4, 7, 8, 9, 11, 12, 14),
    "AS3": _numbered(6, 14, 15, 16, 17, 18, 19, 20),
}


def labels_in(text: str) -> tuple[str, ...]:
    """`a,b,AS1` -> the labels, subsets spelled out; raises BadInput for an empty piece."""
    return tuple(dict.fromkeys(label for word in split_list("--labels", text) for label in SUBSETS.get(word, (word,))))
