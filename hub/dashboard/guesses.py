"""Limits how fast an address may guess the page's token. Pure: time is passed in.

1. An address that has sent GUESSES different wrong words within WINDOW_S is answered no more, right or wrong, until the
   oldest of them is that old. The same word again, as an old cookie on each request, is no further guess.
2. Other addresses are not concerned.
"""

import hashlib
import ipaddress
import math
from collections import OrderedDict
from dataclasses import dataclass, field

GUESSES, WINDOW_S = 10, 60.0
ADDRESSES_LIMIT = 4096
"""Of more addresses those that guessed longest ago are forgotten."""
IPV6_HOST_BITS = 64
"""One household has all addresses that differ in these only."""


@dataclass(slots=True)
class GuessLimit:
    """The wrong words of each address: a digest of each, and when it was first sent."""

    _wrong: "OrderedDict[str, dict[bytes, float]]" = field(default_factory=OrderedDict)

    def wait_s(self, address: str, now_s: float) -> int:
        """Seconds for which `address` is refused; 0 if it is not."""
        words = self._wrong.get(address)
        if words is None:
            return 0
        for word in [word for word, at_s in words.items() if now_s - at_s >= WINDOW_S]:
            del words[word]
        return 0 if len(words) < GUESSES else max(1, math.ceil(min(words.values()) + WINDOW_S - now_s))

    def wrong(self, address: str, word: str, now_s: float) -> None:
        """Count a wrong token from this address; the same one again counts once."""
        words = self._wrong.setdefault(address, {})
        self._wrong.move_to_end(address)
        # A digest, because a wrong word may be somebody's password for something else.
        words.setdefault(hashlib.sha256(word.encode("utf-8", "replace")).digest(), now_s)
        if len(self._wrong) > ADDRESSES_LIMIT:
            self._wrong.popitem(last=False)


def address_group(host: str) -> str:
    """The addresses that count as one: an IPv4 address, or the network of an IPv6 address."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((int(address) >> IPV6_HOST_BITS << IPV6_HOST_BITS, IPV6_HOST_BITS)))
