"""The address HOST:PORT at which a process listens for HTTP. Pure."""

import re
from dataclasses import dataclass

from common.errors import BadInput

HOST_PORT = re.compile(r"(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):(\d{1,5})\Z")
LAST_PORT = 65535
ADDRESS_RULE = f"must be HOST:PORT with a port up to {LAST_PORT}, e.g. 127.0.0.1:9464"
ANY_HOST = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104 - their names only, nothing is bound here
"""Addresses that mean every interface, with the address at which this machine reaches such a process."""


@dataclass(frozen=True, slots=True)
class Address:
    """A host name or number, and a port; port 0 means any free port."""

    host: str
    port: int

    @classmethod
    def parsed(cls, text: str) -> "Address | None":
        """The address in `text`; None for anything else."""
        match = HOST_PORT.match(text)
        return cls(match[1].strip("[]"), int(match[2])) if match and int(match[2]) <= LAST_PORT else None

    @classmethod
    def parse(cls, text: str, setting: str) -> "Address":
        """Same as `parsed`; raises BadInput that names the `setting` it is the value of."""
        address = cls.parsed(text)
        if address is None:
            raise BadInput(f"{setting} = {text!r}: {ADDRESS_RULE}")
        return address

    def after(self, steps: int) -> "Address":
        """The address `steps` ports higher; port 0 stays 0. Raises BadInput above the last port."""
        port = self.port + steps if self.port else 0
        if port > LAST_PORT:
            raise BadInput(f"metrics.listen = '{self}': {steps} more processes need a port each; choose a lower port")
        return Address(self.host, port)

    @property
    def reachable(self) -> "Address":
        """The address at which this machine reaches a process that listens here."""
        return Address(ANY_HOST.get(self.host, self.host), self.port)

    def __str__(self) -> str:
        """HOST:PORT, as in the scene file."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"
