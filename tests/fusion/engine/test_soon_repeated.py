"""What one movement is: short ones that are soon repeated, and labels that are periodic; on the pure engine."""

import pytest
from engine_stage import CONFIG, STEP_NS, UNIFORM, VIEWS, VOCABULARY, EngineDriver, sure

from common.message_types import MovementTimes
from common.vocabulary import Vocabulary
from fusion.engine.segmenter import Segmenter
from fusion.engine.segments import PooledState

TIMES = {"bow": MovementTimes(shortest_s=0.6, rest_s=0.8, period_s=0.5), "punch": MovementTimes(shortest_s=0.6)}
PERIODIC = Vocabulary(VOCABULARY.labels, "karate", TIMES)


def performed(rest_s, at_rest, times=6, rate_hz=30, vocabulary=VOCABULARY, label="bow", **config):
    """The verdicts on movements of 0.6 s that four unanimous observers see, `rest_s` apart. at_rest: what they believe
    of the movement at rest."""
    scene = EngineDriver(quorum=2, threshold=0.6, hold_s=0.1, **config)
    if vocabulary is not VOCABULARY:
        scene.engine.change_vocabulary(vocabulary, scene.now_ns)
    parts = [
        (UNIFORM, 0.98, 1.5),
        *[(sure(label, 0.96), 0.02, 0.6), (at_rest, 0.98, rest_s)] * times,
        (UNIFORM, 0.98, 2),
    ]
    done = 0.0
    for p, rest, seconds in parts:
        for _ in range(round(seconds * rate_hz)):
            scene.now_ns, scene.seq = scene.now_ns + round(1e9 / rate_hz), scene.seq + 1
            done += 1 / rate_hz / 0.5 if rest < 0.5 else 0.0
            counted = done if label in vocabulary.periods else None
            for name in VIEWS:
                assert scene.publish(name, p, rest, repetitions=counted) is None
            scene.fuse()
    return scene.verdicts


@pytest.mark.parametrize("rate_hz", [10, 30])
@pytest.mark.parametrize("at_rest", [sure("bow", 0.96), UNIFORM], ids=["held at rest", "forgotten at rest"])
@pytest.mark.parametrize("rest_s", [0.3, 0.5, 1.0])
def test_short_movements_that_are_soon_repeated_are_movements_of_their_own(rest_s, at_rest, rate_hz):
    verdicts = performed(rest_s, at_rest, rate_hz=rate_hz)
    assert [(v.stage, v.label) for v in verdicts] == [("decided", "bow"), ("ended", "bow")] * 6
    assert len({v.id for v in verdicts}) == 6 and {v.repetitions for v in verdicts} == {None}


@pytest.mark.parametrize("rest_s", [0.3, 0.5, 0.7])
def test_a_periodic_label_is_one_movement_with_its_count_for_as_long_as_it_is_repeated(rest_s):
    decided, ended = performed(rest_s, sure("bow", 0.96), vocabulary=PERIODIC)
    assert (decided.stage, decided.label, ended.stage, ended.label) == ("decided", "bow", "ended", "bow")
    assert decided.id == ended.id and decided.repetitions <= 1 and ended.repetitions == 7  # six of 0.6 s, 0.5 s each
    assert (ended.ended_ns - ended.began_ns) / 1e9 == pytest.approx(6 * 0.6 + 5 * rest_s, abs=0.1)


@pytest.mark.parametrize(
    ("vocabulary", "label", "config", "movements"),
    [
        (PERIODIC, "bow", {}, 6),
        (PERIODIC, "punch", {}, 6),
        (PERIODIC, "punch", {"periodic": ("punch",)}, 6),
        (VOCABULARY, "punch", {"periodic": ("punch",)}, 6),
    ],
    ids=["longer than between two takes", "not periodic", "by the scene file, too long", "without takes"],
)
def test_after_a_longer_rest_it_is_another_movement(vocabulary, label, config, movements):
    verdicts = performed(1.0, UNIFORM, vocabulary=vocabulary, label=label, **config)
    assert len({v.id for v in verdicts}) == movements and verdicts[-1].stage == "ended"


@pytest.mark.parametrize(("periodic", "movements"), [(None, 1), ((), 6), (("punch",), 6), (("bow",), 1)])
def test_the_scene_file_says_which_labels_are_periodic_in_place_of_the_takes(periodic, movements):
    verdicts = performed(0.3, UNIFORM, vocabulary=PERIODIC, periodic=periodic)
    assert len({v.id for v in verdicts}) == movements


def words(*parts, vocabulary=PERIODIC):
    """Stage, label, begin and end, in steps of 0.1 s; a part is a label, p, rest, P(something else), and steps."""
    segmenter, published, step = Segmenter(CONFIG, vocabulary), [], 0
    for label, p, rest, unlearned, steps in parts:
        for _ in range(steps):
            published += segmenter.update(PooledState(step * STEP_NS, label, p, 4, rest, unlearned))
            step += 1
    return [(d.stage, d.label, d.began_ns // STEP_NS, d.ended_ns and d.ended_ns // STEP_NS) for d in published]


BOW, ELSE, REST = ("bow", 0.95, 0.05, 0.02), ("bow", 0.05, 0.05, 0.94), ("bow", 0.5, 0.95, 0.02)


def test_short_gaps_of_something_else_or_rest_do_not_end_a_periodic_movement():
    story = [(*BOW, 8), (*ELSE, 7), (*BOW, 8), (*REST, 6), (*BOW, 8), (*ELSE, 4), (*REST, 4), (*BOW, 8), (*REST, 20)]
    assert words(*story) == [("decided", "bow", 0, None), ("ended", "bow", 0, 53)]


def test_longer_ones_do_and_it_ends_when_it_was_seen_last():
    first = [("decided", "bow", 0, None), ("ended", "bow", 0, 8)]
    for gap in ((*ELSE, 14), (*REST, 14)):
        verdicts = words((*BOW, 8), gap, (*BOW, 8), (*REST, 14))
        assert verdicts == [*first, ("decided", "bow", 22, None), ("ended", "bow", 22, 30)]


def test_another_label_ends_a_periodic_movement_as_any_other():
    verdicts = words((*BOW, 8), (*REST, 4), ("punch", 0.95, 0.05, 0.02, 8), (*REST, 14))
    assert [(stage, label) for stage, label, *_ in verdicts] == [
        ("decided", "bow"), ("ended", "bow"), ("decided", "punch"), ("ended", "punch"),
    ]  # fmt: skip
    assert verdicts[1][3] == 8 and verdicts[2][2] == 12


@pytest.mark.parametrize(
    ("shortest_s", "steps", "movements"),
    [(None, 4, 2), (2.0, 4, 1), (2.0, 6, 1), (2.0, 9, 2), (0.6, 4, 2)],
    ids=["unknown", "far too short", "too short", "long enough", "short takes"],
)
@pytest.mark.parametrize("named", [True, False], ids=["with its label", "without a label"])
def test_what_follows_a_pause_and_is_far_shorter_than_any_take_is_no_movement(shortest_s, steps, movements, named):
    vocabulary = Vocabulary(VOCABULARY.labels, movements={"bow": MovementTimes(shortest_s=shortest_s)})
    end = BOW if named else ("bow", 0.5, 0.05, 0.02)
    verdicts = words((*BOW, 16), ("bow", 0.9, 0.95, 0.02, 5), (*end, steps), (*REST, 14), vocabulary=vocabulary)
    assert len({began for _, _, began, _ in verdicts}) == movements


@pytest.mark.parametrize(("steps", "movements"), [(4, 1), (9, 2)])
def test_nor_is_what_follows_if_another_label_was_likelier_at_rest(steps, movements):
    """One of two observers takes a turn for rest, the other names another movement: seen when a third was killed."""
    vocabulary = Vocabulary(VOCABULARY.labels, movements={"bow": MovementTimes(shortest_s=2.0)})
    end = ("punch", 0.5, 0.05, 0.02, steps)
    verdicts = words((*BOW, 16), ("punch", 0.5, 0.95, 0.02, 5), end, (*REST, 14), vocabulary=vocabulary)
    assert len({began for _, _, began, _ in verdicts}) == movements


@pytest.mark.parametrize("restarted", [False, True], ids=["stands by", "starts"])
def test_a_service_that_takes_over_goes_on_with_the_count(restarted):
    owner, second = EngineDriver(), EngineDriver()
    for scene in (owner, second):
        scene.engine.change_vocabulary(PERIODIC, scene.now_ns)
    for n in range(13):
        judgement = owner.step(dict.fromkeys(VIEWS, sure("bow", 0.96)), 0.02, repetitions=n / 2)
        if not restarted:
            second.step(dict.fromkeys(VIEWS, sure("bow", 0.96)), 0.02, repetitions=n / 2)
        second.engine.continue_from(judgement)
    assert judgement.repetitions == 6 and owner.verdicts[0].repetitions == 1
    second.now_ns, second.seq, second.verdicts = owner.now_ns, owner.seq, []
    # Those that observers have counted since their own start are fewer.
    second.step(dict.fromkeys(VIEWS, sure("bow", 0.96)), 0.02, 4, repetitions=1.0)
    second.step(dict.fromkeys(VIEWS, sure("bow", 0.96)), 0.98, 12, repetitions=1.0)
    (ended,) = second.verdicts
    assert (ended.stage, ended.repetitions, ended.id) == ("ended", 6, owner.verdicts[0].id)
