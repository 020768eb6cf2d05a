"""Replay of a scene that judges two people: each has the verdicts that were recorded of them."""

import pytest
from replay_stage import NAMES, NOON, OBSERVERS, ROOT, a_scene, key_of, steps

from common.arrival import CaptureRecord
from common.config_people import PeopleConfig
from common.floor_place import FloorPlace
from common.wire import encode, encode_vocabulary
from fusion.people import ScenePeople
from fusion.people_ingest import PeopleIngest
from studies.fusion_engine import FusionEngine
from studies.replay.from_judgements import ReplayChange
from studies.replay.judging import judge_again

PLACES = {"l": (1.0, 0.0), "r": (-1.0, 0.0)}
# In turn: the left one bows while the right one stands, and so on.
PLAYS = {
    "l": [(0.5, 1.5, dict.fromkeys(OBSERVERS, "bowing")), (2.5, 0.0, {})],
    "r": [(1.5, 1.5, dict.fromkeys(OBSERVERS, "lunging")), (1.5, 0.0, {})],
}


@pytest.fixture
def scene():
    return a_scene(start_s=0).model_copy(update={"people": PeopleConfig(most=2, names=("left", "right"))})


@pytest.fixture
def recorded(scene):
    """The records of a service that judges both."""
    people = ScenePeople(scene.people.ids)
    engines = {p: FusionEngine("dojo", list(OBSERVERS), NAMES, scene.fusion, p) for p in scene.people.ids}
    ingest = PeopleIngest(people, lambda _: None)
    result = [CaptureRecord("answer", f"{ROOT}/vocabulary", encode_vocabulary("dojo", NAMES), NOON)]
    plays = {track: steps(play, seed=n) for n, (track, play) in enumerate(PLAYS.items())}
    for (at_ns, left), (_, right) in zip(plays["l"], plays["r"], strict=True):
        posteriors = []
        for track, own in (("l", left), ("r", right)):
            for message in own:
                place = FloorPlace(at=PLACES[track], covariance=(0.04, 0.0, 0.04))
                fields = {"person": track, "place": place, "seq": 2 * message.seq + (track == "r")}
                posteriors.append((message.observer, message.with_fields(**fields)))
        result += [CaptureRecord("put", key_of(name), encode(message), at_ns) for name, message in posteriors]
        for person, own in ingest.sort(posteriors, at_ns).items():
            place = people.place(person, at_ns)
            engines[person].place = None if place is None else [round(each, 2) for each in place]
            for posterior in own:
                engines[person].receive(*posterior, at_ns)
        for engine in engines.values():
            output = engine.step(at_ns)
            result += [CaptureRecord("put", f"{ROOT}/verdict", encode(each), at_ns) for each in output.verdicts]
            judgement = encode(output.judgement, full=True)
            result.append(CaptureRecord("put", f"{ROOT}/judgement", judgement, at_ns))
    return result


def whose(result):
    return [(row.last_replayed.person, row.last_replayed.label) for row in result.rows]


def test_from_judgements_both_people_have_their_verdicts_bit_for_bit(scene, recorded, write):
    result = judge_again(write(recorded, scene), ReplayChange())
    assert whose(result) == [("left", "bowing"), ("right", "lunging")]
    assert result.faithful and result.same == result.judgements > 60
    assert [row.likeness for row in result.rows] == ["bit for bit", "bit for bit"]
