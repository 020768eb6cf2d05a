"""A stage of one scene or many, plain or secured: a router, two fusion services, three observers, a hub. The first
scene has real observers; `attack_echo.py` publishes what they do in the other scenes too. One scene has a standby
service, many are shared by the two services."""

import sys
from contextlib import ExitStack
from pathlib import Path

from attack_listeners import listeners
from fault_processes import Process
from fault_slow_line import SlowLine
from fault_stage import SCENE, SERVICES, VIEWS, Stage
from processes import labanmesh

HERE = Path(__file__).parent
ECHO = "echo"


class Fleet(Stage):
    """scenes: how many; secured: certificates for each process, and the router's access rules."""

    def __init__(self, replay, folder, *, scenes=1, secured=False):
        super().__init__(replay, folder, fusions=SERVICES, secured=secured)
        self.scenes = [SCENE, *(f"{SCENE}{n}" for n in range(1, scenes))]
        if secured:
            self.endpoint = f"tls/127.0.0.1:{self.port}"
        folder = self.folder = folder / "fleet"
        folder.mkdir()
        credentials, services = "secure/hub.1" if secured else "", SERVICES if scenes == 1 else SERVICES[:1]
        for name in self.scenes:
            # In the order of their names the first scene is the first file.
            file = self.write(f"{name}.toml", self.endpoint, services, scene=name, credentials=credentials)
            self.file = file if name == SCENE else self.file
        self.place = self.file if scenes == 1 else folder
        if secured:
            self._certify()
        router = ("router", "--scene", self.place) if secured else ("router", self.endpoint)
        commands = {"router": labanmesh(*router)}
        commands |= {name: labanmesh("fuse", self.place, "--id", name) for name in SERVICES}
        commands |= {name: labanmesh("observe", self.file, name) for name in VIEWS}
        commands["hub"] = labanmesh("watch", self.file, "--json")
        if scenes > 1:
            commands[ECHO] = [sys.executable, str(HERE / "attack_echo.py"), str(self.place)]
        self.processes = {
            name: Process(command, environment=self.environment(name)) for name, command in commands.items()
        }

    def _certify(self):
        machines = {"router": (), "hub": ("--hub",)} | {name: ("--fusion", name) for name in SERVICES}
        machines |= {name: ("--observer", f"{SCENE}/{name}") for name in VIEWS}
        if len(self.scenes) > 1:
            # The other scenes' observers, on one machine.
            places = [("--observer", f"{scene}/{name}") for scene in self.scenes[1:] for name in VIEWS]
            machines[ECHO] = ("--hub", *(word for place in places for word in place))
        self.certify(self.place, machines)

    def witness(self, inside=(), scene_file=None):
        return super().witness(inside, scene_file or self.place)


class LinkedFleet(Stage):
    """One scene whose processes each reach the router over a line of their own, and have a scene file of their own.
    lines: by name; listeners: those of attack_listeners.py, and a watch, which asks for what it has missed."""

    def __init__(self, replay, folder):
        super().__init__(replay, folder, fusions=SERVICES)
        self.lines = {name: SlowLine(self.port, 0.0) for name in (*SERVICES, *VIEWS, "watch", "page", "mqtt")}
        self._files = {}
        for name, line in self.lines.items():
            (folder / name).mkdir()
            self._files[name] = self.write(f"{name}/scene.toml", f"tcp/127.0.0.1:{line.port}", SERVICES)
        for name, verb in {**dict.fromkeys(SERVICES, "fuse"), **dict.fromkeys(VIEWS, "observe")}.items():
            words = (verb, self._files[name], "--id", name) if verb == "fuse" else (verb, self._files[name], name)
            self.processes[name] = Process(labanmesh(*words))

    def open_listeners(self):
        """By name those that are there: what each was told is in its `verdicts`."""
        result = {"watch": self.witness(scene_file=self._files["watch"], watches=True)}
        for name in ("page", "mqtt"):
            listener = listeners(self._files[name], self.folder / f"{name} broker", SCENE).get(name)
            if listener is not None:
                self._listeners.callback(listener.close)
                result[name] = listener.open()
        return result

    def __enter__(self):
        self._listeners = ExitStack()
        return self

    def __exit__(self, *_):
        super().__exit__()
        self._listeners.close()
        for line in self.lines.values():
            line.__exit__()
