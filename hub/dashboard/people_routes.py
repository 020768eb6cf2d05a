"""The names of people on the page: for everybody who looks, given by whoever may teach (access.py, rule 7)."""

from typing import TYPE_CHECKING

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from common.errors import BadInput, LabanmeshError
from hub.dashboard.access import AccessControl
from hub.dashboard.teach_routes import change_refusal, json_of

if TYPE_CHECKING:
    from hub.people_names_file import PeopleNames


def people_routes(names: "PeopleNames", access: AccessControl) -> list[Route]:
    """POST /people with `person` and `name`."""

    async def rename(request: Request) -> Response:
        if (refused := await change_refusal(request, access)) is not None:
            return refused
        try:
            fields = await json_of(request)
            await run_in_threadpool(names.rename, fields.get("person"), fields.get("name"))
        except TimeoutError:
            return PlainTextResponse("Too slow.\n", 408)
        except BadInput as error:
            return PlainTextResponse(f"{error}\n", 400)
        except LabanmeshError as error:
            return PlainTextResponse(f"{error}\n", 503)
        return Response(status_code=204)

    return [Route("/people", rename, methods=["POST"])]
