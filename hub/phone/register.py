"""Which phone is the camera of which observer: codes that work once, and the secrets that phones got for them. Pure.

1. A code names one observer, works once, and until it expires. Only its hash is kept, as of a secret.
2. A phone that shows a code becomes the observer's phone, and gets a secret by which it comes back. The phone before it
   is revoked, and the observer's other codes end: an observer has one camera.
3. What is revoked stays listed, and never works again.
"""

import hashlib
from datetime import datetime, timedelta
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from common.errors import BadInput
from common.message_types import Identifier, ShortText

CODE_LIFETIME = timedelta(minutes=15)
"""Long enough to fetch the phone and to install the authority's certificate."""
REVOKED_LIMIT = 32
"""Revoked phones that are still listed; older ones are forgotten, and are refused as unknown."""
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class RefusedError(Exception):
    """Why a phone is not admitted; one line for the person who holds it."""


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    observer: Identifier
    hash: Hash


class Code(_Entry):
    """A code that was shown. used: when a phone showed it; None: not yet."""

    expires: datetime
    used: datetime | None = None


class Phone(_Entry):
    """A phone. hash: of its secret. name: what its browser calls it. revoked: since when it is refused."""

    name: ShortText
    joined: datetime
    revoked: datetime | None = None


class PhoneRegister(BaseModel):
    """All codes and phones of a scene. page_port: of the page with the codes, on loopback, while it is served."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    codes: tuple[Code, ...] = ()
    phones: tuple[Phone, ...] = ()
    page_port: Annotated[int, Field(ge=1, le=65535)] | None = None

    def with_code(self, observer: str, code: str, now: datetime, beside: str = "") -> "PhoneRegister":
        """A new code for `observer`, which replaces those that nobody has used; used and expired ones are forgotten.

        beside: an older code that stays good until it expires, because somebody may have scanned it.
        """
        stays = {hash_of(beside)} | {each.hash for each in self.codes if each.used or each.observer != observer}
        kept = [each for each in self.codes if each.expires > now and each.hash in stays]
        new = Code(observer=observer, hash=hash_of(code), expires=now + CODE_LIFETIME)
        return self.model_copy(update={"codes": (*kept, new)})

    def join(self, code: str, secret: str, name: str, now: datetime) -> "tuple[PhoneRegister, Phone]":
        """The phone that shows `code` gets `secret`; raises RefusedError."""
        known = next((each for each in self.codes if each.hash == hash_of(code)), None)
        if known is None:
            raise RefusedError("this code is not known, or too old: show a new one with labanmesh phone")
        if known.used is not None:
            raise RefusedError("this code was used already: each phone needs a code of its own")
        if known.expires <= now:
            raise RefusedError("this code has expired: show a new one with labanmesh phone")
        phone = Phone(observer=known.observer, hash=hash_of(secret), name=name, joined=now)
        others = [each for each in self.codes if each.used or each.observer != known.observer]
        codes = (*others, known.model_copy(update={"used": now}))
        register = self._revoked(known.observer, now)
        return register.model_copy(update={"codes": codes, "phones": (*register.phones, phone)}), phone

    def resume(self, secret: str) -> Phone:
        """The phone with this secret; raises RefusedError."""
        phone = next((each for each in self.phones if each.hash == hash_of(secret)), None)
        if phone is None:
            raise RefusedError("this phone is not known here: show a code with labanmesh phone, and scan it")
        if phone.revoked is not None:
            raise RefusedError("this phone was revoked, or another one took its place: scan a new code")
        return phone

    def revoke(self, observer: str, now: datetime) -> "PhoneRegister":
        """Without phone and open code of `observer`; raises BadInput if it has none."""
        has_code = any(each.observer == observer and each.used is None and each.expires > now for each in self.codes)
        if self.phone_of(observer) is None and not has_code:
            known = ", ".join(each.observer for each in self.phones if each.revoked is None) or "none"
            raise BadInput(f"--revoke {observer}: no phone and no open code; observers with a phone: {known}")
        codes = tuple(each for each in self.codes if each.observer != observer or each.used is not None)
        return self._revoked(observer, now).model_copy(update={"codes": codes})

    def open_code(self, code: str, now: datetime) -> Code | None:
        """`code`, if a phone can use it at `now`."""
        known = next((each for each in self.codes if each.hash == hash_of(code)), None)
        return known if known is not None and known.used is None and known.expires > now else None

    def phone_of(self, observer: str) -> Phone | None:
        """The phone that is admitted for `observer`."""
        return next((each for each in self.phones if each.observer == observer and each.revoked is None), None)

    def _revoked(self, observer: str, now: datetime) -> "PhoneRegister":
        phones = [
            each.model_copy(update={"revoked": now}) if each.observer == observer and each.revoked is None else each
            for each in self.phones
        ]
        old = [each for each in phones if each.revoked is not None][:-REVOKED_LIMIT]
        return self.model_copy(update={"phones": tuple(each for each in phones if each not in old)})


def hash_of(word: str) -> str:
    """What is kept of a code or secret, which have 128 random bits or more: no salt is needed."""
    return hashlib.sha256(word.encode()).hexdigest()


def read_register(text: str, where: str) -> PhoneRegister:
    """The register in the text of a file; raises BadInput, one line, that names `where` it is."""
    try:
        return PhoneRegister.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise BadInput(
            f"{where}: {place}: {first['msg'].lower()}; remove the file, and let each phone scan a new code"
        ) from None


CODES_PATH = "/codes"
"""Where the page with the codes answers with this, to GET."""
LINK_LIMIT = 512
WIDEST_CODE = 177
"""Modules along a side of the largest QR code (ISO/IEC 18004, version 40)."""
Link = Annotated[str, Field(pattern=r"^https://[^\s\"'<>]+$", max_length=LINK_LIMIT)]
Modules = Annotated[str, Field(pattern=r"^[01]+$", max_length=WIDEST_CODE)]


class ShownPhone(BaseModel):
    """The code for an observer, or its phone.

    address: of the phones' page. link: that with the code; None while there is a phone. modules: the QR code of link,
    a row each, 1 is dark. expires: of the code, ms since 1970. phone: what its browser calls it; live: it is connected.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    observer: Identifier
    address: Link
    link: Link | None = None
    modules: Annotated[tuple[Modules, ...], Field(max_length=WIDEST_CODE)] = ()
    expires: Annotated[int, Field(ge=0, lt=2**53)] = 0
    phone: ShortText = ""
    live: bool = False


SHOWN_PHONES = TypeAdapter(tuple[ShownPhone, ...])


def read_shown_phones(body: bytes) -> tuple[ShownPhone, ...]:
    """Reads what the page with the codes answers; raises BadInput for anything else."""
    try:
        return SHOWN_PHONES.validate_json(body)
    except ValidationError:
        raise BadInput("what answers there is not labanmesh phone") from None
