"""One take, movement or person more changes a model a little: there is no number at which it judges in another way."""

from dataclasses import replace

import numpy as np
import pytest
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.motion.archive import MotionArchive
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS
from studies.performer import MOVEMENTS, perform

JUDGED_AT = (0.4, 0.7, 1.0)
FOUR = MOVEMENTS[:4]


@pytest.fixture(scope="module")
def people():
    """Three people to learn from, and one to judge; in their order by trial."""
    shown = perform(("1", "2", "3", "4"), MOVEMENTS, trials=9, seed=5).recordings
    return sorted(shown, key=lambda r: int(r.trial))


def takes_of(people, subjects, labels, trials, last=None):
    """The first takes; last: (subject, label) of whom one more is shown."""
    chosen = [r for r in people if r.subject in subjects and r.label in labels and int(r.trial) <= trials]
    if last is not None:
        chosen.append(next(r for r in people if (r.subject, r.label) == last and int(r.trial) > trials))
    return chosen


def mirrored(takes, label):
    """The same movement of the other hand, which is another movement."""
    left, right, head = range(3)
    swapped = (r.positions[:, [right, left, head]] * np.float32([-1, 1, 1]) for r in takes)
    return [replace(r, positions=positions, label=label) for r, positions in zip(takes, swapped, strict=True)]


SEEDS = (0.0, 1.0, 2.0, 3.0)


def judged(takes, labels, shown, seeds=SEEDS[:2]):
    """(N,) whether each instant is recognised, and (N,) nats of the right movement, by models of several seeds: another
    take is also another draw of the windows that give the kernels their biases."""
    return tuple(np.concatenate(each) for each in zip(*(_judged(takes, labels, shown, s) for s in seeds), strict=True))


def _judged(takes, labels, shown, seed):
    archive, vocabulary = MotionArchive(BODY_PARTS, tuple(takes)), Vocabulary(labels)
    model = learn_view(archive, DOOR, vocabulary, parameters={"kernels": 840.0, "seed": seed})
    right, nats = [], []
    for recording in shown:
        tracks, watch = view_tracks(DOOR, recording, BODY_PARTS, BODY_PARTS), model.watch(Onset(known=True))
        stops = {round(share * len(tracks)) for share in JUDGED_AT}
        for number, frame in enumerate(tracks, 1):
            watch.pass_over(frame)
            if number in stops:
                (watch.end if number == len(tracks) else watch.classify)()
                p, truth = watch.p, labels.index(recording.label)
                right.append(p.argmax() == truth)
                nats.append(-np.log(p[truth] * (1 - float(watch.unlearned.sum()))))
    return np.array(right), np.array(nats)


CLIFFS = {
    "60 and 61 takes": (FOUR, ("1", "2", "3"), 5, ("1", FOUR[0])),
    "1 and 2 people": (FOUR, ("1",), 5, ("2", FOUR[0])),
    "8 and 9 movements": (MOVEMENTS, ("1", "2"), 2, None),
}


@pytest.mark.parametrize(("labels", "subjects", "trials", "last"), CLIFFS.values(), ids=CLIFFS)
def test_one_more_changes_little(people, labels, subjects, trials, last):
    shown = takes_of(people, ("4",), labels, 9 if len(labels) == 4 else 5)
    few = takes_of(people, subjects, labels, trials)
    more, more_labels = takes_of(people, subjects, labels, trials, last), labels
    if last is None:
        more_labels = (*labels, "the_other_hand")
        more = [*few, *mirrored(takes_of(people, subjects, ("byebye",), trials), more_labels[-1])]
    # Models of many takes differ little by their seed, and take longest; those of few takes of many movements most.
    seeds = SEEDS[1:2] if len(few) >= 60 else SEEDS if last is None else SEEDS[:2]
    before, after = judged(few, labels, shown, seeds), judged(more, more_labels, shown, seeds)
    assert len(before[0]) >= 100
    # Two seeds of one model differ by up to 3 points.
    assert abs(np.mean(after[0]) - np.mean(before[0])) <= 0.05
    assert abs(np.mean(after[1]) - np.mean(before[1])) <= 0.1


def test_a_second_take_of_one_movement_lies_between_one_and_two_of_each(people):
    """It is half of all evidence about this movement, and none about the others."""
    shown = takes_of(people, ("4",), FOUR, 9)
    one, more, two = (
        [np.mean(each) for each in judged(takes, FOUR, shown)]
        for takes in (
            takes_of(people, ("1",), FOUR, 1),
            takes_of(people, ("1",), FOUR, 1, ("1", FOUR[0])),
            takes_of(people, ("1",), FOUR, 2),
        )
    )
    assert one[0] - 0.02 <= more[0] <= two[0] + 0.02
    assert two[1] - 0.1 <= more[1] <= one[1] + 0.1
