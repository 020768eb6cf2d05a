"""What the server of phones says about each observer's phone to a program on this machine, as JSON. Pure."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from common.errors import BadInput
from common.message_types import Identifier, ShortText

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


def shown_phones_json(phones: tuple[ShownPhone, ...]) -> bytes:
    """The phones as JSON, which `read_shown_phones` reads."""
    return SHOWN_PHONES.dump_json(phones)


def read_shown_phones(body: bytes) -> tuple[ShownPhone, ...]:
    """Reads what `shown_phones_json` wrote; raises BadInput for anything else."""
    try:
        return SHOWN_PHONES.validate_json(body)
    except ValidationError:
        raise BadInput("what answers there is not labanmesh phone") from None
