"""The dashboard's web application: the page that shows a scene, its event stream, pictures, and the token form.

Who may read and who may teach is decided in hub/dashboard/access.py; hub/dashboard/teach_routes.py is the Teach page.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from urllib.parse import parse_qs

from sse_starlette import EventSourceResponse
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from hub.dashboard.access import (
    COOKIE,
    COOKIE_S,
    NO_STORE,
    WRONG_TOKEN_S,
    AccessControl,
    AccessMiddleware,
    address_of,
    body_of,
    static_page,
    token_form,
    too_many_guesses,
)
from hub.dashboard.pictures import PictureAnswer, PictureState
from hub.dashboard.streams import Playhead
from hub.dashboard.teach_routes import TeachPage

PING_S = 10
"""How often an idle stream shows that it is alive; the page reconnects after three times this."""
FORM_LIMIT = 2048
MAX_AT_S = 1e9
MAX_SPEED = 64.0
MODULES = ("page", "verdicts", "people", "judges", "counter", "charts", "phones", "words", "elements")
SCRIPTS = tuple(f"{name}.js" for name in MODULES)
STATIC = {"/": "page.html", **{f"/{name}": name for name in ("style.css", "icon.svg", *SCRIPTS)}}
NO_PICTURE: Mapping[PictureState, tuple[int, str]] = {
    "none yet": (204, ""),
    "switched off": (404, "No pictures of this judge: set picture_hz in its section of the scene file.\n"),
    "no right": (403, "This dashboard's certificate has no right to pictures: labanmesh secure add ... --pictures.\n"),
}
"""The answer where there is no picture to show: status and reason."""
Stream = Callable[[Playhead], AsyncIterator[bytes]]
Newest = Callable[[str], PictureAnswer]
"""The newest live picture of an observer."""
Answer = Callable[[Request], Awaitable[Response]]


def application(
    access: AccessControl,
    stream: Stream,
    is_full: Callable[[], bool],
    newest_picture: Newest | None = None,
    teach: TeachPage | None = None,
    more: Sequence[Route] = (),
) -> Starlette:
    """The application. stream: yields the events of one browser. is_full: whether there are too many browsers.

    newest_picture: of a live scene; a capture has no pictures. teach: the Teach page; by default it is off. more:
    the routes of the day page and of phones.
    """
    routes = [static_page(path, name) for path, name in STATIC.items()]
    routes += [
        Route("/events", _events(stream, is_full)),
        Route("/enter", _enter(access), methods=["POST"]),
        Route("/picture/{observer}", _picture(newest_picture)),
        *(teach or TeachPage(access)).routes,
        *more,
    ]
    return Starlette(routes=routes, middleware=[Middleware(AccessMiddleware, access)])


def _events(stream: Stream, is_full: Callable[[], bool]) -> Answer:
    async def events(request: Request) -> Response:
        if is_full():
            return PlainTextResponse("Too many browsers are connected. Try again later.", 503, {"retry-after": "5"})
        query = request.query_params
        try:
            head = Playhead(_number(query, "at", 0.0, MAX_AT_S), _number(query, "speed", 1.0, MAX_SPEED))
        except ValueError as error:
            return PlainTextResponse(f"{error}\n", 400)
        return EventSourceResponse(stream(head), ping=PING_S, sep="\n")

    return events


def _enter(access: AccessControl) -> Answer:
    async def enter(request: Request) -> Response:
        address = address_of(request)
        if wait_s := access.wait_s(address):
            return too_many_guesses(wait_s)
        try:
            body = await body_of(request, FORM_LIMIT)
        except TimeoutError:
            return PlainTextResponse("Too slow.", 408)
        if len(body) > FORM_LIMIT:
            return PlainTextResponse("Too long.", 413)
        word = parse_qs(body.decode("latin-1")).get("token", [""])[0]
        if not access.is_token(word):
            access.record_wrong(address, word)
            await asyncio.sleep(WRONG_TOKEN_S)
            return HTMLResponse(token_form("That is not the token."), 401)
        answer = RedirectResponse("./", 303)
        answer.set_cookie(COOKIE, access.cookie, COOKIE_S, httponly=True, samesite="strict")
        return answer

    return enter


def _picture(newest_picture: Newest | None) -> Callable[[Request], Response]:
    def picture(request: Request) -> Response:
        answer = newest_picture(request.path_params["observer"]) if newest_picture else PictureAnswer("switched off")
        name = str(answer.captured_ns)
        headers = {"cache-control": NO_STORE, "x-picture": name}
        if answer.state != "picture":
            status, reason = NO_PICTURE[answer.state]
            return PlainTextResponse(reason, status, headers)
        if request.query_params.get("after") == name:
            return Response(status_code=204, headers=headers)
        return Response(answer.jpeg, media_type="image/jpeg", headers=headers)

    return picture


def _number(query: Mapping[str, str], name: str, default: float, most: float) -> float:
    text = query.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= most:
        raise ValueError(f"{name} = {text[:40]!r}: must be a number from 0 to {most:g}")
    return value
