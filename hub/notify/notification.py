"""What is told of a verdict or a fall, and the request that tells it, in a form that its receiver understands. Pure."""

import hashlib
import hmac
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from common.config_hub import NotifyConfig, Preset
from common.fall_messages import FallMessage
from common.message_types import printable
from common.messages import VerdictMessage
from common.vocabulary import ABSTAIN
from hub.anticipation import probability
from hub.wording import clock_time, fall_words, moment, of_person

EVERY = "*"
FALLEN, UP_AGAIN, TEST = "fallen", "up_again", "test"
URGENT, USUAL = 5, 3
"""Priorities of ntfy; Gotify has twice as many."""
SIGNATURE, TIMESTAMP, ID = "X-Labanmesh-Signature", "X-Labanmesh-Timestamp", "X-Labanmesh-Id"


@dataclass(frozen=True, slots=True)
class Notification:
    """label: by which it waits for the cooldown. what, sure: in words. p: 0 to 1, None if it says nothing. key: the
    same notification has the same key, also after a restart. after: the key of one without which this says nothing."""

    scene: str
    kind: str
    label: str
    key: str
    what: str
    at_ns: int
    p: float | None
    sure: str
    is_urgent: bool = False
    after: str = ""

    @property
    def title(self) -> str:
        """One line above the text."""
        return f"{self.scene}: {self.what}"


@dataclass(frozen=True, slots=True)
class WebhookRequest:
    """A POST: its headers and its body."""

    headers: Mapping[str, str]
    body: bytes


def notification_of(message: VerdictMessage | FallMessage, config: NotifyConfig) -> Notification | None:
    """What is told of a message; None for one that nobody asked for."""
    if isinstance(message, FallMessage):
        return _of_fall(message) if config.falls else None
    is_wanted = EVERY in config.labels or message.label in config.labels
    if not is_wanted or message.label == ABSTAIN:
        return None
    p, agreement = probability(message), message.agreement
    what = of_person(message) + message.label.replace("_", " ")
    if message.revises is not None and message.stage == "revised":
        what += f", not {message.revises.replace('_', ' ')}"
    sure = f"{p:.0%} sure, {agreement.k} of {agreement.n} agree"
    key = f"{message.id} {message.label}"
    return Notification(message.scene, "verdict", message.label, key, printable(what), message.began_ns, p, sure)


def _of_fall(fall: FallMessage) -> Notification | None:
    if fall.id is None or fall.stage not in ("fallen", "up"):
        return None
    if fall.stage == "up":
        key, alarm = f"{fall.id} up", f"{fall.id} fallen"
        up = f"{of_person(fall)}up again"
        return Notification(fall.scene, "fall", UP_AGAIN, key, printable(up), fall.since_ns, None, "", after=alarm)
    agreement = fall.agreement
    sure = f"{agreement.k} of {agreement.n} see the person lie" if agreement.n else "nobody sees the person now"
    sure = sure if fall.lying is None else f"{fall.lying:.0%} sure, {sure}"
    key = f"{fall.id} fallen"
    return Notification(
        fall.scene, "fall", FALLEN, key, printable(fall_words(fall)), fall.since_ns, fall.lying, sure, is_urgent=True
    )


def test_notification(scene: str, now_ns: int) -> Notification:
    """What `labanmesh notify --test` sends."""
    return Notification(scene, "test", TEST, f"test {now_ns}", "a test of labanmesh", now_ns, 1.0, "100% sure")


def request_of(notification: Notification, config: NotifyConfig, token: str = "") -> WebhookRequest:
    """The request; the signature is added when it is sent."""
    headers, body = PRESET_FORMS[config.preset](notification, config, token)
    if token and config.preset in ("json", "ntfy"):
        headers["Authorization"] = f"Bearer {token}"
    headers = {"User-Agent": "labanmesh", ID: notification.key, **headers}
    # Headers are ASCII, and an id is what a peer has sent.
    return WebhookRequest({name: text.encode("ascii", "replace").decode() for name, text in headers.items()}, body)


def signed(request: WebhookRequest, secret: str, now_s: int) -> WebhookRequest:
    """The request with the time and the HMAC-SHA256 of `TIME.BODY`, by which a receiver knows who sends it."""
    if not secret:
        return request
    content = str(now_s).encode() + b"." + request.body
    mark = "sha256=" + hmac.new(secret.encode(), content, hashlib.sha256).hexdigest()
    return WebhookRequest({**request.headers, TIMESTAMP: str(now_s), SIGNATURE: mark}, request.body)


def text_of(notification: Notification, config: NotifyConfig) -> str:
    """The text, by the template; without a trailing comma where nothing is known about how sure it is."""
    fields = {
        "what": notification.what,
        "when": clock_time(notification.at_ns),
        "sure": notification.sure,
        "scene": notification.scene,
        "label": notification.label,
        "link": config.page,
    }
    return config.template.format_map(fields).strip().rstrip(",")


Form = tuple[dict[str, str], bytes]


def _json(content: Mapping[str, Any]) -> Form:
    return {"Content-Type": "application/json"}, json.dumps(content, ensure_ascii=False).encode()


def _plain(notification: Notification, config: NotifyConfig, token: str) -> Form:
    fields = asdict(notification)
    del fields["at_ns"], fields["key"], fields["is_urgent"], fields["after"]
    when = moment(notification.at_ns)
    more = {"id": notification.key, "when": when, "link": config.page, "text": text_of(notification, config)}
    return _json({**fields, **more})


def _ntfy(notification: Notification, config: NotifyConfig, token: str) -> Form:
    headers = {"Content-Type": "text/plain; charset=utf-8", "Title": notification.title}
    headers["Priority"] = str(URGENT if notification.is_urgent else USUAL)
    headers["Tags"] = "rotating_light" if notification.is_urgent else "martial_arts_uniform"
    if config.page:
        headers["Click"] = config.page
    return headers, text_of(notification, config).encode()


def _gotify(notification: Notification, config: NotifyConfig, token: str) -> Form:
    content: dict[str, Any] = {"title": notification.title, "message": text_of(notification, config)}
    content["priority"] = 2 * (URGENT if notification.is_urgent else USUAL)
    if config.page:
        content["extras"] = {"client::notification": {"click": {"url": config.page}}}
    headers, body = _json(content)
    return headers | ({"X-Gotify-Key": token} if token else {}), body


def _slack(notification: Notification, config: NotifyConfig, token: str) -> Form:
    link = f"\n<{config.page}|Open the page>" if config.page else ""
    return _json({"text": f"*{notification.title}*\n{text_of(notification, config)}{link}"})


def _discord(notification: Notification, config: NotifyConfig, token: str) -> Form:
    link = f"\n{config.page}" if config.page else ""
    content = f"**{notification.title}**\n{text_of(notification, config)}{link}"
    return _json({"username": "labanmesh", "content": content, "allowed_mentions": {"parse": []}})


PRESET_FORMS: Mapping[Preset, Callable[[Notification, NotifyConfig, str], Form]] = {
    "json": _plain,
    "ntfy": _ntfy,
    "gotify": _gotify,
    "slack": _slack,
    "discord": _discord,
}
