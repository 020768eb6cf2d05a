"""The tutorial's own commands, in the order of the page, and the output that the page shows."""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import SOON_S, until

from common.config import MeshConfig
from common.link import Link
from labanmesh import main

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "tutorial.md"
BLOCK = re.compile(r"(?P<before>[^\n]*\n\s*)```(?P<language>\w+)\n(?P<text>.*?)```", re.DOTALL)
QUICK = [["labanmesh", verb] for verb in ("learn", "evaluate", "replay")]
"""They run in this process: each start of one takes half a second of a processor, and the page has nine."""


class Reader:
    """The reader of the page: types its commands into one terminal, and those that keep running into a second."""

    def __init__(self, folder: Path, capsys):
        self._capsys = capsys
        with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as free:
            endpoint = free.locator
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        self._where = {"cwd": folder, "env": {**os.environ, "PATH": path, "LABANMESH_MESH_ENDPOINT": endpoint}}
        self._folder = folder
        self._second: list[tuple[str, subprocess.Popen, Path]] = []
        self.output = ""
        self.seconds: dict[str, float] = {}

    def save(self, name, text):
        (self._folder / name).write_text(text)

    def type_in(self, command):
        begin_s = time.monotonic()
        words = shlex.split(command)
        status, output = (self._call if words[:2] in QUICK else self._run)(words)
        assert status == 0, f"{command}: status {status}\n{output}"
        self.output += output
        self.end_second_terminal()
        self.seconds[f"{len(self.seconds) + 1:2d} {command}"] = time.monotonic() - begin_s

    def _run(self, words):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        done = subprocess.run(words, **self._where, **pipes, timeout=SOON_S)
        return done.returncode, done.stdout

    def _call(self, words):
        with contextlib.chdir(self._folder):
            status = main(words[1:])
        return status, "".join(self._capsys.readouterr())

    def type_into_second_terminal(self, command):
        words = shlex.split(command)
        log = self._folder / f"terminal-{len(self.seconds)}.log"
        with log.open("w") as stream:
            process = subprocess.Popen(words, **self._where, stdout=stream, stderr=subprocess.STDOUT)
        self._second.append((command, process, log))
        if "-o" in words:
            written = self._folder / words[words.index("-o") + 1]
            until(lambda: written.exists() or process.poll() is not None)

    def end_second_terminal(self):
        for command, process, log in self._second:
            process.send_signal(signal.SIGINT)
            assert process.wait(SOON_S) in (0, 130), f"{command}: status {process.returncode}\n{log.read_text()}"
            self.output += log.read_text()
        self._second.clear()

    def close(self):
        for _, process, _ in self._second:
            process.kill()
            process.wait()


def plain(text):
    """Numbers become #, and runs of blanks one: what stays the same from one run to the next."""
    return re.sub(r"[ \t]+", " ", re.sub(r"[+-]?\d+(\.\d+)?", "#", text))


@pytest.fixture
def reader(tmp_path, capsys):
    reader = Reader(tmp_path, capsys)
    yield reader
    reader.close()


@pytest.mark.timeout(600)
def test_every_command_of_the_tutorial_works_and_prints_what_the_page_shows(reader):
    for block in BLOCK.finditer(PAGE.read_text("utf-8")):
        before, language, text = block["before"].strip(), block["language"], block["text"]
        if before == "<!-- skip -->":
            continue
        if language == "sh":
            in_second = before == "<!-- second terminal -->"
            for command in text.splitlines():
                (reader.type_into_second_terminal if in_second else reader.type_in)(command)
        elif language == "text":
            assert not re.search(r"(?i)warning|traceback", reader.output), reader.output
            for line in text.splitlines():
                assert plain(line).strip() in plain(reader.output), f"the page shows: {line}\nbut:\n{reader.output}"
            reader.output = ""
        else:
            (name,) = re.findall(r"Save this as \*\*([\w.]+)\*\*", before)
            reader.save(name, text)
    for command, seconds in reader.seconds.items():
        print(f"{seconds:5.1f} s  {command}")
    assert len(reader.seconds) > 10, "the page has lost its commands"
