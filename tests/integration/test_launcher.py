"""The launcher with trivial processes: it starts, restarts, gives up, merges logs, and ends them all."""

import io
import os
import signal
import socket
import sys
import threading
from pathlib import Path

import pytest
from processes import SOON_S

from common.backoff import Backoff
from common.config import read_scene
from common.errors import LabanmeshError
from deploy.commands import jobs, open_start_barrier, require_free_ports, up
from deploy.launcher import Job, Launcher

QUICK = Backoff(0.01, 0.02)
LASTING = "import time; print('ready', flush=True); time.sleep(600)"


class Stream(io.StringIO):
    """A log that can be waited for."""

    def __init__(self):
        super().__init__()
        self._changed = threading.Condition()

    def write(self, text):
        with self._changed:
            written = super().write(text)
            self._changed.notify_all()
        return written

    def wait_for(self, text, times=1):
        with self._changed:
            assert self._changed.wait_for(lambda: self.getvalue().count(text) >= times, SOON_S), self.getvalue()


def python(name, text, lasting=False):
    return Job(name, [sys.executable, "-c", text], lasting)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture
def launched():
    """Run a launcher in a thread; yields it with its log, its stop event and, in the end, its status."""
    threads, stops = [], []

    def run(*jobs, most_failures=None, **arguments):
        stream, stop, status = Stream(), threading.Event(), []
        launcher = Launcher(jobs, backoff=QUICK, most_failures=most_failures, stream=stream)
        thread = threading.Thread(target=lambda: status.append(launcher.run(stop, **arguments)))
        thread.start()
        threads.append(thread)
        stops.append(stop)

        def ended():
            thread.join(SOON_S)
            assert not thread.is_alive(), stream.getvalue()
            return status[0]

        return stream, stop, ended

    yield run
    for stop in stops:
        stop.set()
    for thread in threads:
        thread.join(SOON_S)


def test_each_line_has_the_name_of_its_process(launched):
    stream, _, ended = launched(
        python("cam1", "import sys; print('out'); print('err', file=sys.stderr)"),
        python("longer", "print('x')"),
        exit_when_done=True,
    )
    assert ended() == 0
    lines = stream.getvalue().splitlines()
    assert {"cam1   | out", "cam1   | err", "longer | x"} <= set(lines)
    assert any(line.startswith("[up]   | cam1 finished (status 0)") for line in lines)


def test_a_failing_process_is_started_again_until_it_works(launched, tmp_path):
    text = (
        f"import pathlib, sys; p = pathlib.Path({str(tmp_path / 'n')!r}); n = len(p.read_text()) if p.exists() else 0"
    )
    text += "; p.write_text('x' * (n + 1)); sys.exit(0 if n == 2 else 1)"
    stream, _, ended = launched(python("cam1", text), exit_when_done=True)
    assert ended() == 0
    assert (tmp_path / "n").read_text() == "xxx"
    assert stream.getvalue().count("cam1 ended with status 1") == 2


def test_bad_input_is_not_tried_again_and_the_others_go_on(launched):
    stream, _, ended = launched(
        python("bad", "raise SystemExit(2)"), python("good", "print('done')"), exit_when_done=True
    )
    assert ended() == 1
    assert stream.getvalue().count("bad given up (status 2)") == 1
    assert "good | done" in stream.getvalue()


def test_a_failing_worker_is_given_up_in_a_scene_with_an_end(launched):
    stream, _, ended = launched(python("cam1", "raise SystemExit(1)"), most_failures=3, exit_when_done=True)
    assert ended() == 1 and "cam1 given up (status 1)" in stream.getvalue()


def test_without_fusion_nothing_goes_on(launched):
    _, _, ended = launched(python("fuse", "raise SystemExit(2)", lasting=True), python("cam1", LASTING))
    assert ended() == 1


@pytest.mark.parametrize(("end", "decision", "status"), [(0, "finished", 0), (2, "given up", 1)])
def test_when_no_worker_is_left_the_rest_goes_on_and_a_person_reads_that(launched, end, decision, status):
    workers = python("cam1", "pass"), python("cam2", f"raise SystemExit({end})")
    stream, stop, ended = launched(python("fuse", LASTING, lasting=True), *workers)
    ends = f"(cam1 finished, cam2 {decision})"
    stream.wait_for(f"[up] | no observer that was started here runs any more {ends}; Ctrl-C or SIGTERM ends the others")
    stream.wait_for("ready")
    stop.set()
    assert ended() == status and stream.getvalue().count("no observer") == 1


def test_when_all_are_done_lasting_processes_linger_and_are_stopped(launched, tmp_path):
    text = "import signal, threading; from pathlib import Path; e = threading.Event(); "
    text += f"signal.signal(15, lambda *_: e.set()); Path({str(tmp_path / 'ready')!r}).touch(); "
    text += "e.wait(600); print('clean', flush=True)"
    # Else it would end before the other can be stopped cleanly.
    waits = f"import time\nwhile not __import__('os').path.exists({str(tmp_path / 'ready')!r}): time.sleep(0.01)"
    stream, _, ended = launched(
        python("fuse", text, lasting=True), python("cam1", waits), exit_when_done=True, linger_s=0.1
    )
    assert ended() == 0
    assert "fuse | clean" in stream.getvalue()
    assert "no observer" not in stream.getvalue(), "it ends by itself"


def test_all_processes_are_ended_even_those_that_ignore_sigterm(launched, monkeypatch):
    monkeypatch.setattr("deploy.launcher.TERM_TIMEOUT_S", 1.0)
    deaf = "import os, signal, time; signal.signal(15, signal.SIG_IGN); print('pid', os.getpid(), flush=True); "
    stream, stop, ended = launched(python("deaf", deaf + "time.sleep(600)"), python("cam1", LASTING))
    stream.wait_for("deaf | pid ")
    stream.wait_for("ready")
    stop.set()
    assert ended() == 0
    assert "deaf did not end on SIGTERM" in stream.getvalue() and "cam1 did not" not in stream.getvalue()
    pid = int(stream.getvalue().split("deaf | pid ")[1].split()[0])
    assert not alive(pid)


def test_a_killed_process_comes_back(launched):
    text = "import os; print('pid', os.getpid(), flush=True); " + LASTING
    stream, stop, ended = launched(python("cam1", text))
    stream.wait_for("ready")
    os.kill(int(stream.getvalue().split("pid ")[1].split()[0]), signal.SIGKILL)
    stream.wait_for("ready", times=2)
    assert "cam1 ended with status -9" in stream.getvalue()
    stop.set()
    assert ended() == 0


def test_the_processes_of_a_scene(tmp_path):
    path = tmp_path / "scene.toml"
    observers = {"cam1": "a.npz", "by-hand": "-", "cam2": "b.npz"}
    path.write_text('scene = "d"\n' + "".join(f'[observers.{n}]\nsource = "{s}"\n' for n, s in observers.items()))
    python = [sys.executable, "-P", "-m", "labanmesh"]
    assert jobs(path, read_scene(path, {})) == [
        Job("[fuse]", [*python, "fuse", str(path)], lasting=True),
        Job("cam1", [*python, "observe", str(path), "cam1"]),
        Job("cam2", [*python, "observe", str(path), "cam2"]),
    ]


def write_scene(folder, mesh, more=""):
    (folder / "scene.toml").write_text(f'scene = "d"\n[mesh]\n{mesh}\n[observers.cam1]\nsource = "a.npz"\n{more}')
    return folder / "scene.toml"


def test_recordings_that_are_played_in_real_time_are_awaited(tmp_path):
    others = (
        'cam2]\nsource = "film.mp4"',
        'live]\nsource = "0"',
        'fast]\nsource = "f.mp4"\nspeed = 0.0',
        'sent]\nsource = "-"',
    )
    more = "".join(f"[observers.{other}\n" for other in others)
    barrier = open_start_barrier(tmp_path, read_scene(write_scene(tmp_path, 'mode = "machine"', more), {}))
    assert {path.name for path in barrier.iterdir()} == {"cam1.awaited", "cam2.awaited"}


@pytest.mark.parametrize(
    ("mesh", "line"),
    [
        ('mode = "process"', r"mesh\.mode = 'process': several processes cannot meet"),
        # TEST-NET-1 belongs to nobody.
        ('endpoint = "tcp/192.0.2.1:7447"', "not an address of this machine; write"),
    ],
)
def test_an_address_where_processes_cannot_meet_is_one_line(tmp_path, monkeypatch, mesh, line):
    monkeypatch.setattr("deploy.commands.PORT_TIMEOUT_S", 0.0)
    with pytest.raises(LabanmeshError, match=line):
        up(write_scene(tmp_path, mesh))


def taken_after_a_free_port():
    """A server whose port follows a free one: other tests on this machine take ports too."""
    while True:
        server = socket.create_server(("127.0.0.1", 0))
        try:
            socket.create_server(("127.0.0.1", server.getsockname()[1] - 1)).close()
        except OSError:
            server.close()
        else:
            return server


@pytest.mark.parametrize(
    ("mesh", "more", "key"),
    [
        ('endpoint = "tcp/127.0.0.1:{port}"', "", "mesh.endpoint = 'tcp/127.0.0.1:{port}'"),
        ('mode = "router"', '[metrics]\nlisten = "127.0.0.1:{before}"', "metrics.listen = '127.0.0.1:{port}'"),
        ('mode = "router"', '[hub]\nstart = ["dashboard"]\n[hub.dashboard]\nlisten = "127.0.0.1:{port}"',
         "hub.dashboard.listen = '127.0.0.1:{port}'"),
    ],
)  # fmt: skip
def test_a_port_that_is_taken_ends_it_with_one_line(tmp_path, monkeypatch, mesh, more, key):
    monkeypatch.setattr("deploy.commands.PORT_TIMEOUT_S", 0.2)
    with taken_after_a_free_port() as taken:
        port = taken.getsockname()[1]
        # Each process has a port for its metrics: the second one's is taken.
        path = write_scene(tmp_path, mesh.format(port=port), more.format(port=port, before=port - 1))
        with pytest.raises(LabanmeshError) as caught:
            up(path)
    line, by = str(caught.value), f"PID {os.getpid()} (" if Path("/proc/net/tcp").exists() else "taken"
    assert caught.value.exit_status == 1 and "\n" not in line
    assert line.startswith(key.format(port=port)) and f"port {port} is taken by {by}" in line
    assert line.endswith("stop that program, or choose another port")


def test_a_port_that_becomes_free_is_waited_for(tmp_path):
    """A killed launcher's processes end by themselves a moment later."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        scene = read_scene(write_scene(tmp_path, f'endpoint = "tcp/127.0.0.1:{taken.getsockname()[1]}"'), {})
        timer = threading.Timer(0.2, taken.close)
        timer.start()
        require_free_ports(scene, 2)
        timer.join()
