"""`labanmesh doctor --ready`: whether a process, or a whole scene, is ready; for containers and scripts.

1. If the scene has metrics.listen, the process itself is asked there: /readyz.
2. Otherwise the mesh is queried for the status of the process, or of all of them.
"""

import http.client
import json
import time
from pathlib import Path
from typing import Annotated

import typer

from common.address import Address
from common.config import Scene, read_scene
from common.errors import BadInput, LabanmeshError
from common.link import Link
from common.messages import StatusMessage
from common.wire import BadMessage, decode_from
from deploy.hubs import EVENTS, HUBS

READY_TIMEOUT_S = 3.0
"""A container gives its check five seconds, of which Python needs one to start."""
ASK_PAUSE_S = 0.05
MESH_TIMEOUT_S = 2.0
HUB_PROCESSES = (*HUBS, EVENTS[-1])


def ready(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML).")] = Path("scene.toml"),
    process: Annotated[
        str, typer.Option(metavar="ID", help="An observer, a fusion service, or a hub: mqtt, dashboard, events.")
    ] = "",
    only_ready: Annotated[
        bool, typer.Option("--ready", show_default=False, help="Leave out all other checks of the doctor.")
    ] = True,
) -> None:
    """Whether a process is ready: one line, exit status 0 or 1. Without --process: the one at metrics.listen, or all.

    With metrics.listen in the scene file the process itself is asked, at /readyz; otherwise the mesh is queried.

    Example: labanmesh doctor --ready scene.toml --process sofa

    Example: LABANMESH_METRICS_LISTEN=127.0.0.1:9465 labanmesh doctor --ready scene.toml
    """
    config = read_scene(scene)
    known = (*config.roster, *config.services, *HUB_PROCESSES)
    if process and process not in known:
        raise BadInput(f"--process {process}: not in {scene}; known: {', '.join(known)}")
    listen = config.metrics.listen
    address = Address.parse(listen, "metrics.listen").reachable if listen else None
    if address is None or not address.port:
        print(_check_mesh(config, process))
    else:
        print(_check_ports(address, process, len(known)))


def _check_ports(first: Address, process: str, count: int) -> str:
    """Under `labanmesh up` each process has the next port: try one after the other until `process` answers."""
    for step in range(count if process else 1):
        address = first.after(step)
        answer = _readiness(address)
        if answer is not None and process in ("", answer.get("process")):
            return _result(answer, address)
    last = first.after(count - 1).port
    fault = f"{process} does not answer at {first} to {last}" if process else f"{first}: no process answers"
    raise LabanmeshError(f"{fault}; is it running, and is metrics.listen the same there?")


def _readiness(address: Address) -> dict[str, object] | None:
    connection = http.client.HTTPConnection(address.host, address.port, timeout=READY_TIMEOUT_S)
    try:
        connection.request("GET", "/readyz")
        answer = json.loads(connection.getresponse().read(65_536))
    except (OSError, http.client.HTTPException, ValueError, RecursionError):
        return None
    finally:
        connection.close()
    return answer if isinstance(answer, dict) else None


def _result(answer: dict[str, object], address: Address) -> str:
    name = f"{answer.get('scene')}, {answer.get('role')} {answer.get('process')} at {address}"
    reason = answer.get("reason")
    if answer.get("ok") is not True:
        raise LabanmeshError(f"{name}: not ready: {reason or 'it gives no reason'}")
    return f"{name}: ready" + (f" ({reason})" if reason else "")


def _check_mesh(scene: Scene, process: str) -> str:
    if process in HUB_PROCESSES and process not in (*scene.roster, *scene.services):
        raise BadInput(f"--process {process}: a hub has no status on the mesh; set metrics.listen")
    wanted = (process,) if process else (*scene.services, *scene.roster)
    statuses: dict[str, StatusMessage] = {}
    end_s = time.monotonic() + MESH_TIMEOUT_S
    with Link.open(scene.mesh, "hub") as link:
        # Observers and fusion services at once. The first peer may answer before the others are known: then again.
        while not statuses.keys() >= {*wanted} and (left_s := end_s - time.monotonic()) > 0:
            for key, payload in link.ask(f"{scene.keys.root}/*/{process or '*'}/status", left_s).items():
                try:
                    status = decode_from(key, StatusMessage, payload)
                except BadMessage as error:
                    raise LabanmeshError(f"{scene.scene}: unusable status: {error}") from None
                statuses[status.id] = status
            time.sleep(ASK_PAUSE_S)
    faults = [f"{name}: {fault}" for name in wanted if (fault := _fault(statuses.get(name)))]
    if faults:
        raise LabanmeshError(f"{scene.scene}: {'; '.join(faults)}")
    return f"{scene.scene}: {', '.join(wanted)} running"


def _fault(status: StatusMessage | None) -> str:
    if status is None:
        return "not on the mesh"
    return "" if status.state == "running" else f"{status.state}, {status.reason}".rstrip(", ")
