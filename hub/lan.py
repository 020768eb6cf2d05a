"""How other machines of the network reach this one."""

import socket

from common.address import Address
from common.errors import LabanmeshError, reason_of

ELSEWHERE = ("192.0.2.1", 9)
"""An address that nobody has (RFC 5737); nothing is sent to it."""


def lan_address() -> str:
    """The address under which other machines reach this one, as far as it knows; its name if it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def bound_socket(address: Address, setting: str) -> socket.socket:
    """The listening socket; raises LabanmeshError, one line, when the address of `setting` cannot be used."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.create_server((address.host, address.port), family=family)
    except OSError as error:
        fault = f"{setting} = {str(address)!r}: {reason_of(error)}"
        way_out = "stop the other process or choose another port with --listen HOST:PORT"
        raise LabanmeshError(f"{fault}; {way_out}") from None
