"""What is told, in which form, and what arrives at a real HTTP server that fails, is slow, comes back."""

import gc
import hashlib
import hmac
import json
import time
import tracemalloc

import pytest
from played_scene import fall_of
from processes import SOON_S, until, within
from webhook_server import WebhookServer

from common import SECOND_NS
from common.backoff import Backoff
from common.config import read_scene
from common.config_hub import NotifyConfig
from common.errors import BadInput
from hub.database import DatabaseFault
from hub.notify.notification import notification_of, request_of, signed, text_of
from hub.notify.notifying import Notifying
from hub.notify.sender import SENDING, NotificationQueue
from labanmesh import main

NOON = 1_700_000_000 * SECOND_NS
QUICK = Backoff(0.01, 0.05)


def config(**more):
    return NotifyConfig(**{"url": "http://127.0.0.1:9/hook", "labels": ("*",), "page": "http://house:8420/", **more})


def scene_with(tmp_path, url, more=""):
    path = tmp_path / "s.toml"
    path.write_text(
        f'scene = "room"\n[observers.cam1]\nsource = "a.npz"\n[notify.phone]\nurl = "{url}"\nlabels = ["*"]\n{more}'
    )
    return read_scene(path, {})


class Simulated:
    """Pauses as in the product, of a clock that each of them sets forward; the sender hardly waits."""

    def __init__(self):
        self.now_s, self.lengths_s = 0.0, []

    def wait_s(self, failures):
        pause_s = SENDING.wait_s(failures)
        self.lengths_s.append(pause_s)
        self.now_s += pause_s
        return 0.001

    def clock(self):
        return NOON + round(self.now_s * SECOND_NS)


class Told:
    """Verdicts that are told by the scene's receivers."""

    def __init__(self, tmp_path, url, more="cooldown_s = 0\ntimeout_s = 0.3\n"):
        self.scene = scene_with(tmp_path, url, more)
        self.notifying = self.started()

    def started(self):
        return Notifying(self.scene, time.monotonic, lambda: NOON, QUICK)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.notifying.close()

    def tell(self, make, *numbers):
        for number in numbers:
            began_ns = NOON + number * SECOND_NS
            self.notifying.take(make.verdict(number, label=f"m{number}", began_ns=began_ns), answered=False)


def test_a_notification_says_what_when_how_sure_and_a_link(make):
    note = notification_of(make.verdict(label="nthrow"), config())
    request = request_of(note, config())
    fields = json.loads(request.body)
    assert fields["what"] == "nthrow" and fields["sure"] == "60% sure, 1 of 2 agree" and fields["p"] == 0.6
    assert fields["link"] == "http://house:8420/" and fields["when"].startswith("2023-11-14T22:13:19")
    assert fields["text"].startswith("nthrow at ")
    alarm = notification_of(fall_of(), config())
    assert alarm.is_urgent and alarm.sure == "93% sure, 2 of 3 see the person lie"
    up = notification_of(fall_of("up"), config())
    assert up.what == "up again" and "," not in text_of(up, config())
    assert notification_of(fall_of("low"), config()) is None and notification_of(fall_of(), config(falls=False)) is None
    assert notification_of(make.verdict(label="abstain"), config()) is None
    assert notification_of(make.verdict(label="wave"), config(labels=("clap",))) is None


@pytest.mark.parametrize(
    ("preset", "field", "text"),
    [("gotify", "message", "somebody has fallen at"), ("slack", "text", "<http://house:8420/|Open the page>"),
     ("discord", "content", "**room: somebody has fallen**"), ("json", "kind", "fall")],
)  # fmt: skip
def test_presets_have_the_form_of_their_receivers(preset, field, text):
    chosen = config(preset=preset)
    request = request_of(notification_of(fall_of(), chosen), chosen, "app-token")
    assert text in json.loads(request.body)[field] and request.headers["Content-Type"] == "application/json"
    assert ("X-Gotify-Key" in request.headers) == (preset == "gotify")


def test_ntfy_gets_text_and_headers():
    chosen = config(preset="ntfy", template="{what}! {sure} {link}")
    request = request_of(notification_of(fall_of(), chosen), chosen, "tk_secret")
    assert request.body.decode() == "somebody has fallen! 93% sure, 2 of 3 see the person lie http://house:8420/"
    assert request.headers["Priority"] == "5" and request.headers["Click"] == "http://house:8420/"
    assert request.headers["Authorization"] == "Bearer tk_secret" and request.headers["Title"].startswith("room: ")


def test_the_signature_is_that_of_time_and_body(make):
    request = signed(request_of(notification_of(make.verdict(), config()), config()), "key", 1_700_000_000)
    expected = hmac.new(b"key", b"1700000000." + request.body, hashlib.sha256).hexdigest()
    assert request.headers["X-Labanmesh-Signature"] == f"sha256={expected}"
    assert request.headers["X-Labanmesh-Timestamp"] == "1700000000"


@pytest.mark.parametrize("template", ["{what.__class__}", "{0}", "{nobody}", "{", "{what!r:{sure}}}"])
def test_a_template_holds_the_known_fields_alone(template):
    with pytest.raises(ValueError, match=r"template|braces"):
        config(template=template)


@pytest.mark.parametrize("line", ['url = "ftp://host/x"', "", 'url = "http://a/b"\nurl_file = "f"', 'preset = "sms"'])
def test_bad_settings_are_one_line(tmp_path, line):
    (tmp_path / "s.toml").write_text(f'scene = "room"\n[observers.cam1]\nsource = "a.npz"\n[notify.phone]\n{line}\n')
    with pytest.raises(BadInput) as caught:
        read_scene(tmp_path / "s.toml", {})
    assert "notify" in str(caught.value) and "\n" not in str(caught.value)


def test_after_an_hour_of_failures_all_arrives_once_in_order_and_memory_is_flat(make, tmp_path, caplog):
    pauses = Simulated()

    def answer(number, handler):
        if pauses.now_s < 3600:
            return 503
        server.ended.wait(0.1 if len(server.accepted) < 3 else 0)
        return 200

    with WebhookServer(answer) as server:
        scene = scene_with(tmp_path, server.url, "cooldown_s = 0\n")
        notifying = Notifying(scene, time.monotonic, pauses.clock, pauses)
        try:
            told = 0
            gc.collect()
            tracemalloc.start()
            # A movement every minute of the hour.
            while told < 60:
                until(lambda told=told: pauses.now_s >= 60 * told)
                verdict = make.verdict(told, label=f"m{told}", began_ns=pauses.clock(), at_ns=pauses.clock())
                notifying.take(verdict, answered=False)
                told += 1
            grown, _ = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            until(lambda: len(server.accepted) >= 60)
        finally:
            notifying.close()
    assert server.texts == [f"m{number}" for number in range(60)]
    assert "answers 503" in caplog.text and "works again" in caplog.text
    assert pauses.lengths_s[:9] == [1, 2, 4, 8, 16, 32, 64, 128, 256] and set(pauses.lengths_s[9:]) == {300}
    assert len(pauses.lengths_s) < 25 and grown < 1_000_000


def test_what_waits_outlives_a_restart_and_nothing_is_told_twice(make, tmp_path):
    with WebhookServer(lambda number, handler: 500) as server, Told(tmp_path, server.url) as told:
        told.tell(make, 0, 1, 2)
        until(lambda: server.requests)
        told.notifying.close()
        server.answer = lambda number, handler: 200
        told.notifying = told.started()
        told.tell(make, 2, 3)
        until(lambda: len(server.accepted) == 4)
        assert server.texts == ["m0", "m1", "m2", "m3"]


def test_a_label_cools_down_and_both_words_on_a_movement_are_one(make, tmp_path):
    with WebhookServer() as server, Told(tmp_path, server.url, "cooldown_s = 60\n") as told:
        for second in (0, 30, 59, 61, 200):
            verdict = make.verdict(second, label="wave", began_ns=NOON + second * SECOND_NS)
            told.notifying.take(verdict, answered=False)
            told.notifying.take(verdict.model_copy(update={"ended_ns": NOON, "stage": "ended"}), answered=False)
        told.notifying.take(fall_of(), answered=False)
        until(lambda: len(server.accepted) == 4)
        assert server.texts == ["wave", "wave", "wave", "somebody has fallen"]


def test_up_again_is_told_only_after_the_alarm(make, tmp_path):
    with WebhookServer() as server, Told(tmp_path, server.url) as told:
        for message in (
            fall_of("up", 1),
            fall_of("fallen", 2),
            fall_of("fallen", 2),
            fall_of("up", 2),
            fall_of("up", 2),
        ):
            told.notifying.take(message, answered=False)
        told.tell(make, 1)
        until(lambda: len(server.accepted) == 3)
        assert server.texts == ["somebody has fallen", "up again", "m1"]


def hang(number, handler):
    handler.server.timeout = None
    SERVERS[-1].ended.wait(SOON_S)


def drip(number, handler):
    handler.wfile.write(b"HTTP/1.1 200 OK\r\n")
    while not SERVERS[-1].ended.wait(0.05):
        handler.wfile.write(b"X-A: b\r\n")
        handler.wfile.flush()


def redirect(number, handler):
    handler.send_response(302)
    handler.send_header("Location", "http://elsewhere/\x1b[31m")
    handler.end_headers()


def endless(status):
    def answer(number, handler):
        handler.send_response(status)
        handler.send_header("Content-Length", str(10 * 2**30))
        handler.end_headers()
        while True:
            handler.wfile.write(bytes(1 << 16))

    return answer


def nonsense(number, handler):
    handler.wfile.write(b"\x00\xff no HTTP\r\n\r\n")


SERVERS = []


@pytest.mark.parametrize(
    ("answer", "line"),
    [
        (hang, "no answer within 0.3 s"),
        (drip, "no answer within 0.3 s"),
        (redirect, "redirects to http://elsewhere/"),
        (endless(500), "answers 500"),
        (nonsense, ""),
        (lambda number, handler: 404, "answers 404"),
    ],
    ids=["hang", "drip", "redirect", "10 GB of error", "nonsense", "404"],
)
def test_trouble_is_one_line_and_what_is_due_waits(make, tmp_path, caplog, answer, line):
    with WebhookServer(answer) as server, Told(tmp_path, server.url) as told:
        SERVERS.append(server)
        with within(0.3):  # nothing waits for the server
            told.tell(make, 1, 2)
        until(lambda: len(server.requests) >= 3)
        lines = [record.message for record in caplog.records if "notify.phone" in record.message]
        assert len(lines) == 1 and line in lines[0] and lines[0].isprintable()
        server.answer = lambda number, handler: 200
        until(lambda: len(server.accepted) == 2)


def test_an_answer_of_10_gb_is_an_answer(make, tmp_path):
    with WebhookServer(endless(200)) as server, Told(tmp_path, server.url) as told:
        told.tell(make, 1, 2, 3)
        until(lambda: len(server.requests) == 3)


def refuse_first(number, handler):
    return 400 if number == 1 else 200


def test_a_request_that_is_refused_for_good_does_not_hold_up_the_others(make, tmp_path, caplog):
    with WebhookServer(refuse_first) as server, Told(tmp_path, server.url) as told:
        told.tell(make, 1, 2)
        until(lambda: server.texts == ["m2"])
    assert caplog.text.count("refused for good: answers 400") == 1


def test_a_server_that_is_not_there_is_one_line(make, tmp_path, caplog):
    with Told(tmp_path, "http://127.0.0.1:9/hook") as told:
        told.tell(make, 1)
        until(lambda: "connection refused" in caplog.text)


def test_the_queue_is_bounded_and_memory_stays_flat(make, tmp_path, caplog):
    with Told(tmp_path, "http://127.0.0.1:9/hook", "cooldown_s = 0\nkeep = 20\n") as told:
        told.tell(make, *range(100))
        gc.collect()
        tracemalloc.start()
        told.tell(make, *range(100, 600))
        gc.collect()
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert grown < 1_000_000
        assert "the queue is full" in caplog.text
    queue = NotificationQueue(tmp_path / "room.notify.db")
    assert queue.count("phone") == 20 and queue.oldest("phone").request.headers["X-Labanmesh-Id"] == "v580 m580"
    queue.close()


def test_what_is_too_old_is_given_up(make, tmp_path, caplog):
    scene = scene_with(tmp_path, "http://127.0.0.1:9/hook", "keep_hours = 0.01\n")
    now_ns = [NOON]
    notifying = Notifying(scene, time.monotonic, lambda: now_ns[0], QUICK)
    try:
        notifying.take(make.verdict(1), answered=False)
        until(lambda: "tried again" in caplog.text)
        now_ns[0] += 60 * SECOND_NS
        until(lambda: "given up after 0.01 h" in caplog.text)
    finally:
        notifying.close()


def test_a_queue_of_a_newer_version_is_one_line(make, tmp_path, caplog):
    path = tmp_path / "room.notify.db"
    queue = NotificationQueue(path)
    queue._connection.execute("PRAGMA user_version = 9")
    queue.close()
    with pytest.raises(DatabaseFault, match="version 9"):
        NotificationQueue(path)
    with Told(tmp_path, "http://127.0.0.1:9/hook") as told:
        told.tell(make, 1, 2)
    assert caplog.text.count("newer labanmesh") == 1


def test_an_answer_from_long_ago_is_not_told(make, tmp_path):
    with WebhookServer() as server, Told(tmp_path, server.url) as told:
        told.notifying.take(make.verdict(1, label="old", at_ns=NOON - 3600 * SECOND_NS), answered=True)
        told.notifying.take(make.verdict(2, label="new", at_ns=NOON - SECOND_NS), answered=True)
        until(lambda: server.texts == ["new"])


def test_the_command_sends_a_test_and_says_what_is_wrong(tmp_path, capsys):
    (tmp_path / "token").write_text("tk_1\n")
    (tmp_path / "secret").write_text("key\n")
    with WebhookServer() as server:
        scene_with(tmp_path, server.url, 'token_file = "token"\nsecret_file = "secret"\n')
        path = str(tmp_path / "s.toml")
        assert main(["notify", path, "--test"]) == 0
        assert capsys.readouterr().out == "phone: accepted\n" and server.texts == ["a test of labanmesh"]
        headers = server.requests[0][1]
        assert headers["Authorization"] == "Bearer tk_1" and headers["X-Labanmesh-Signature"].startswith("sha256=")
        server.answer = lambda number, handler: 403
        assert main(["notify", path, "--test"]) == 1
        assert capsys.readouterr().out == "phone: answers 403 Forbidden: text\n"
        assert main(["notify", path]) == 0
        assert capsys.readouterr().out == "phone: json, 0 waiting\n"
        assert main(["notify", path, "other"]) == 2 and "known: phone" in capsys.readouterr().err
        (tmp_path / "token").unlink()
        assert main(["notify", path, "--test"]) == 2 and "notify.phone.token_file" in capsys.readouterr().err
