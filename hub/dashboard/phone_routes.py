"""The codes of `labanmesh phone` on the page (docs/guide/phone.md#on-the-page).

1. The server of phones is a process of its own on this machine, and makes all codes. It names the port of its page with
   the codes, which is on the loopback interface, in the register of phones.
2. Whoever has a code becomes an observer's camera. So where the page has a token, the cookie, which only reads, is not
   enough: as teaching, it needs the token in the header Authorization, or the key made from it.
3. Without a token only this machine reaches the page, and everybody there can read the codes already.
"""

import http.client

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from common.config import Scene
from common.errors import BadInput, LabanmeshError
from common.tracker_choice import PHONE
from hub.dashboard.access import NO_STORE, AccessControl
from hub.dashboard.teach_routes import for_teachers
from hub.phone.register import CODES_PATH, ShownPhone, read_shown_phones
from hub.phone.register_file import RegisterFile, register_path

ANSWER_S = 3.0
"""How long the server of phones may take; it is on this machine."""
ANSWER_LIMIT = 2**20
"""Bytes; the largest QR code has 31 kB, as it is sent."""
NO_SERVER = "labanmesh phone does not run on the machine of this page"


def phone_routes(scene: Scene, access: AccessControl) -> list[Route]:
    """The routes; none for a scene in which no observer sees through a phone."""
    if not any(each.source == PHONE for each in scene.observers.values()):
        return []
    file = RegisterFile(register_path(scene))

    async def phones(request: Request) -> Response:
        shown = await run_in_threadpool(ask_for_phones, file)
        return JSONResponse([each.model_dump() for each in shown], headers={"cache-control": NO_STORE})

    return [Route("/phones", for_teachers(access, phones, 503))]


def ask_for_phones(file: RegisterFile) -> tuple[ShownPhone, ...]:
    """What the server of phones shows now; raises LabanmeshError, one line, where none runs."""
    port = file.register.page_port
    if port is None:
        raise LabanmeshError(NO_SERVER)
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_S)
    try:
        connection.request("GET", CODES_PATH)
        answer = connection.getresponse()
        body = answer.read(ANSWER_LIMIT)
    except (OSError, http.client.HTTPException):
        raise LabanmeshError(NO_SERVER) from None
    finally:
        connection.close()
    if answer.status != http.client.OK:
        raise BadInput("what answers there is not labanmesh phone")
    return read_shown_phones(body)
