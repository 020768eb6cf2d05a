"""Strangers at the page: ten thousand idle connections, no descriptors left. The page answers, judging goes on. What
costs nothing of it is in tests/hub/dashboard/test_dashboard_strangers.py and tests/common/test_health_server.py."""

import re
import subprocess
import sys
import time

import httpx
import pytest
from fault_processes import Process
from processes import SOON_S, labanmesh
from test_floods import MOST_KB, Sizes

from common import SECOND_NS

CROWD = """
import resource, socket, sys
port, count = map(int, sys.argv[1:])
resource.setrlimit(resource.RLIMIT_NOFILE, (min(count + 100, resource.getrlimit(resource.RLIMIT_NOFILE)[1]),) * 2)
kept = []
for n in range(count):
    try:
        kept.append(socket.create_connection(("127.0.0.1", port), 5))
    except OSError:
        pass
    if n % 500 == 499 or n == count - 1:
        print(n + 1, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def dashboard(stage, long_form):
    """Starts a dashboard of the first scene, with at most so many descriptors; gives it and its port."""
    if not long_form:
        pytest.skip("needs a process of its own")

    def start(descriptors):
        words = stage.hub_commands("crowded")["dashboard"]
        process = Process(["bash", "-c", f'ulimit -n {descriptors}; exec "$@"', "-", *labanmesh(*words)]).start()
        stage.processes["crowded"] = process
        process.wait_for("shows scene")
        return process, int(re.search(r"http://127\.0\.0\.1:(\d+)/", process.log)[1])

    yield start
    stage.processes.pop("crowded").kill()


@pytest.mark.parametrize(("descriptors", "connections"), [(1024, 10_000), (4096, 10_000), (80, 1000)])
def test_idle_connections_keep_nobody_out(stage, dashboard, descriptors, connections):
    process, port = dashboard(descriptors)
    since_ns, answered_s, lines = time.time_ns(), [], process.lines
    command = [sys.executable, "-c", CROWD, str(port), str(connections)]
    with (
        Sizes(stage) as sizes,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as crowd,
    ):
        before_s = {name: (each.cpu_s, each.waited_s) for name, each in stage.processes.items()}
        for _ in iter(crowd.stdout.readline, f"{connections}\n"):
            begun_s = time.monotonic()
            assert httpx.get(f"http://127.0.0.1:{port}/", timeout=SOON_S).status_code == 200
            answered_s.append(time.monotonic() - begun_s)
        cpu_s = {name: round(each.cpu_s - before_s[name][0], 2) for name, each in stage.processes.items()}
        waited_s = {name: round(each.waited_s - before_s[name][1], 2) for name, each in stage.processes.items()}
        crowd.stdin.close()
    gaps = stage.gaps(since_ns)
    took_s = (time.time_ns() - since_ns) / SECOND_NS
    print(
        f"{took_s:.1f} s; processor time {cpu_s}; waited for it {waited_s}; longest gap {max(gaps.values()):.2f} s, "
        f"answer {max(answered_s):.2f} s"
    )
    stage.history.note(
        "answered", seconds=answered_s, cpu_s=cpu_s, waited_s=waited_s, most=sizes.most_kb, log=process.log[-2000:]
    )
    assert max(gaps.values()) <= stage.longest_flooded_s, gaps
    assert max(sizes.most_kb.values()) < MOST_KB, sizes.most_kb
    assert process.lines - lines <= 20, process.log
