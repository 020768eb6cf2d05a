"""Two hosts on one machine: network namespaces joined by a cable (veth) that can be pulled or made lossy. Only root can
make them; `why_not` gives the reason. Names contain this process's id, so that test processes do not collide; what a
killed test process left behind is removed by the next one."""

import itertools
import os
import shutil
import subprocess
from contextlib import suppress
from pathlib import Path

PREFIX = "labanfault"
CABLE = "cable"
LEFT, RIGHT = "10.77.0.1", "10.77.0.2"
"""Addresses inside the two namespaces, which nothing else can reach."""
_count = itertools.count()


def why_not(*tools):
    """Why no hosts can be made here, or "": not Linux, not root, a tool that is missing."""
    if os.geteuid() != 0:
        return "only root can make network namespaces"
    for tool in ("ip", *tools):
        if shutil.which(tool) is None:
            return f"{tool} is not installed (Debian: apt-get install iproute2 nftables)"
    name = f"{PREFIX}-{os.getpid()}-probe"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True)
    if made.returncode:
        return f"network namespaces cannot be made here: {made.stderr.strip()}"
    subprocess.run(["ip", "netns", "del", name], check=True)
    return ""


class Host:
    """A network namespace with its own address. inside: the words before a command that is to run in it."""

    def __init__(self, name, address):
        self.name, self.address = name, address
        self.inside = ("ip", "netns", "exec", name)

    def run(self, *words):
        """A short command inside."""
        return subprocess.run([*self.inside, *words], check=True, capture_output=True, text=True).stdout

    def link(self, state):
        """`down`: this end of the cable is pulled; `up`: it is back."""
        self.run("ip", "link", "set", CABLE, state)

    def lose(self, percent):
        """Drop this percentage of the packets that arrive over the cable, at random; 0 ends it."""
        with suppress(subprocess.CalledProcessError):
            self.run("nft", "delete", "table", "inet", "loss")
        if percent:
            self.run("nft", "add", "table", "inet", "loss")
            self.run("nft", "add", "chain", "inet", "loss", "in", "{ type filter hook input priority 0; }")
            chance = () if percent >= 100 else ("numgen", "random", "mod", "100", "<", str(percent))
            self.run("nft", "add", "rule", "inet", "loss", "in", "iifname", CABLE, *chance, "counter", "drop")

    @property
    def lost(self):
        """How many packets were dropped so far."""
        words = self.run("nft", "list", "table", "inet", "loss").split()
        return int(words[words.index("packets") + 1])


class Hosts:
    """Two hosts and the cable between them; a context manager that removes them."""

    def __init__(self):
        _sweep()
        stem = f"{PREFIX}-{os.getpid()}-{next(_count)}"
        self.left, self.right = Host(f"{stem}-l", LEFT), Host(f"{stem}-r", RIGHT)

    def __enter__(self):
        try:
            self._lay()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _lay(self):
        for host in (self.left, self.right):
            _ip("netns", "add", host.name)
        left, right = self.left.name, self.right.name
        _ip("link", "add", CABLE, "netns", left, "type", "veth", "peer", "name", CABLE, "netns", right)
        for host in (self.left, self.right):
            _ip("-n", host.name, "address", "add", f"{host.address}/30", "dev", CABLE)
            _ip("-n", host.name, "link", "set", "lo", "up")
            _ip("-n", host.name, "link", "set", CABLE, "up")

    def __exit__(self, *_):
        for host in (self.left, self.right):
            _remove(host.name)


def _sweep():
    """Remove what a test process that has ended left behind."""
    for place in Path("/run/netns").glob(f"{PREFIX}-*"):
        if not Path(f"/proc/{place.name.split('-')[1]}").exists():
            _remove(place.name)


def _remove(name):
    inside = subprocess.run(["ip", "netns", "pids", name], capture_output=True, text=True).stdout
    for pid in inside.split():
        with suppress(ProcessLookupError):
            os.kill(int(pid), 9)
    subprocess.run(["ip", "netns", "del", name], capture_output=True)


def _ip(*words):
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)
