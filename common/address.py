"""HOST:PORT, where a process listens and others look for it. Pure."""

import re
from dataclasses import dataclass

from common.errors import BadInput

HOST_PORT = re.compile(r"(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):(\d{1,5})\Z")
LAST_PORT = 65535
ANY_HOST = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104 - names of it, nothing is bound here
"""Addresses that mean every interface, and where on this machine such a process is reached."""


@dataclass(frozen=True, slots=True)
class Address:
    """A host name or number, and a port; port 0: any that is free."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str, what: str) -> "Address":
        """The address that `text` names; raises BadInput that names `what` it is of."""
        found = HOST_PORT.match(text)
        if found is None or int(found[2]) > LAST_PORT:
            raise BadInput(f"{what} = {text!r}: must be HOST:PORT with a port up to {LAST_PORT}, e.g. 127.0.0.1:9464")
        return cls(found[1].strip("[]"), int(found[2]))

    def after(self, steps: int) -> "Address":
        """So many ports further; any free port stays any free port. Raises BadInput past the last one."""
        port = self.port + steps if self.port else 0
        if port > LAST_PORT:
            raise BadInput(f"metrics.listen = '{self}': {steps} further processes need a port each; begin lower")
        return Address(self.host, port)

    @property
    def reachable(self) -> "Address":
        """How this machine reaches it: every interface is not a place to go to."""
        return Address(ANY_HOST.get(self.host, self.host), self.port)

    def __str__(self) -> str:
        """HOST:PORT, as it is written in the scene file."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"
