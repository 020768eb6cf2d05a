"""The verb `labanmesh healthcheck`: whether a process, or a whole scene, does its work; for containers and scripts.

1. Where the scene has metrics.listen, the process is asked there: /readyz.
2. Else the mesh is asked for the status of the process, or of all of them.
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

PATIENCE_S = 3.0
"""A container gives its check five seconds, of which Python needs one to begin."""
AGAIN_S = 0.05
MESH_PATIENCE_S = 2.0
HUBS = ("mqtt", "dashboard")


def healthcheck(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML).")] = Path("scene.toml"),
    process: Annotated[
        str, typer.Option(metavar="ID", help="An observer, a fusion service, or a hub: mqtt, dashboard.")
    ] = "",
) -> None:
    """Whether a process does its work: one line, status 0 or 1. Without --process: the one at metrics.listen, or all.

    With metrics.listen in the scene file the process itself is asked, at /readyz; else the mesh is asked.

    Example: labanmesh healthcheck scene.toml --process sofa

    Example: LABANMESH_METRICS_LISTEN=127.0.0.1:9465 labanmesh healthcheck scene.toml
    """
    named = read_scene(scene)
    known = (*named.roster, *named.services, *HUBS)
    if process and process not in known:
        raise BadInput(f"--process {process}: not in {scene}; known: {', '.join(known)}")
    address = Address.parse(named.metrics.listen, "metrics.listen").reachable if named.metrics.listen else None
    print(_of_mesh(named, process) if address is None or not address.port else _of_ports(address, process, len(known)))


def _of_ports(first: Address, process: str, most: int) -> str:
    """Under `labanmesh up` each process has the next port: go on until the wanted one answers."""
    for step in range(most if process else 1):
        address = first.after(step)
        said = _readiness(address)
        if said is not None and process in ("", said.get("process")):
            return _judged(said, address)
    last = first.after(most - 1).port
    wanted = f"{process} does not answer at {first} to {last}" if process else f"{first}: nobody answers"
    raise LabanmeshError(f"{wanted}; does it run, and is metrics.listen the same there?")


def _readiness(address: Address) -> dict[str, object] | None:
    """What /readyz says; None where nobody answers."""
    connection = http.client.HTTPConnection(address.host, address.port, timeout=PATIENCE_S)
    try:
        connection.request("GET", "/readyz")
        said = json.loads(connection.getresponse().read(65_536))
    except (OSError, http.client.HTTPException, ValueError):
        return None
    finally:
        connection.close()
    return said if isinstance(said, dict) else None


def _judged(said: dict[str, object], address: Address) -> str:
    who = f"{said.get('scene')}, {said.get('role')} {said.get('process')} at {address}"
    reason = said.get("reason")
    if said.get("ok") is not True:
        raise LabanmeshError(f"{who}: not ready: {reason or 'it does not say why'}")
    return f"{who}: ready" + (f" ({reason})" if reason else "")


def _of_mesh(scene: Scene, process: str) -> str:
    from common.link import Link
    from common.messages import StatusMessage
    from common.wire import BadMessage, decode

    if process in HUBS and process not in (*scene.roster, *scene.services):
        raise BadInput(f"--process {process}: a hub says nothing of itself on the mesh; set metrics.listen")
    wanted = (process,) if process else (*scene.services, *scene.roster)
    statuses: dict[str, StatusMessage] = {}
    end_s = time.monotonic() + MESH_PATIENCE_S
    with Link.open(scene.mesh, "hub") as link:
        # Observers and fusion services at once. The first to be met may answer before the others are: then once more.
        while not statuses.keys() >= {*wanted} and (left_s := end_s - time.monotonic()) > 0:
            payloads = link.ask(f"{scene.keys.root}/*/{process or '*'}/status", left_s).values()
            try:
                statuses |= {status.id: status for status in (decode(StatusMessage, payload) for payload in payloads)}
            except BadMessage as error:
                raise LabanmeshError(f"{scene.scene}: a status that cannot be used: {error}") from None
            time.sleep(AGAIN_S)
    wrong = [
        f"{name}: {f'{said.state}, {said.reason}'.rstrip(', ') if (said := statuses.get(name)) else 'not on the mesh'}"
        for name in wanted
        if name not in statuses or statuses[name].state != "running"
    ]
    if wrong:
        raise LabanmeshError(f"{scene.scene}: {'; '.join(wrong)}")
    return f"{scene.scene}: {', '.join(wanted)} running"
