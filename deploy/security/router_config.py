"""The router's whole Zenoh configuration, for `labanmesh router` and zenohd alike. Pure: scene and register to text."""

import ipaddress
import json
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from common.zenoh_settings import nested, settings
from deploy.security.access import access_rules
from deploy.security.register import Register

if TYPE_CHECKING:
    from common.config import Scene

ADDRESS = re.compile(r"(?P<protocol>[\w-]+)/(?P<host>\[[^\]]+\]|[^/\[\]]+):(?P<port>\d+)(?P<more>[#?].*)?\Z")
HEAD = """\
// The router of the scene {scene}, made by labanmesh secure; do not edit: it is written anew at each change.
// labanmesh router --config FILE, or zenohd --config FILE
"""


def router_config(scene: "Scene", register: Register | None, listen: Sequence[str], credentials: str = "") -> str:
    """JSON5 for a router that listens on `listen`; without a register everybody may do everything.

    credentials: where ca.pem, certificate.pem and key.pem lie on the router's machine, if not where the scene says.
    """
    mesh = scene.mesh.model_copy(update={"credentials": credentials}) if credentials else scene.mesh
    chosen = settings(mesh, "router", listen, 0.0)
    if mesh.credentials:
        # Or somebody could open a plain listener beside the secured one.
        chosen["transport/link/protocols"] = sorted({endpoint.partition("/")[0] for endpoint in listen})
    tree = nested(chosen)
    if register is not None:
        tree["access_control"] = access_rules(scene, register)
    return HEAD.format(scene=scene.scene) + json.dumps(tree, indent=1) + "\n"


def listening(endpoint: str) -> str:
    """Where the router listens whom others meet at `endpoint`: there, or on every interface if it is a name.

    A machine's own name often stands for its loopback interface alone, where no other machine would find it.
    """
    parts = ADDRESS.match(endpoint)
    if parts is None or _is_number(parts["host"]):
        return endpoint
    return f"{parts['protocol']}/0.0.0.0:{parts['port']}{parts['more'] or ''}"


def host_of(endpoint: str) -> str:
    """The host in `PROTOCOL/HOST:PORT`, without brackets; "" if there is none."""
    parts = ADDRESS.match(endpoint)
    return parts["host"].strip("[]") if parts else ""


def _is_number(host: str) -> bool:
    try:
        return bool(ipaddress.ip_address(host.strip("[]")))
    except ValueError:
        return False
