"""Messages of bounded size: optional detail goes first, judgements are short, and what cannot fit is refused."""

import re

import msgpack
import numpy as np
import pytest
from doc_pages import ROOT
from hypothesis import given
from message_stage import DISTRIBUTIONS, judgement, posterior, reason_of, status, verdict, vote

from common import message_checks
from common.config import ObserverConfig, Scene
from common.errors import BadInput, LabanmeshError
from common.facets import FACETS
from common.message_types import VotedFacing, VotedRepeated, p_of_roots
from common.messages import (
    Contribution,
    Facing,
    JudgementMessage,
    ObserverStatistics,
    OngoingMovement,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
)
from common.probability import roots_of
from common.wire import OPTIONAL_DETAIL, SIZE_LIMIT, decode, encode


def detail_left_out(fields):
    """Which optional detail is missing in a judgement of which each vote has all of it."""
    first = next(iter(fields["votes"].values()))
    return [d for d in OPTIONAL_DETAIL if (first.get(d[1]) is None if len(d) == 2 else d[0] not in fields)]


def test_a_judgement_that_is_too_long_loses_optional_detail_in_order_until_it_fits():
    others, facets = {f"cam{n}": 0.5 for n in range(20)}, {"own": [0.5, 0.5]}
    entry = vote(
        p=[0.01] * 100,
        facing=VotedFacing(surprise=[[9] * 12] * 100),
        facets=facets,
        doubles=others,
        rest_reliability=0.5,
        label_reliability=0.5,
        repetitions=2.5,
        repeated=VotedRepeated(partial=0.5, swing=1.0),
    )
    contributions = dict.fromkeys(others, Contribution(nats=1.0, stands=True))
    elsewhere = ("votes", "root_p"), ("facing",), ("why",), ("leans_on",), ("observers",), ("movements",)
    detail = [d for d in OPTIONAL_DETAIL if d not in elsewhere]
    steps = set()
    for size in range(500, 6900, 100):
        message = verdict(
            p=[1 / size] * size, facets=facets, contributions=contributions, votes=dict.fromkeys(others, entry),
            score=7.5, scores={"cam1": 7.5}, remarks=["left knee: 12 degrees too straight at 60 %"],
            unscored="its begin was not seen",
        )  # fmt: skip
        payload = encode(message)
        missing = [d for d in detail_left_out(msgpack.unpackb(payload)) if d in detail]
        assert len(payload) <= SIZE_LIMIT and missing == detail[: len(missing)]
        assert decode(VerdictMessage, payload).p == message.p
        steps.add(len(missing))
    assert 0 in steps and {1, 2, 3} & steps and max(steps) >= 4


def test_a_posterior_and_a_status_that_are_too_long_lose_optional_detail():
    size = 3000
    facing = Facing(surprise=[[200] * 12] * size)
    long = posterior(p=[1 / size] * size, facing=facing, facets={"own": [0.5, 0.5]})
    decoded = decode(PosteriorMessage, encode(long))
    assert decoded.facing is None and decoded.facets == long.facets and decoded.p == pytest.approx(long.p, rel=1e-7)
    observers = {f"cam{n}": ObserverStatistics(rejected={"malformed": n}) for n in range(3000)}
    assert decode(StatusMessage, encode(status(observers=observers))) == status()
    shares = {"hash": "h", "regions": ["arm"] * 7, "shares": [[9] * 7] * 9000}
    few = {"cam1": observers["cam1"]}
    assert decode(StatusMessage, encode(status(observers=few, leans_on=shares))) == status(observers=few)


def test_a_message_that_cannot_fit_is_an_error_and_not_sent():
    with pytest.raises(LabanmeshError, match=r"VerdictMessage: .* bytes without optional detail"):
        encode(verdict(p=[0.0001] * 9000))


def scene_of(observers, labels):
    sections = {f"observer{n}": ObserverConfig(source="0") for n in range(observers)}
    return Scene(scene="dojo", vocabulary=tuple(f"movement_{n:05}" for n in range(labels)), observers=sections)


@pytest.mark.parametrize(
    ("observers", "labels", "fault"),
    [
        (4, 20, None),
        (40, 200, None),
        (200, 1000, None),
        (600, 20, "600 observers and 20 movements"),
        (1, 4400, "4400 movements take"),
    ],
)
def test_a_scene_whose_messages_cannot_fit_is_refused(observers, labels, fault):
    scene = scene_of(observers, labels)
    if fault is None:
        message_checks.require_fits(scene)
        p, label = [1 / labels] * labels, scene.vocabulary[0]
        votes = dict.fromkeys(scene.roster, vote(label=label, p=p, doubles={}, root_p=roots_of(np.array(p)).tolist()))
        assert len(encode(verdict(p=p, votes=votes))) <= SIZE_LIMIT
        if observers <= 40:
            received = decode(JudgementMessage, encode(judgement(p=p, votes=votes, label=label)))
            assert {len(each.p) for each in received.votes.values()} == {labels}, "all that a standby service needs"
        return
    with pytest.raises(BadInput, match=fault) as caught:
        message_checks.require_fits(scene)
    assert "\n" not in str(caught.value) and "use fewer" in str(caught.value)


FULL_VOTE = vote(
    p=[0.25, 0.75], rest=0.25, skew_s=-0.5, unlearned=0.125, facing=VotedFacing(surprise=[[0], [9]]), root_p=[128, 221],
    facets={"own": [0.5, 0.5]}, reliability=0.75, doubles={"cam2": 0.5},
)  # fmt: skip


def test_a_judgement_whose_votes_have_roots_is_short_unless_it_is_to_be_full():
    silent = vote(label=None, entropy=None, weight=0.0, age_s=None, state="silent", reliability=1.0)
    message = judgement(
        votes={"cam1": FULL_VOTE, "cam2": silent}, movement=OngoingMovement(id="dojo-1", began_ns=3), unlearned=0.25
    )
    short = msgpack.unpackb(encode(message))
    needed = {"label", "entropy", "weight", "age_s", "state"}
    assert set(short["votes"]["cam1"]) == needed | {"rest", "skew_s", "unlearned", "reliability", "root_p"}
    assert set(short["votes"]["cam2"]) == needed | {"reliability"} and set(short["movement"]) == {"id", "began_ns"}
    full = decode(JudgementMessage, encode(message, full=True))
    first = message.votes["cam1"].model_copy(update={"root_p": None})
    assert full == message.model_copy(update={"votes": {"cam1": first, "cam2": silent}})
    # A verdict is evidence, and there is one of each movement.
    assert decode(VerdictMessage, encode(verdict(votes=message.votes))).votes == full.votes


def test_who_receives_a_short_judgement_has_all_that_is_shown():
    message = judgement(votes={"cam1": FULL_VOTE.model_copy(update={"reliability": 1.0})}, unlearned=0.25)
    decoded = decode(JudgementMessage, encode(message))
    assert decoded.model_copy(update={"votes": message.votes}) == message
    received = decoded.votes["cam1"]
    assert received.p == pytest.approx([0.25, 0.75], abs=0.004) and sum(received.p) == pytest.approx(1)
    assert (received.rest, received.skew_s, received.unlearned, received.reliability) == (0.25, -0.5, 0.125, 1.0)
    assert encode(decoded) == encode(message)
    # A forged number that single precision does not have.
    forged = message.model_copy(update={"certainty_bits": 1e300})
    assert decode(JudgementMessage, encode(forged)).certainty_bits == 1e300


@given(DISTRIBUTIONS)
def test_the_roots_of_a_distribution_are_precise(p):
    assert p_of_roots(roots_of(np.array(p)).tolist()) == pytest.approx(p, abs=0.004, rel=0)


@pytest.mark.parametrize("roots", [[], [0, 0], [-1, 255], [256, 0], [1.5, 2], "ab", [1] * 10_001])
def test_roots_that_are_no_distribution_are_rejected(roots):
    fields = {**judgement().model_dump(), "votes": {"cam1": {**vote().model_dump(), "root_p": roots}}}
    assert reason_of(JudgementMessage, msgpack.packb(fields)) == "malformed"


def test_a_posterior_has_as_many_bytes_as_wire_md_says():
    page = (ROOT / "docs/reference/wire.md").read_text("utf-8").partition("\n## Bytes\n")[2]
    rows = r"has about (\d+) bytes.*?\sand\s(\d+) more.*?, three facets \| (\d+) .*?, seven facets \| (\d+) "
    documented = map(int, re.search(rows, page, re.DOTALL).groups())

    def size(facets="none", **more):
        facets = {name: [1 / len(ends)] * len(ends) for name, ends in FACETS.items() if name.startswith(facets)} or None
        stamps = {"captured_ns": 2**60, "sent_ns": 2**60, "frames": 3000, "seq": 3000, "session": "oZ3f-Q"}
        beliefs = {"p": [0.05] * 20, "rest": 0.1, "unlearned": 0.1, "vocabulary": {"hash": "18cd4f5c227ff9f1"}}
        return len(encode(posterior(v=2, scene=None, observer=None, facets=facets, **stamps, **beliefs, **more)))

    parts = dict.fromkeys(("left_hand", "right_hand", "head"), False)
    more = [each - size() for each in (size(visible=parts), size("shape"), size(""))]
    assert [size(), *more] == [pytest.approx(each, rel=0.03) for each in documented]
