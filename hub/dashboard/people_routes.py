"""The names of people on the page: for everybody who looks, given by whoever may teach (access.py, rule 7)."""

from typing import TYPE_CHECKING

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from hub.dashboard.access import AccessControl
from hub.dashboard.teach_routes import for_teachers, json_of

if TYPE_CHECKING:
    from hub.people_names_file import PeopleNames


def people_routes(names: "PeopleNames", access: AccessControl) -> list[Route]:
    """POST /people with `person` and `name`."""

    async def rename(request: Request) -> Response:
        fields = await json_of(request)
        await run_in_threadpool(names.rename, fields.get("person"), fields.get("name"))
        return Response(status_code=204)

    return [Route("/people", for_teachers(access, rename, 400), methods=["POST"])]
