"""A TCP relay on the loopback that delays everything, as a long line between two machines does, and that can be cut, or
swallow what is sent until it passes on again, late, as TCP does after packets were lost."""

import socket
import threading
import time
from collections import deque
from contextlib import suppress

CHUNK = 65536


class SlowLine:
    """Listens on a free port of this machine and relays to `port`, each way `delay_s` later; a context manager."""

    def __init__(self, port, delay_s):
        self._to, self._delay_s = ("127.0.0.1", port), delay_s
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.passed = 0
        self._sockets, self._is_cut, self._passes = [], False, threading.Event()
        self._passes.set()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                if self._is_cut:
                    near.close()
                    continue
                try:
                    far = socket.create_connection(self._to)
                except OSError:
                    near.close()
                    continue
                self._sockets += [near, far]
                for source, sink in ((near, far), (far, near)):
                    source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._pass_on(source, sink)

    def _pass_on(self, source, sink):
        waiting, come = deque(), threading.Semaphore(0)

        def read():
            data = b"x"
            while data:
                try:
                    data = source.recv(CHUNK)
                except OSError:
                    data = b""
                waiting.append((time.monotonic() + self._delay_s, data))
                come.release()

        def write():
            while come.acquire():
                due, data = waiting.popleft()
                time.sleep(max(due - time.monotonic(), 0.0))  # the delay itself, no waiting for a condition
                self._passes.wait()
                if not data:
                    break
                try:
                    sink.sendall(data)
                except OSError:
                    break
                self.passed += len(data)
            for end in (source, sink):
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

        for work in (read, write):
            threading.Thread(target=work, daemon=True).start()

    def cut(self):
        """Ends all connections, and admits none until `heal`."""
        self._is_cut = True
        self._end(self._sockets)

    def swallow(self):
        """A black hole: nothing passes, and no connection ends, until `heal`."""
        self._passes.clear()

    def heal(self):
        """The line can be used again."""
        self._is_cut = False
        self._passes.set()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.heal()
        self._end((self._listening, *self._sockets))

    @staticmethod
    def _end(sockets):
        for one in sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()
