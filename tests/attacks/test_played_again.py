"""Real posteriors, captured and played again an hour later, in a plain and in a secured mesh: they count nothing. In
the plain mesh whoever plays them may use every key; in the secured one it has the certificate of an observer."""

import threading
import time
from contextlib import contextmanager

import pytest
from attack_fleet import Fleet
from attack_storm import aftermath, settle
from fault_stage import SECOND_NS, VIEWS, Replay, all_count

from common.config import read_scene
from common.keys import observer_of
from common.link import Link
from common.messages import PosteriorMessage
from common.wire import decode, encode

HOUR_NS = 3600 * SECOND_NS
CAPTURED_S = 12.0
THIEF = "door"
"""The observer whose certificate is stolen."""
CASES = {"of this session": "", "of an earlier session": "-before"}


@contextmanager
def linked(fleet, role, name):
    """A session with the certificate of one process, if the mesh is secured, and its scene."""
    scene = read_scene(fleet.file, fleet.environment(name))
    identity = {"process_id": name, "scene": scene.scene} if role == "observer" else {}
    with Link.open(scene.mesh, role, **identity) as link:
        yield link, scene


def captured(fleet, witness):
    """What the observers publish in CAPTURED_S: (ns since the first, name, message)."""
    with linked(fleet, "hub", "hub") as (link, scene):
        inbox, begun_ns = link.inbox(scene.keys.posterior(), limit=100_000), time.time_ns()
        witness.wait_for(lambda w: w.last["at_ns"] > begun_ns + CAPTURED_S * SECOND_NS, why="movements are captured")
        arrivals = inbox.take(0.0)
    first_ns = arrivals[0].arrived_ns
    return [
        (each.arrived_ns - first_ns, observer_of(each.key), decode(PosteriorMessage, each.payload)) for each in arrivals
    ]


def of_an_hour_ago(message, mark):
    """The bytes as they would have been captured an hour ago."""
    stamps = {"captured_ns": message.captured_ns - HOUR_NS, "sent_ns": message.sent_ns - HOUR_NS}
    session = (message.session or "") + mark
    return encode(message.with_fields(**stamps, session=session))


def play(fleet, messages, mark, stop):
    """Send them at the pace at which they came, again and again until `stop` is set."""
    payloads = [(due_ns, name, of_an_hour_ago(message, mark)) for due_ns, name, message in messages]
    with linked(fleet, "observer", THIEF) as (link, scene):
        publishers = {name: link.publisher(scene.keys.posterior(name)) for name in VIEWS}
        while not stop.is_set():
            begun_ns = time.time_ns()
            for due_ns, name, payload in payloads:
                if stop.wait(max(0.0, (begun_ns + due_ns - time.time_ns()) / SECOND_NS)):
                    return
                publishers[name].put(payload)


@contextmanager
def played(*how):
    stop = threading.Event()
    playing = threading.Thread(target=play, args=(*how, stop), daemon=True)
    playing.start()
    try:
        yield
    finally:
        stop.set()
        playing.join(10.0)


@pytest.mark.parametrize("mark", CASES.values(), ids=CASES)
@pytest.mark.parametrize("mesh", ["plain", "secured"])
def test_captured_posteriors_that_are_played_again_count_nothing(
    mesh, mark, tmp_path, tmp_path_factory, long_form, history
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    replay = Replay(tmp_path_factory)
    with Fleet(replay, tmp_path, secured=mesh == "secured") as fleet:
        fleet.play()
        witness = fleet.witness()
        witness.wait_for(all_count, why="all count")
        messages = captured(fleet, witness)
        since_ns = witness.last["at_ns"]
        with played(fleet, messages, mark):
            witness.wait_for(lambda w: w.last["at_ns"] > since_ns + 12 * SECOND_NS, why="movements meanwhile")
            performed = [one for one in settle(fleet, witness) if one.began_ns > since_ns]
            result = aftermath(performed, witness.judgements, witness.verdicts)
            history.note("beside the observers", result=str(result), detail=vars(result))
            assert performed and result.harmless and not result.unheard, f"{vars(result)}\n{fleet.logs()}"
            assert {one["agreement"]["n"] for one in witness.judgements if one["at_ns"] > since_ns} == {len(VIEWS)}
            for name in VIEWS:
                fleet.processes[name].kill()
            witness.wait_for(lambda w: w.last["agreement"]["n"] == 0, why="nobody counts")
            alone_ns = witness.last["at_ns"]
            witness.wait_for(lambda w: w.last["at_ns"] > alone_ns + CAPTURED_S * SECOND_NS, why="they are played")
            alone = [one for one in witness.judgements if one["at_ns"] > alone_ns]
            history.note("alone", votes=alone[-1]["votes"])
            assert {one["agreement"]["n"] for one in alone} == {0}
            assert not [v for v in witness.verdicts if v["began_ns"] > alone_ns]
            for name in VIEWS:
                fleet.start(name)
            witness.wait_for(all_count, why="the observers are back, and count")
        print(f"{mesh}: {len(messages)} posteriors; {result}")
