"""A scene to be attacked: several scenes in one fusion service, their observers, and a standby service. `Village` runs
the services in this process, `Dojo` as processes of their own behind a router; both are used alike. The attacker, and
the witness of what is published, are in attack_session.py."""

import json
import sys
import threading
import time
import traceback
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

from attack_history import History
from attack_judges import Judges
from attack_person import VIEWS
from attack_session import Attacker, Witness
from fault_processes import Process
from fault_stage import START
from mqtt_stage import Broker, mosquitto
from processes import SOON_S, labanmesh, until

from benchmarks.timing import free_port
from common import SECOND_NS
from common.config import MeshConfig, read_scene
from common.link import Link
from fusion.server import serve
from labanmesh_testing.mesh import Mesh
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive

HERE = Path(__file__).parent
SCENES = 10
"""More than a service fuses event by event (fusion.server.FEW_SCENES)."""
JUDGES = tuple(VIEWS)
SECOND = "second"
ASK_CLOCKS_S = 0.1
"""In this process a service of many scenes compares clocks so often; else once a minute."""
SENT_S = 120.0
"""Filling and sending 900 MB takes a busy machine more than half a minute."""
LONGEST_GAP_S = 0.2
"""Between two judgements of a scene, whatever the attack; threads of one process on a busy machine need more."""


class _Stage:
    """What both stages share. names: the scenes; the first has a standby service. history: of the present attack."""

    def __init__(self, folder, scenes):
        self.folder, self._open, self._leaving = folder, ExitStack(), ExitStack()
        self.history = History("stage", 0)
        self.names = [f"dojo{n}" for n in range(scenes)]
        self.scenes, self._more = [], []

    def _write(self, mode, endpoint, vocabulary, rate_hz=10):
        place = self.folder / "scenes"
        place.mkdir(exist_ok=True)
        for n, name in enumerate(self.names):
            lines = [f'scene = "{name}"', f"vocabulary = {json.dumps(list(vocabulary.labels))}"]
            lines += ["[mesh]", f'mode = "{mode}"', f'endpoint = "{endpoint}"', "[fusion]", f"step_hz = {rate_hz}"]
            lines += [f'standby = ["{SECOND}"]'] if n == 0 else []
            for judge in JUDGES:
                lines += [f"[observers.{judge}]", 'source = "../seen.npz"', f'model = "../{judge}.model"']
                lines += [f'view = "{VIEWS[judge]}"', "loop = true"]
            (place / f"{name}.toml").write_text("\n".join([*lines, *self._more]) + "\n")
        self.scenes = [read_scene(place / f"{name}.toml", {}) for name in self.names]

    @contextmanager
    def attacked(self, history):
        """One attack, noted in `history`; its attackers leave at its end."""
        self.history = history
        with ExitStack() as self._leaving:
            try:
                yield self
            except BaseException as error:
                history.note("fault", fault=f"{type(error).__name__}: {error}"[:2000])
                raise
            finally:
                history.note("end", memory_kb=self.memory_kb())

    def attacker(self):
        """One more attacker."""
        attacker = Attacker(self.endpoint, self.history, self.attacker_mode)
        self._leaving.callback(attacker.close)
        return attacker

    def link(self):
        """A link of a hub; a context manager."""
        return Link.open(self.scenes[0].mesh, "hub")

    def flood(self, key, size, per_s=0.0, for_s=0.0, congestion="drop"):
        """An attacker in a process of its own that sends so many messages of `size` bytes; waits for its end."""
        words = (self.endpoint, self.attacker_mode, key, size, per_s, for_s, congestion)
        process = Process([sys.executable, str(HERE / "attack_peers.py"), *map(str, words)])
        try:
            process.start().wait_for("sent ", timeout_s=for_s + SENT_S)
            self.history.note("flood", key=key, bytes=size, per_s=per_s, for_s=for_s, log=process.log.strip())
        finally:
            process.kill()

    def gaps(self, since_ns):
        """By scene the longest time without a judgement since then; every scene is judged once more."""
        self.await_judgements(0.0)
        gaps = {name: self.witness.longest_gap_s(name, since_ns) for name in self.names}
        self.history.note("gaps", **gaps)
        return gaps

    def _open_witness(self):
        return Witness(self._open.enter_context(closing(Attacker(self.endpoint, self.history, self.attacker_mode))))

    def await_judgements(self, for_s):
        """Until every scene was judged by what was captured so much later."""
        at_ns = time.time_ns() + round(for_s * SECOND_NS)
        until(lambda: all(self.witness.last(name).at_ns > at_ns for name in self.names))

    def until_all_count(self, judges=JUDGES):
        """Wait until all judges count in every scene."""
        until(lambda: all(self.all_count(name, judges) for name in self.names))

    def wait_for_state(self, scene, judge, *states):
        """Wait until the vote of a judge has one of these states."""
        until(lambda: self.witness.states(scene).get(judge) in states)

    def all_count(self, scene, judges=JUDGES):
        states = self.witness.states(scene)
        return all(states.get(judge) == "counted" for judge in judges)

    def close(self):
        self._open.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class Village(_Stage):
    """All in this process: real Zenoh sessions, services in threads, judges that publish what they are told."""

    attacker_mode, longest_gap_s, longest_flooded_s = "peer", 2.0, 2.0

    def __init__(self, person, folder, scenes=SCENES):
        super().__init__(folder, scenes)
        self.person, self.mesh = person, Mesh(MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0"))
        self._open.callback(self.mesh.close)
        self.endpoint = self.mesh.config.endpoint
        self._write("process", self.endpoint, person.vocabulary)
        self.witness = self._open_witness()
        self.judges = Judges(self.mesh.peer("observer"), self.scenes, person, JUDGES)
        self.mesh.run(self.judges.publish)
        self.faults = []
        for own, served in (("fusion", self.scenes), (SECOND, self.scenes[:1])):
            self.mesh.run(self._serve, served, own, self.mesh.peer("standby"))

    def _serve(self, scenes, own, link, stop):
        try:
            serve(scenes, own, link, stop)
        except BaseException as error:
            self.faults.append((own, "".join(traceback.format_exception(error))))
            self.history.note("died", process=own, fault=self.faults[-1][1])
            raise

    def alive(self):
        """Whether no service has ended."""
        return not self.faults

    def memory_kb(self):
        """Of this process alone there is no figure."""
        return {}


class Dojo(_Stage):
    """Real processes behind a router; the first scene's judges are observers that see the person. The other scenes'
    judges publish from this process."""

    attacker_mode, longest_gap_s, longest_flooded_s = "client", LONGEST_GAP_S, 2.0

    def __init__(self, person, folder, scenes=SCENES):
        super().__init__(folder, scenes)
        self.person, self.faults, self.endpoint = person, (), f"tcp/127.0.0.1:{free_port()}"
        self._broker = None
        if mosquitto():
            self._broker = self._open.enter_context(Broker(folder / "broker"))
            self._more += ["[hub.mqtt]", f"port = {self._broker.port}"]
        self._write("router", self.endpoint, person.vocabulary)
        for judge in JUDGES:
            write_model(folder / f"{judge}.model", person.models[judge])
        write_archive(folder / "seen.npz", MotionArchive(person.body_parts, (person.stream,)))
        files = [folder / "scenes" / f"{name}.toml" for name in self.names]
        commands = {"router": ("router", self.endpoint), "fusion": ("fuse", *files)}
        commands |= {SECOND: ("fuse", files[0], "--id", SECOND)}
        commands |= {judge: ("observe", files[0], judge) for judge in JUDGES}
        commands |= self.hub_commands("kept")
        self.processes = {name: Process(labanmesh(*words)) for name, words in commands.items()}
        self._open.callback(self._kill)
        self._start()

    def _start(self):
        self.processes["router"].start()
        self.processes["router"].wait_for("listening on")
        self.start_ns = time.time_ns() + 2 * SECOND_NS
        for name, process in self.processes.items():
            if name != "router":
                process.start(**{START: str(self.start_ns)})
        self.witness = self._open_witness()
        link = self._open.enter_context(Link.open(self.scenes[0].mesh, "observer"))
        self.judges = Judges(link, self.scenes[1:], self.person, JUDGES)
        stop = threading.Event()
        talking = threading.Thread(target=self.judges.publish, args=(stop,), daemon=True)
        talking.start()
        self._open.callback(talking.join, SOON_S)
        self._open.callback(stop.set)

    def hub_commands(self, name, scene=0):
        """By kind the words of a hub of one scene; MQTT only where there is a broker. name: of its files."""
        file = self.folder / "scenes" / f"{self.names[scene]}.toml"
        commands = {
            "watch": ("watch", file, "--json"),
            "capture": ("capture", file, "-o", self.folder / f"{name}.mcap"),
            "dashboard": ("dashboard", file, "--listen", f"127.0.0.1:{free_port()}"),
        }
        return commands | ({"mqtt": ("hub", "mqtt", file)} if self._broker else {})

    def start(self, name, *words):
        """One more process, or one of them again."""
        if words:
            self.processes[name] = Process(labanmesh(*words))
        self.history.note("start", process=name)
        # It falls in with the film where it began last.
        length_ns = len(self.person.stream.positions) * SECOND_NS // int(self.person.stream.rate_hz)
        rounds = max((time.time_ns() - self.start_ns) // length_ns, 0)
        return self.processes[name].start(**{START: str(self.start_ns + rounds * length_ns)})

    def _kill(self):
        for name, process in self.processes.items():
            self.history.note("log", process=name, tail=process.log[-800:])
            process.kill()

    def alive(self):
        """Whether every process that was started is there."""
        return all(process.running for process in self.processes.values())

    def memory_kb(self):
        """Resident memory of each process."""
        return {name: process.rss_kb for name, process in self.processes.items() if process.running}
