"""`labanmesh hub events` on a mesh: verdicts and falls come into the file and to the receivers."""

import json
import time
from functools import partial

import pytest
from mesh_stage import LOOPBACK
from played_scene import REFERENCE, VOCABULARY
from processes import until
from webhook_server import WebhookServer

from common import SECOND_NS
from common.backoff import Backoff
from common.config import read_scene
from common.errors import BadInput
from common.fall_messages import FallMessage
from common.messages import Agreement, VerdictMessage, Vote
from common.wire import encode, encode_vocabulary
from hub.history.history_file import HistoryFile, HistoryQuery
from hub.history.service import require_something, serve


@pytest.fixture
def server():
    with WebhookServer() as opened:
        yield opened


@pytest.fixture
def scene(tmp_path, server):
    more = f'[history]\nfile = "h.db"\n[watch.fallen]\n[notify.phone]\nurl = "{server.url}"\nlabels = ["*"]\n'
    (tmp_path / "s.toml").write_text(f'scene = "room"\n{LOOPBACK}[observers.cam1]\nsource = "m.npz"\n{more}')
    return read_scene(tmp_path / "s.toml", {})


def verdict(number, label, **more):
    now_ns = time.time_ns()
    vote = Vote(label=label, entropy=0.5, weight=1.0, age_s=0.1, state="counted")
    p = [0.1] * VOCABULARY.size
    p[VOCABULARY.labels.index(label)] = 1.0 - 0.1 * (VOCABULARY.size - 1)
    return VerdictMessage(
        scene="room", fusion="fusion", seq=number, at_ns=now_ns, p=p, label=label, certainty_bits=0.5, rule="log",
        vocabulary=REFERENCE, votes={"cam1": vote}, agreement=Agreement(k=1, n=1), id=f"v{number}",
        began_ns=now_ns - SECOND_NS, decided_ns=now_ns, **more,
    )  # fmt: skip


def test_what_happens_is_kept_and_told(mesh, scene, server):
    path = scene.place("h.db")
    fusion = mesh.meeting
    fusion.answer(scene.keys.vocabulary, lambda: encode_vocabulary("room", VOCABULARY))
    _, thread = mesh.run(partial(serve, backoff=Backoff(0.01, 0.1)), scene, mesh.peer("hub"))
    verdicts, falls = fusion.publisher(scene.keys.verdict), fusion.publisher(scene.keys.fall)
    assert verdicts.wait_for_subscriber(20) and falls.wait_for_subscriber(20)
    label, other = VOCABULARY.labels[:2]
    verdicts.put(encode(verdict(1, label)))
    verdicts.put(encode(verdict(2, other)))
    common = {"scene": "room", "fusion": "fusion", "session": "s", "id": "fall-1", "since_ns": time.time_ns()}
    for stage in ("low", "fallen", "fallen", "up", "up"):
        falls.put(encode(FallMessage(**common, at_ns=time.time_ns(), stage=stage, lying=0.9)))
    until(lambda: len(server.accepted) == 4)
    assert sorted(server.texts) == sorted([label, other, "somebody has fallen", "up again"])
    assert all(json.loads(body)["scene"] == "room" for body in server.accepted)

    def kept():
        with HistoryFile.to_read(path) as file:
            return {row.id: row for row in file.select(HistoryQuery())}

    until(lambda: kept().keys() == {"v1", "v2", "fall-1"} and kept()["fall-1"].ended_ns)
    assert kept()["v1"].label == label and thread.is_alive()


def test_a_scene_that_asks_for_nothing_is_one_line(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "room"\n[observers.cam1]\nsource = "m.npz"\n')
    with pytest.raises(BadInput, match="nothing to do"):
        require_something(read_scene(tmp_path / "s.toml", {}))
