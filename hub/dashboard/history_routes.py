"""The day page, and the history as JSON, for everybody who may read the other pages, if the certificate allows it."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from common import MS_NS
from common.clip_name import clip_parts, safe_word
from common.config import Scene
from hub.dashboard.access import NO_STORE, static_page
from hub.database import DatabaseFault
from hub.history.history_file import HistoryFile, HistoryQuery
from hub.history.records import PAGE_FIELDS, ROW_KINDS
from hub.people_names_file import PeopleNames

DAY_FILES = {"/day": "day.html", "/day.js": "day.js"}
LAST_EXACT_MS = 2**53
"""Numbers of JavaScript are whole up to here."""
PAGE_MOST_ROWS = 20_000
MINUTE_MS = 60_000
NO_HISTORY_HERE = 'This scene keeps no history: set file = "history.db" in the section [history] of the scene file.\n'
NO_HISTORY_RIGHT = (
    "This dashboard's certificate has no right to the history: labanmesh secure add ... --hub --history.\n"
)


def history_routes(scene: Scene | None, teaches: bool, allowed: bool = True, shows_clips: bool = True) -> list[Route]:
    """The routes; scene: None for a capture, which has none. teaches: the page can correct.

    allowed, shows_clips: what the certificate allows; clips are those of observers on this machine.
    """
    if scene is None:
        return []
    path = scene.place(scene.history.file)
    off = (404, NO_HISTORY_HERE) if not scene.history.file else (403, NO_HISTORY_RIGHT) if not allowed else None

    def data(request: Request) -> Response:
        headers = {"cache-control": NO_STORE}
        if off is not None:
            return PlainTextResponse(off[1], off[0], headers)
        try:
            query = _query(request.query_params)
            with HistoryFile.to_read(path) as file:
                rows, labels = file.select(query), file.labels()
            names = PeopleNames(scene).names
        except ValueError as error:
            return PlainTextResponse(f"{error}\n", 400, headers)
        except DatabaseFault as error:
            # Where the file lies on this machine is not for browsers.
            fault = str(error).removeprefix(f"{path}: ")
            return PlainTextResponse(f"{fault[:1].upper()}{fault[1:]}.\n", 503, headers)
        answer = {
            "scene": scene.scene,
            "fields": PAGE_FIELDS,
            "rows": [row.as_page() for row in rows],
            "labels": labels,
            **({"names": dict(names)} if names else {}),
            "clips": clips_of(scene, {row.id for row in rows}) if shows_clips else {},
            "remembered": round(scene.teaching.remember_minutes * MINUTE_MS) if teaches else 0,
        }
        return JSONResponse(answer, headers=headers)

    def clip(request: Request) -> Response:
        wanted = request.path_params["observer"], request.path_params["verdict"]
        kept = _clips(scene) if shows_clips and off is None else ()
        return _clip_response(next((path for *own, path in kept if (*own,) == wanted), None))

    pages = [static_page(path, name) for path, name in DAY_FILES.items()]
    return [*pages, Route("/history/data", data), Route("/history/clip/{observer}/{verdict}", clip)]


def _clip_response(path: Path | None) -> Response:
    try:
        content = None if path is None else path.read_bytes()
    except OSError:
        content = None
    if path is None or content is None:
        return PlainTextResponse("There is no such clip on this machine.\n", 404)
    headers = {"cache-control": NO_STORE, "content-disposition": f'attachment; filename="{path.name}"'}
    return Response(content, media_type="video/x-msvideo", headers=headers)


def clips_of(scene: Scene, verdicts: set[str]) -> dict[str, list[list[str]]]:
    """For each of these verdicts that has clips here: the observers, each with the verdict's word in the name."""
    words = {safe_word(verdict): verdict for verdict in verdicts}
    clips: dict[str, list[list[str]]] = defaultdict(list)
    for observer, word, _ in _clips(scene):
        if word in words:
            clips[words[word]].append([observer, word])
    return {verdict: sorted(each) for verdict, each in clips.items()}


def _clips(scene: Scene) -> Iterator[tuple[str, str, Path]]:
    folders = {scene.place(each.clips.folder) for each in scene.observers.values() if each.clips.folder}
    for folder in folders:
        try:
            paths = sorted(folder.iterdir())
        except OSError:
            # Of an observer on another machine, or that has kept none yet.
            continue
        for path in paths:
            parts = clip_parts(path.name)
            if parts is not None and parts[0] in scene.observers:
                yield parts[0], parts[2], path


def _query(given: Mapping[str, str]) -> HistoryQuery:
    kind = given.get("kind", "")
    if kind and kind not in ROW_KINDS:
        raise ValueError(f"kind = {kind[:40]!r}: {' or '.join(ROW_KINDS)} is expected")
    begin, end = _whole(given, "from", LAST_EXACT_MS), _whole(given, "until", LAST_EXACT_MS)
    limit = _whole(given, "limit", PAGE_MOST_ROWS)
    return HistoryQuery(
        kind,
        given.get("label", "")[:64],
        None if begin is None else begin * MS_NS,
        None if end is None else end * MS_NS,
        PAGE_MOST_ROWS if limit is None else limit,
    )


def _whole(given: Mapping[str, str], name: str, most: int) -> int | None:
    text = given.get(name)
    if text is None:
        return None
    if not text.isascii() or not text.isdecimal() or int(text[:20]) > min(most, LAST_EXACT_MS):
        raise ValueError(f"{name} = {text[:40]!r}: a whole number from 0 to {most} is expected")
    return int(text)
