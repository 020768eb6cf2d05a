"""A scene to be made to fail: a known performance that loops, real processes, and a witness that records messages. The
performance is the synthetic performer's, so that what was done, and when, is known to the frame; observers see it
through the `projected` tracker, which needs no picture."""

import io
import json
import math
import os
import sys
import time
from contextlib import redirect_stdout
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest
from fault_hearing import is_unheard
from fault_processes import SOON_S, Process
from once import made_once
from processes import labanmesh

import labanmesh as command_line
from benchmarks.timing import free_port
from common import SECOND_NS
from common.config_sections import default_quorum
from common.vocabulary import ABSTAIN, Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously

HERE = Path(__file__).parent
LONG = os.environ.get("LABANMESH_FAULTS") == "long"
LONG_FORM = pytest.mark.skipif(not LONG, reason="the long form: make faults")
"""A mark, so that no fixture learns or starts processes for a test that is skipped."""
MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
SERVICES = ("first", "second")
VIEWS = {"door": "door", "corner": "yaw:45", "wheel": "wheel"}
REST_S = (2.0, 2.6)
"""Between two movements, shortest and longest: a router that is away for a second must not hide a whole rest."""
START = "LABANMESH_PLAYBACK_START_NS"
BEGIN_S = 1.5
"""From the start of the processes to that of the performance."""
SETTLE_S = 1.5
"""After its end a movement's last verdict is due within this: rest must last for hold_s."""


@dataclass(frozen=True, slots=True)
class Movement:
    """One movement as it was performed (Unix epoch, ns)."""

    label: str
    began_ns: int
    ended_ns: int


class Replay:
    """The performance on disk with one model a view, and what is done in it."""

    def __init__(self, tmp_path_factory):
        self._recording = perform_continuously("1", MOVEMENTS, rest_s=REST_S)
        self.folder = made_once(tmp_path_factory, "replay", self._fill)
        self.length_ns = round(len(self._recording.positions) / self._recording.rate_hz * SECOND_NS)

    def _fill(self, folder):
        learned = perform(("2", "3", "4"), MOVEMENTS, trials=2)
        for observer, view in VIEWS.items():
            model = learn_view(learned, parse_view(view), Vocabulary(MOVEMENTS), kind="phase")
            write_model(folder / f"{observer}.model", model)
        write_archive(folder / "seen.npz", MotionArchive(learned.body_parts, (self._recording,)))

    def performed(self, start_ns, from_ns, until_ns):
        """The movements that lie wholly between two times, when it was started at `start_ns` and loops."""
        rate_hz = self._recording.rate_hz
        first = max((from_ns - start_ns) // self.length_ns, 0)
        last = (until_ns - start_ns) // self.length_ns
        rounds = (start_ns + n * self.length_ns for n in range(first, last + 1))
        whole = (
            Movement(s.label, at + round(s.start / rate_hz * 1e9), at + round(s.end / rate_hz * 1e9))
            for at in rounds
            for s in self._recording.spans
        )
        return [one for one in whole if from_ns <= one.began_ns and one.ended_ns <= until_ns]


SCENE = "dojo"
"""The name of the scene, or of the first of several."""


class Witness:
    """A hub process; what it received, in order: lists of messages with `arrived_ns`. others: by name of a further
    scene of a folder, its judgements and verdicts, by kind. watches: it is `labanmesh watch`, which asks for the
    verdicts that it has missed; else a bare peer, which receives only what is published."""

    def __init__(self, scene_file, inside=(), environment=None, watches=False):
        command = [sys.executable, str(HERE / "fault_peers.py"), "witness", str(scene_file)]
        if watches:
            command = labanmesh("watch", scene_file, "--json")
        self._watches = watches
        self.process, self._read = Process(command, inside, environment), 0
        self.messages = {"judgement": [], "verdict": [], "status": []}
        self.judgements, self.verdicts, self.statuses = self.messages.values()
        self.others = {}

    def start(self):
        self.process.start()
        self.process.wait_for('"scene"' if self._watches else '"listening"')
        return self

    def look(self):
        """Take in what it has written since."""
        lines = self.process.lines_from(self._read)
        self._read += len(lines)
        for line in lines:
            if self._watches and not line.startswith("{"):
                continue  # for people
            try:
                record = json.loads(line)
            except ValueError:
                raise AssertionError(f"the witness wrote {line!r}") from None
            if "message" not in record:  # of watch, which prints the message alone
                record = {"kind": record["kind"], "arrived_ns": time.time_ns(), "message": record}
            if record["kind"] != "listening":
                self._of(record["message"]["scene"])[record["kind"]].append(
                    {**record["message"], "arrived_ns": record["arrived_ns"]}
                )

    def _of(self, scene):
        if scene == SCENE:
            return self.messages
        return self.others.setdefault(scene, {"judgement": [], "verdict": [], "status": []})

    @property
    def last(self):
        """The last judgement; one of 1970 while there was none."""
        return self.judgements[-1] if self.judgements else {"at_ns": 0, "arrived_ns": 0, "fusion": "", "votes": {}}

    def wait_for(self, condition, timeout_s=SOON_S, why=""):
        """Until `condition(self)` is true; returns its value."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            self.look()
            if value := condition(self):
                return value
            self.process.wait_for_more(self._read, deadline - time.monotonic())
        last = self.judgements[-1:] or self.process.log[-2000:]
        raise AssertionError(f"not within {timeout_s} s: {why or condition}; the last judgement: {last}")


class ProcessStage:
    """Processes that are met through a router, the first of `processes`, and witnesses. A context manager that ends
    them all; `file` is the scene file."""

    def __init__(self, folder, secured=False):
        self.folder, self._secured = folder, secured
        self.processes, self._witnesses = {}, []

    def certify(self, place, machines):
        """An authority for the scenes at `place`, and a certificate for each machine with its rights."""
        for words in (("init",), *(("add", name, *rights) for name, rights in machines.items())):
            with redirect_stdout(io.StringIO()):
                assert command_line.main(["secure", words[0], str(place), *words[1:]]) == 0

    def environment(self, certificate):
        """What a process needs in a secured mesh."""
        place = self.folder / "secure" / f"{certificate}.1"
        return {"LABANMESH_MESH_CREDENTIALS": str(place)} if self._secured else {}

    def play(self):
        """Start all processes, the router first."""
        self.start("router")
        self.processes["router"].wait_for("listening on")
        self.begin()
        for name in self.processes:
            if name != "router":
                self.start(name)

    def begin(self):
        """The router is there, and the others are started now."""

    def start(self, name):
        """Start one process."""
        self.processes[name].start()

    def witness(self, inside=(), scene_file=None, watches=False):
        """A started witness; the router must be there."""
        one = Witness(scene_file or self.file, inside, self.environment("hub"), watches)
        self._witnesses.append(one)
        return one.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in (*self.processes.values(), *(one.process for one in self._witnesses)):
            process.kill()

    def waited_s(self, *names):
        """How long these processes, or all, have waited for a processor so far, together."""
        return sum(self.processes[name].waited_s for name in names or self.processes)

    def logs(self, most=1500):
        """What all have written, for a message; most: characters of each, the last ones; None: all."""
        return "\n".join(
            f"--- {name}\n{process.log[-most if most else 0 :]}"
            for name, process in self.processes.items()
            if name != "hub"
        )


class Stage(ProcessStage):
    """The processes of one scene with a performance. inside: for each process name, what puts it into a host; where the
    router listens follows `address`."""

    def __init__(
        self, replay, folder, *, fusions=("fusion",), address="127.0.0.1", inside=None, extra="",
        observers=tuple(VIEWS), secured=False,
    ):  # fmt: skip
        super().__init__(folder, secured)
        self.replay, self._observers, self._inside = replay, observers, inside or {}
        self.port = free_port() if address == "127.0.0.1" else 7447
        self.endpoint = f"tcp/{address}:{self.port}"
        self.file = self.write("scene.toml", self.endpoint, fusions, extra)
        self.processes = {"router": Process(labanmesh("router", self.endpoint), self._inside.get("router", ()))}
        commands = {name: ("fuse", self.file, *(() if name == fusions[0] else ("--id", name))) for name in fusions}
        for name, words in (commands | {name: ("observe", self.file, name) for name in VIEWS}).items():
            self.processes[name] = Process(labanmesh(*words), self._inside.get(name, ()))
        self.start_ns, self._shifts = 0, {}

    def write(self, name, endpoint, fusions=("fusion",), extra="", scene=SCENE, credentials=""):
        """A scene file of this stage that meets at `endpoint`."""
        standby = ", ".join(f'"{one}"' for one in fusions[1:])
        labels = ", ".join(f'"{label}"' for label in MOVEMENTS)
        lines = [f'scene = "{scene}"', f"vocabulary = [{labels}]"]
        lines += ["[mesh]", 'mode = "router"', f'endpoint = "{endpoint}"', f'credentials = "{credentials}"']
        lines += ["[fusion]", f'id = "{fusions[0]}"', *([f"standby = [{standby}]"] if standby else []), extra]
        for observer in self._observers:
            lines += [f"[observers.{observer}]", f'source = "{self.replay.folder / "seen.npz"}"']
            lines += [f'view = "{VIEWS.get(observer, "door")}"']
            lines += [f'model = "{self.replay.folder / observer}.model"', "loop = true"]
        place = self.folder / name
        place.write_text("\n".join(lines) + "\n")
        return place

    def begin(self):
        """The performance begins a moment from now."""
        self.start_ns = time.time_ns() + round(BEGIN_S * SECOND_NS)

    def start(self, name):
        """Start one process; an observer falls in with the performance at its last beginning."""
        rounds = max((time.time_ns() - self.start_ns) // self.replay.length_ns, 0) if self.start_ns else 0
        begin_ns = self.start_ns + rounds * self.replay.length_ns + round(self._shifts.get(name, 0.0) * SECOND_NS)
        self.processes[name].start(**{START: str(begin_ns)})

    def with_clock(self, name, shift_s, *later_s):
        """Let a process that has not been started live by a clock that is `shift_s` ahead; each SIGUSR1 sets it anew.
        later_s: how far it is ahead then, one after the other."""
        self._shifts[name] = shift_s
        process = self.processes[name]
        where = process.command.index("labanmesh")
        shifts = ",".join(map(str, (shift_s, *later_s)))
        process.command[where - 1 : where + 1] = [str(HERE / "fault_odd_clock.py"), shifts]


@dataclass(frozen=True, slots=True)
class Tally:
    """The verdicts on each performed movement: `ids` of them by movement; labels and stages by id."""

    performed: list
    ids: list
    labels: dict
    stages: dict

    @property
    def complete(self):
        """Whether each movement has a verdict that has ended."""
        return all(any("ended" in self.stages[one] for one in ids) for ids in self.ids)

    @property
    def faults(self):
        """What is wrong, movement by movement: no verdict, several, another label at the end, a stage twice."""
        faults = []
        for movement, ids in zip(self.performed, self.ids, strict=True):
            if len(ids) != 1:
                faults.append((movement, f"has {len(ids)} verdicts {ids}"))
            elif self.labels[ids[0]] != movement.label:
                faults.append((movement, f"is {self.labels[ids[0]]}"))
            elif len(self.stages[ids[0]]) != len(set(self.stages[ids[0]])):
                faults.append((movement, f"was published as {self.stages[ids[0]]}"))
        return faults

    def explained(self, events):
        """The faults, with what had happened shortly before or during them; events: (when in ns, what)."""
        lines = []
        for movement, fault in self.faults:
            span = (movement.began_ns - 2 * SECOND_NS, movement.ended_ns + SECOND_NS)
            near = [(name, round((at - movement.began_ns) / 1e9, 2)) for at, name in events if span[0] < at < span[1]]
            length_s = (movement.ended_ns - movement.began_ns) / SECOND_NS
            lines.append(f"{movement.label} ({length_s:.1f} s long): {fault}; seconds after its beginning: {near}")
        return "\n".join(lines)


def tally(performed, verdicts):
    """Compares the received verdicts with what was performed."""
    labels, stages, spans = {}, {}, {}
    for verdict in verdicts:
        name, ended = verdict["id"], verdict["ended_ns"]
        if stages.get(name, [""])[-1] == verdict["stage"] and labels[name] == verdict["label"]:
            continue  # sent again after a lost connection: hubs ignore the second of two equal verdicts
        labels[name] = verdict["label"]
        stages.setdefault(name, []).append(verdict["stage"])
        spans[name] = (verdict["began_ns"], ended or verdict["decided_ns"])
    ids = [[] for _ in performed]
    for name, (began, ended) in sorted(spans.items(), key=lambda item: item[1]):
        shares = [min(ended, one.ended_ns) - max(began, one.began_ns) for one in performed]
        best = max(range(len(shares)), key=shares.__getitem__, default=None)
        if best is not None and shares[best] > 0:
            ids[best].append(name)
    return Tally(list(performed), ids, labels, stages)


def judged(stage, witness, movements, since_ns=None, *, lossy=False):
    """Asserts that the next so many movements, from now or `since_ns`, have one verdict each, with their label. lossy:
    a movement in which fewer observers counted than must agree may also end undecided."""
    since_ns = since_ns or time.time_ns()
    performed = stage.replay.performed(stage.start_ns, since_ns, since_ns + (movements + 4) * stage.replay.length_ns)
    performed = performed[:movements]
    due_ns = performed[-1].ended_ns + round(SETTLE_S * SECOND_NS)

    def over(witness):
        return tally(performed, witness.verdicts).complete or witness.last["at_ns"] > due_ns

    witness.wait_for(over, (due_ns - since_ns) / SECOND_NS + SOON_S, "the movements are judged")
    if lossy:
        performed = [one for one in performed if not abstained_without_quorum(one, witness)]
    result = tally(performed, witness.verdicts)
    assert not result.faults, f"{result.explained(())}\n{stage.logs()}"


def abstained_without_quorum(movement, witness):
    """Whether its one verdict is an abstention, and too few observers to agree counted for a good part of it."""
    result = tally([movement], witness.verdicts)
    heard = [{**one, "agreement": {"n": sum(counted(one, name) for name in VIEWS)}} for one in witness.judgements]
    undecided = [result.labels[one] for one in result.ids[0]] == [ABSTAIN]
    return undecided and is_unheard(movement, heard, default_quorum(len(VIEWS)))


def all_count(witness):
    """Whether the votes of all observers count in full now."""
    return counted(witness.last, *VIEWS)


def counted(judgement, *observers):
    """Whether the votes of all these observers count in full in a judgement."""
    return all(judgement["votes"].get(one, {}).get("state") == "counted" for one in observers)


def longest_gap_s(times_ns):
    """The longest time between two neighbours."""
    return max((b - a for a, b in pairwise(times_ns)), default=math.inf) / SECOND_NS
