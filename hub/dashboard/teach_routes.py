"""The Teach page: its files, who may use it, and its requests (docs/guide/own-movements.md#on-the-phone).

1. The page itself says nothing about anybody, so that everybody who reaches the server gets it. Whatever it shows or
   does needs the token in the header Authorization, as `Bearer TOKEN`, or the key that a browser got for the token.
2. A foreign page cannot send that header; requests that a browser marks as coming from elsewhere are refused too.
3. Whatever changes something is a POST with JSON; its answer is 204, or one line that says why not.
4. The names of people are for everybody who looks, given by whoever may teach (access.py, rule 7).
"""

import asyncio
import json
import logging
import secrets
from collections.abc import Awaitable, Callable, Collection
from typing import Any
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from common.config import Scene
from common.errors import BadInput, LabanmeshError
from common.vocabulary import LABEL
from hub.dashboard.access import (
    COOKIE,
    COOKIE_S,
    NO_STORE,
    WRONG_TOKEN_S,
    AccessControl,
    address_of,
    body_of,
    static_file,
    static_page,
    too_many_guesses,
)
from hub.history.history_file import forget_in_history, note_corrections
from hub.home_assistant import home_assistant_advice
from hub.people_names_file import PeopleNames
from hub.teaching.lesson_data import action_of, corrections_of, lesson_server_data, plan_of, take_number, unwanted_of
from hub.teaching.lesson_server import LessonServer
from hub.teaching.wording import known_labels

log = logging.getLogger("labanmesh.hub")
TEACH_FILES = {f"/{name}": name for name in ("teach.js", "lesson.js", "figures.js", "teach.css", "lesson.css")}
BODY_LIMIT = 8192
LONG_POLL_S = 10.0
"""So long a request for the state waits for something new."""
LESSON_CHECK_S = 0.05
TEACHING_IS_OFF = "Teaching is off on this page. Start it with: labanmesh dashboard SCENE --teach"
Handle = Callable[[Request], Awaitable[Response]]


class TeachPage:
    """The routes of the page. lesson_server: None where nothing can be taught, `off` says why.

    hubs: the keys of liveliness tokens of MQTT hubs. file: the scene file, as it is written in a command.
    """

    def __init__(
        self,
        access: AccessControl,
        lesson_server: LessonServer | None = None,
        off: str = TEACHING_IS_OFF,
        scene: Scene | None = None,
        hubs: Callable[[], Collection[str]] = tuple,
        file: str = "",
    ) -> None:
        self._access, self._lesson_server, self._off, self._scene, self._hubs = access, lesson_server, off, scene, hubs
        self._ended, self._file = False, file

    @property
    def routes(self) -> list[Route]:
        """All routes; without a lesson server only the page, which says why."""
        html = static_file("teach.html").decode()
        routes = [static_page(path, name) for path, name in TEACH_FILES.items()]
        off = "" if self._lesson_server is not None else self._off.replace("&", "&amp;").replace("<", "&lt;")
        routes.append(static_page("/teach", "teach.html", html.replace("<!--off-->", off).encode()))
        if self._lesson_server is None:
            return routes
        acts = {"start": self._start, "press": self._press, "stop": self._stop}
        acts |= {"correct": self._correct, "forget": self._forget}
        routes += [Route(f"/teach/{name}", self._posted(act), methods=["POST"]) for name, act in acts.items()]
        routes += [
            Route("/teach/enter", self._admitted(self._enter), methods=["POST"]),
            Route("/teach/state", self._admitted(self._state)),
            Route("/teach/home", self._admitted(self._home)),
            Route("/teach/now/{observer}", self._admitted(self._now)),
            Route("/teach/take/{observer}/{label}/{number}", self._admitted(self._take)),
        ]
        return routes

    def end(self) -> None:
        """The server ends: requests that wait for something new are answered now."""
        self._ended = True

    def _admitted(self, handle: Handle) -> Handle:
        """Require the token in the header, and answer a BadInput with its one line."""

        async def answer(request: Request) -> Response:
            address, authorization = address_of(request), request.headers.get("authorization", "")
            if wait_s := self._access.wait_s(address):
                return too_many_guesses(wait_s)
            if not self._access.admits_teaching(authorization):
                self._access.record_wrong(address, authorization)
                await asyncio.sleep(WRONG_TOKEN_S if authorization else 0.0)
                return PlainTextResponse("The token is missing or wrong.\n", 401, {"www-authenticate": "Bearer"})
            return await _in_one_line(handle, request, 409)

        return answer

    def _posted(self, act: Callable[[dict[str, Any]], None]) -> Handle:
        """A POST with JSON from this page or a program, not from a foreign page."""

        async def answer(request: Request) -> Response:
            if is_foreign(request):
                return PlainTextResponse("This request comes from another page.\n", 403)
            if request.headers.get("content-type", "").partition(";")[0] != "application/json":
                return PlainTextResponse("application/json is expected.\n", 415)
            fields = await json_of(request)
            await run_in_threadpool(act, fields)
            return Response(status_code=204)

        return self._admitted(answer)

    async def _enter(self, request: Request) -> Response:
        """A browser that has the token gets a key made from it, and the cookie for everything that only reads."""
        if is_foreign(request):
            return PlainTextResponse("This request comes from another page.\n", 403)
        answer = JSONResponse({"key": self._access.teach_key}, headers={"cache-control": NO_STORE})
        if self._access.cookie:
            answer.set_cookie(COOKIE, self._access.cookie, COOKIE_S, httponly=True, samesite="strict")
        return answer

    async def _state(self, request: Request) -> Response:
        """How the lesson stands; with `?after=VERSION` once it stands otherwise."""
        lesson_server, after = self._required, request.query_params.get("after", "")
        loop = asyncio.get_running_loop()
        end_s = loop.time() + LONG_POLL_S
        lesson_server.looked()
        while str(lesson_server.version) == after and loop.time() < end_s and not self._ended:
            await asyncio.sleep(LESSON_CHECK_S)
        return _answer({**lesson_server_data(lesson_server), "file": self._file})

    async def _home(self, request: Request) -> Response:
        if self._scene is None:
            return _answer({"connected": False, "state": "", "steps": []})
        advice = home_assistant_advice(self._scene, self._hubs())
        return _answer({"connected": advice.connected, "state": advice.state, "steps": list(advice.steps)})

    async def _now(self, request: Request) -> Response:
        tracks = await run_in_threadpool(self._required.now, request.path_params["observer"])
        return Response(status_code=204) if tracks is None else _answer(tracks.model_dump())

    async def _take(self, request: Request) -> Response:
        names = request.path_params
        number = take_number(names["number"])
        if number is None or not LABEL.match(names["label"]):
            return PlainTextResponse("There is no such take.\n", 404)
        tracks = await run_in_threadpool(self._required.take, names["observer"], names["label"], number)
        return Response(status_code=204) if tracks is None else _answer(tracks.model_dump())

    def _start(self, fields: dict[str, Any]) -> None:
        lesson_server = self._required
        plan = plan_of(fields, known_labels(lesson_server.observers), secrets.token_hex(8))
        lesson_server.start(plan)
        log.info("teaching from the page: %s", ", ".join(plan.labels))

    def _correct(self, fields: dict[str, Any]) -> None:
        wanted = corrections_of(fields, known_labels(self._required.observers))
        self._required.correct(wanted)
        if self._scene is not None:
            note_corrections(self._scene, wanted.labels)

    def _forget(self, fields: dict[str, Any]) -> None:
        unwanted = unwanted_of(fields)
        self._required.forget(unwanted, clips=fields.get("clips") is True)
        if self._scene is not None and (line := forget_in_history(self._scene, unwanted)):
            log.info("%s", line)
        # No name: what is forgotten does not stay in a log.
        kind = "everything" if unwanted.everything else "a person" if unwanted.person else "a movement"
        log.info("forgetting from the page: %s", kind)

    def _press(self, fields: dict[str, Any]) -> None:
        number = fields.get("number")
        self._required.press(str(fields.get("lesson")), number if isinstance(number, int) else -1, action_of(fields))

    def _stop(self, fields: dict[str, Any]) -> None:
        self._required.stop(str(fields.get("lesson")))

    @property
    def _required(self) -> LessonServer:
        if self._lesson_server is None:
            raise BadInput(self._off)
        return self._lesson_server


def is_foreign(request: Request) -> bool:
    """Whether the browser marks this request as sent by another page; programs send no such mark."""
    site, origin = request.headers.get("sec-fetch-site"), request.headers.get("origin")
    if site is not None:
        return site not in ("same-origin", "none")
    return origin is not None and urlsplit(origin).netloc != request.headers.get("host", "")


def for_teachers(access: AccessControl, handle: Handle, bad_input: int) -> Handle:
    """What only teachers may see and change. bad_input: the status then."""

    async def answer(request: Request) -> Response:
        return await _change_refusal(request, access) or await _in_one_line(handle, request, bad_input)

    return answer


async def _in_one_line(handle: Handle, request: Request, bad_input: int) -> Response:
    headers = {"cache-control": NO_STORE}
    try:
        return await handle(request)
    except TimeoutError:
        return PlainTextResponse("Too slow.\n", 408, headers)
    except LabanmeshError as error:
        return PlainTextResponse(f"{error}\n", bad_input if isinstance(error, BadInput) else 503, headers)


async def _change_refusal(request: Request, access: AccessControl) -> Response | None:
    authorization, headers = request.headers.get("authorization", ""), {"cache-control": NO_STORE}
    if is_foreign(request):
        return PlainTextResponse("This request comes from another page.\n", 403, headers)
    if access.may_change(authorization):
        return None
    access.record_wrong(address_of(request), authorization)
    await asyncio.sleep(WRONG_TOKEN_S if authorization else 0.0)
    return PlainTextResponse("The token of the Teach page is missing or wrong.\n", 403, headers)


async def json_of(request: Request) -> dict[str, Any]:
    """The JSON object of a request; raises BadInput for a longer one and for anything else."""
    body = await body_of(request, BODY_LIMIT)
    if len(body) > BODY_LIMIT:
        raise BadInput(f"too long: {BODY_LIMIT} bytes are allowed")
    try:
        fields = json.loads(body)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise BadInput("a JSON object is expected")
    return fields


def _answer(fields: dict[str, Any]) -> Response:
    return JSONResponse(fields, headers={"cache-control": NO_STORE})


def people_routes(names: PeopleNames, access: AccessControl) -> list[Route]:
    """POST /people with `person` and `name`."""

    async def rename(request: Request) -> Response:
        fields = await json_of(request)
        await run_in_threadpool(names.rename, fields.get("person"), fields.get("name"))
        return Response(status_code=204)

    return [Route("/people", for_teachers(access, rename, 400), methods=["POST"])]
