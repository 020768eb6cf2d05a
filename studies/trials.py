"""The training and test data: movements, people, turns, unknown onsets. Seeded, pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.body import OF_JERKS, QUIET_SHARE
from observer.geometry.views import turned
from observer.motion.archive import MotionArchive, Recording, Span, labels_of, movements_in, retime, subjects_in
from observer.motion.label_sets import labels_in
from observer.tracks import BODY_PARTS

SLOWEST, FASTEST = 0.6, 1.7
STANDING_S = (0.5, 2.0)
IDLE_NOISE_M = 0.01
"""Trembling of a tracked hand at rest: in the quiet half of the recordings it moves 0.8 to 3 cm a frame."""
BETWEEN_S = (1.0, 2.5)
UNLEARNED_OTHERS = "others"
Labels = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class EvaluationTrial:
    """One recording to judge; the movement is in frames begin..end-1. turn_deg: to the performer's left, 0 to 360."""

    recording: Recording
    begin: int
    end: int
    turn_deg: float = 0.0

    @property
    def name(self) -> str:
        """Movement, subject and trial, as in the paper's figures."""
        return f"{self.recording.label} {self.recording.subject}.{self.recording.trial}"

    def frame_at(self, fraction: float) -> int:
        """The last frame that may be used once `fraction` (0 to 1) of the true segment is over."""
        return self.begin + max(int(np.ceil(fraction * (self.end - self.begin) - 1e-9)), 1) - 1


@dataclass(frozen=True, slots=True)
class Split:
    """Training and test recordings of different people; streams: the training people's continuous recordings."""

    train: MotionArchive
    test: tuple[Recording, ...]
    streams: tuple[Recording, ...] = ()


def with_labels(archive: MotionArchive, labels: Sequence[str]) -> MotionArchive:
    """Only the recordings of these movements, cut out; raises BadInput for a movement without a recording."""
    pieces = tuple(r for r in movements_in(archive) if r.label in labels)
    for label in labels:
        if not any(r.label == label for r in pieces):
            raise BadInput(f"--labels: {label!r} is in no recording; known: {', '.join(labels_of(archive))}")
    return MotionArchive(archive.body_parts, pieces)


def splits(
    archive: MotionArchive, train_subjects: Sequence[str], test_subjects: Sequence[str], leave_one_out: bool
) -> Iterator[Split]:
    """One split by the listed subjects, or with leave_one_out one per subject, which is then the only test subject.

    Without subjects every other one is for training. With leave_one_out, train_subjects are the people who are left
    out in turn, so that parameters can be chosen without the test subjects. Raises BadInput for an unknown subject, a
    subject in both sets, an empty set, and for test subjects together with leave_one_out.
    """
    subjects = subjects_in(archive.recordings)
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
        raise BadInput(f"subject {both[0]!r}: both in training and in test; name each person in one of them")
    if not train or not test:
        raise BadInput("no subject is left to train or to test on; name them with --train-subjects, --test-subjects")
    yield _split(archive, train, test)


def _one_left_out(archive: MotionArchive, among: Sequence[str], test_subjects: Sequence[str]) -> Iterator[Split]:
    if test_subjects:
        raise BadInput("--leave-one-subject-out judges every person in turn: omit --test-subjects")
    if len(among) < 2:
        raise BadInput(f"--leave-one-subject-out: 1 person only, {among[0]!r}; at least 2 are needed")
    for subject in among:
        yield _split(archive, [s for s in among if s != subject], [subject])


def _split(archive: MotionArchive, train: Sequence[str], test: Sequence[str]) -> Split:
    learned = tuple(r for r in archive.recordings if r.subject in train)
    return Split(MotionArchive(archive.body_parts, learned), tuple(r for r in archive.recordings if r.subject in test))


def make_trials(
    recordings: Sequence[Recording], *, onset_known: bool, turn: float | None, rng: np.random.Generator
) -> list[EvaluationTrial]:
    """The trials that observers watch. turn: degrees, or None for a random facing in each trial.

    Unknown onset: retimed by 0.6 to 1.7, with 0.5 to 2 s of trembling rest before and after.
    """
    return [_trial(recording, onset_known, turn, rng) for recording in recordings]


def _trial(recording: Recording, onset_known: bool, turn: float | None, rng: np.random.Generator) -> EvaluationTrial:
    angle_rad = np.deg2rad(rng.uniform(0, 360) if turn is None else turn)
    turn_deg = float(np.rad2deg(angle_rad)) % 360
    if angle_rad:
        recording = replace(recording, positions=turned(recording.positions, float(angle_rad)))
    if onset_known:
        return EvaluationTrial(recording, 0, len(recording.positions), turn_deg)
    # Uniform in the logarithm, so that slower and faster are equally frequent.
    tempo = float(np.exp(rng.uniform(np.log(SLOWEST), np.log(FASTEST))))
    moving = retime(recording, tempo).positions
    shortest, longest = (round(s * recording.rate_hz) for s in STANDING_S)
    before, after = (int(n) for n in rng.integers(shortest, longest, size=2, endpoint=True))
    still = np.concatenate([np.repeat(moving[:1], before, axis=0), np.repeat(moving[-1:], after, axis=0)])
    still = (still + rng.normal(0, _trembling(moving), still.shape)).astype(np.float32)
    whole = np.concatenate([still[:before], moving, still[before:]])
    return EvaluationTrial(replace(recording, positions=whole), before, before + len(moving), turn_deg)


def strung(recordings: Sequence[Recording], rng: np.random.Generator) -> list[Recording]:
    """One stream per person: the recordings in random order, with rest of 1 to 2.5 s before, between and after."""
    return [
        _string([recordings[i] for i in rng.permutation(len(recordings)) if recordings[i].subject == subject], rng)
        for subject in dict.fromkeys(r.subject for r in recordings)
    ]


def _string(recordings: Sequence[Recording], rng: np.random.Generator) -> Recording:
    """Each recording is shifted so that it begins where the one before left the head, or else the last part."""
    rate, pieces, spans, frames = recordings[0].rate_hz, [], [], 0
    noise = _trembling(recordings[0].positions)
    last = recordings[0].positions[0]
    anchor = min(BODY_PARTS.index("head"), len(last) - 1)
    for recording in recordings:
        moved = recording.positions + np.nan_to_num(last[anchor] - recording.positions[0, anchor])
        idle = _idle(last, moved[0], round(rng.uniform(*BETWEEN_S) * rate), noise, rng)
        pieces += [idle, moved]
        spans.append(Span(frames + len(idle), frames + len(idle) + len(moved), recording.label))
        frames += len(idle) + len(moved)
        last = moved[-1]
    pieces.append(_idle(last, last, round(rng.uniform(*BETWEEN_S) * rate), noise, rng))
    positions = np.concatenate(pieces).astype(np.float32)
    return Recording(positions, rate, "", recordings[0].subject, "strung", tuple(spans))


def _idle(
    before: NDArray[np.float32], after: NDArray[np.float32], frames: int, noise: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Trembling rest, with a slow shift from one resting posture to the next."""
    share = np.clip(np.linspace(-0.5, 1.5, frames), 0, 1)[:, None, None]
    smooth = share * share * (3 - 2 * share)
    still = before * (1 - smooth) + after * smooth
    return (still + rng.normal(0, noise, still.shape)).astype(np.float32)


def _trembling(positions: NDArray[np.float32]) -> float:
    """Standard deviation of a coordinate of a person at rest: of positions in metres, or as the tracks show it."""
    if positions.shape[2] == 3:
        return IDLE_NOISE_M
    jerks = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=2)
    known = jerks[np.isfinite(jerks)]
    return float(np.quantile(known, QUIET_SHARE)) / OF_JERKS if len(known) else 0.0


def unlearned_and_background(
    unlearned: str, background: str, learned: Labels, known: Labels, seed: int = 0
) -> tuple[Labels, Labels]:
    """The values of --unlearned and --background-labels -> the movements of each; known: all of the archive.

    `others` are all movements that are neither learned nor background. A number for the background draws that many
    of the unlearned movements, which are then not shown. Raises BadInput for a movement in two of learned, background
    and unlearned.
    """
    chosen = _background(background)
    shown = (
        tuple(m for m in known if m not in learned)
        if unlearned == UNLEARNED_OTHERS
        else labels_in(unlearned, "--unlearned")
    )
    _require_apart("--unlearned", shown, learned)
    if isinstance(chosen, int):
        chosen = _drawn(chosen, shown, seed)
        return tuple(m for m in shown if m not in chosen), chosen
    _require_apart("--background-labels", chosen, learned)
    if unlearned == UNLEARNED_OTHERS:
        return tuple(m for m in shown if m not in chosen), chosen
    for label in shown:
        if label in chosen:
            raise BadInput(f"--background-labels: {label!r} is also in --unlearned; name it in one of them")
    return shown, chosen


def _background(text: str) -> Labels | int:
    return int(text) if text.isdecimal() else labels_in(text, "--background-labels")


def _drawn(count: int, shown: Sequence[str], seed: int) -> Labels:
    if not 0 < count < len(shown):
        raise BadInput(
            f"--background-labels {count}: needs 1 to one less than the {len(shown)} movements of --unlearned; "
            "try --unlearned others"
        )
    chosen = np.random.default_rng([seed, 3]).permutation(len(shown))[:count]
    return tuple(shown[n] for n in sorted(chosen.tolist()))


def _require_apart(option: str, labels: Sequence[str], learned: Sequence[str]) -> None:
    for label in labels:
        if label in learned:
            raise BadInput(f"{option}: {label!r} is one of the learned movements; name the others in --labels")
