"""What a phone may send over its WebSocket, one JSON object a message, each with one key. Pure.

    {"join": {"code": "...", "name": "Android, Chrome"}}     first of all: with the code, or with the secret
    {"resume": {"secret": "..."}}
    {"clock": {"number": 3, "now_ms": 1700000000000.25}}      the answer to {"clock": 3}
    {"tracks": {"at_ms": ..., "parts": {"left_hand": [412.1, 300, 0.9], "head": null}}}
    {"camera": {"state": "running", "hz": 14.2}}
    {"lesson": {"ask": "press", "lesson": "5b1c", "number": 3, "action": "go"}}   to be taught from the phone

Nothing else is taken, and nothing else leaves the phone.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from common.message_types import ShortText, printable

MESSAGE_LIMIT = 4096
"""Bytes of a message: the tracks of a whole body have 700."""
PHONE_PARTS_LIMIT = 64
"""Of a pose model's 33 landmarks 15 parts are made."""
LARGEST_PX = 100_000.0
"""No picture of a phone is that wide, and no part lies further outside."""
LAST_MS = 4_102_444_800_000.0
"""The year 2100."""


class BadPhoneMessage(Exception):  # noqa: N818 - it names the message
    """Why a message is refused; one line."""


class _PhonePart(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


Milliseconds = Annotated[FiniteFloat, Field(ge=0, le=LAST_MS)]
Pixel = Annotated[FiniteFloat, Field(ge=-LARGEST_PX, le=LARGEST_PX)]
Confidence = Annotated[FiniteFloat, Field(ge=0, le=1)]
Place = Annotated[tuple[Pixel, Pixel, Confidence], Field(strict=False)]
PartName = Annotated[str, Field(pattern=r"^[a-z_]{1,32}$")]
Word = Annotated[str, Field(min_length=1, max_length=128)]


class Join(_PhonePart):
    """The first message of a phone: the code that it has scanned."""

    code: Word
    name: ShortText = ""


class Resume(_PhonePart):
    """The first message of a phone that comes back: the secret that it got before."""

    secret: Word


class ClockAnswer(_PhonePart):
    """What the phone's clock showed (ms since 1970) when it got question `number`."""

    number: Annotated[int, Field(ge=0, le=2**53)]
    now_ms: Milliseconds


class PhoneTracks(_PhonePart):
    """Body parts in px of the picture, u to the right and v down, with a confidence; None: not seen.

    at_ms: when the picture was taken, by the phone's clock (ms since 1970).
    """

    at_ms: Milliseconds
    parts: Annotated[dict[PartName, Place | None], Field(min_length=1, max_length=PHONE_PARTS_LIMIT)]


class CameraState(_PhonePart):
    """How the phone is doing. hz: pictures looked at each second. reason: one line, if it does not run."""

    state: Literal["running", "idle", "hidden", "failed"]
    hz: Annotated[FiniteFloat, Field(ge=0, le=1000)] = 0.0
    reason: ShortText = ""


class LessonRequest(_PhonePart):
    """What somebody asks of the lesson on the phone's page (hub/phone/running.py).

    look: show how it stands. start: begin one by `plan`. press: `action` (on take `take`) at step `number` of the
    lesson with id `lesson`. stop: end that lesson. plan and action are read as those of the Teach page.
    """

    ask: Literal["look", "start", "press", "stop"]
    plan: dict[str, object] = Field(default_factory=dict)
    lesson: ShortText = ""
    number: int = -1
    action: ShortText = ""
    take: int = 0


PhoneContent = Join | Resume | ClockAnswer | PhoneTracks | CameraState | LessonRequest


class PhoneMessage(_PhonePart):
    """One message: exactly one of these."""

    join: Join | None = None
    resume: Resume | None = None
    clock: ClockAnswer | None = None
    tracks: PhoneTracks | None = None
    camera: CameraState | None = None
    lesson: LessonRequest | None = None

    @model_validator(mode="after")
    def _is_one(self) -> "PhoneMessage":
        if len(self.model_fields_set) != 1 or self.content is None:
            raise ValueError("exactly one of join, resume, clock, tracks, camera and lesson is expected")
        return self

    @property
    def content(self) -> PhoneContent | None:
        """The one part that is set."""
        return self.join or self.resume or self.clock or self.tracks or self.camera or self.lesson


def read_message(text: str | bytes) -> PhoneContent:
    """The content of a message; raises BadPhoneMessage, one line, for anything else."""
    if not isinstance(text, str):
        raise BadPhoneMessage("a text is expected, not bytes")
    if len(text) > MESSAGE_LIMIT:
        raise BadPhoneMessage(f"{len(text)} characters in one message; at most {MESSAGE_LIMIT} are read")
    try:
        content = PhoneMessage.model_validate_json(text).content
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))[:80]
        # A key of a stranger's making may hold any character.
        raise BadPhoneMessage(printable(": ".join(filter(None, [where, first["msg"].lower()])))) from None
    assert content is not None  # noqa: S101 - the validator has checked it
    return content
