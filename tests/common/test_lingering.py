"""Sockets that would hold up a close are found among this process's own, and others are left alone."""

import socket
import struct
import sys

import pytest

from common.link import end_lingering

LINGERS = struct.pack("ii", 1, 10)


@pytest.mark.skipif(sys.platform != "linux", reason="only where a process can look through its own descriptors")
def test_a_tcp_socket_that_lingers_does_so_no_more_and_others_are_as_they_were():
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp, socket.socket() as quick:
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGERS)
        assert end_lingering() == 1
        assert tcp.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[:4] == bytes(4)
        assert end_lingering() == 0
        assert all(each.fileno() >= 0 for each in (tcp, udp, quick))
