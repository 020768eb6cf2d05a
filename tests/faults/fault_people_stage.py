"""The processes that see and judge two SIMULATED people, to be made to fail, and a witness of what is published."""

import sys

import fault_people
from fault_people import APART_NS, CYCLE_NS, LABELS, MOVES_NS, OBSERVERS, PEOPLE, label_of
from fault_processes import Process
from fault_stage import SERVICES, Movement, ProcessStage
from processes import labanmesh

from benchmarks.timing import free_port


def performed(person, from_ns, until_ns):
    """The movements of a person that lie wholly between two times."""
    first = (from_ns - APART_NS[person]) // CYCLE_NS
    movements = []
    for number in range(first, (until_ns - APART_NS[person]) // CYCLE_NS + 1):
        began_ns = number * CYCLE_NS + APART_NS[person]
        if from_ns <= began_ns and began_ns + MOVES_NS <= until_ns:
            movements.append(Movement(label_of(person, number), began_ns, began_ns + MOVES_NS))
    return movements


class PeopleStage(ProcessStage):
    """A router, two fusion services, a hub, three observers and a witness; a context manager that ends them all.
    secured: with certificates. lie: what the last observer does."""

    def __init__(self, folder, *, secured=False, lie=None, extra=""):
        super().__init__(folder, secured)
        self.port = free_port()
        self.endpoint = f"{'tls' if secured else 'tcp'}/127.0.0.1:{self.port}"
        self.file = self.write("scene.toml", self.endpoint, extra)
        if secured:
            machines = {"router": (), "hub": ("--hub",)} | {name: ("--fusion", name) for name in SERVICES}
            machines |= {name: ("--observer", f"dojo/{name}") for name in OBSERVERS}
            self.certify(self.file, machines)
        router = ("router", "--scene", self.file) if secured else ("router", self.endpoint)
        self.processes = {"router": Process(labanmesh(*router), environment=self.environment("router"))}
        for name in SERVICES:
            self.processes[name] = self.service(name, self.file)
        self.processes["hub"] = Process(labanmesh("watch", self.file, "--json"), environment=self.environment("hub"))
        for name in OBSERVERS:
            self.processes[name] = self.observer(name, self.file, *([lie] if lie and name == OBSERVERS[-1] else []))

    def write(self, name, endpoint, extra=""):
        """A scene file of this stage that meets at `endpoint`."""
        labels, names = (", ".join(f'"{each}"' for each in some) for some in (LABELS, PEOPLE))
        credentials = 'credentials = "secure/hub.1"\n' if self._secured else ""
        observers = "".join(f'[observers.{each}]\nsource = "m.npz"\n' for each in OBSERVERS)
        place = self.folder / name
        place.write_text(
            f'scene = "dojo"\nvocabulary = [{labels}]\n[mesh]\nmode = "router"\nendpoint = "{endpoint}"\n{credentials}'
            f"[people]\nmost = {len(PEOPLE)}\nnames = [{names}]\n{observers}"
            f'[fusion]\nid = "{SERVICES[0]}"\nstandby = ["{SERVICES[1]}"]\n{extra}\n'
        )
        return place

    def service(self, name, file):
        """The process of a fusion service."""
        return Process(labanmesh("fuse", file, "--id", name), environment=self.environment(name))

    def observer(self, name, file, *lie):
        """The process of an observer."""
        command = [sys.executable, fault_people.__file__, str(file), name, *lie]
        return Process(command, environment=self.environment(name))


def of(person, messages):
    """The messages about one person."""
    return [message for message in messages if message.get("person") == person]


def both_count(witness, observers=OBSERVERS):
    """Whether the votes of these observers count for both people in their newest judgements."""
    last = {person: (of(person, witness.judgements) or [{"votes": {}}])[-1]["votes"] for person in PEOPLE}
    return all(votes.get(name, {}).get("state") == "counted" for votes in last.values() for name in observers)
