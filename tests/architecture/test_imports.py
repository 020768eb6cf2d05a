"""Imports between packages and of libraries, checked in the source."""

import ast
from fnmatch import fnmatch
from importlib.metadata import packages_distributions

import pytest
from source_imports import FILES, HOUSE, ROOMS, all_imports, trees

from labanmesh import OTHER_FORMS, VERBS

MAY_ENTER = {
    "common": {"common"},
    "observer": {"observer", "common"},
    "fusion": {"fusion", "common"},
    "hub": {"hub", "common"},
    "deploy": {"deploy", "common"},
    "studies": {"studies", "observer", "fusion", "common"},
    "labanmesh_testing": {"labanmesh_testing", "labanmesh", "fusion", "common"},
    "labanmesh": {"common"},
}
ONLY_IN = {
    "zenoh": "common/link.py common/subsession.py",
    "msgpack": "common/wire.py",
    "msgspec": "common/posterior.py common/floor_place.py common/wire.py",
    "mcap": "common/capture_file.py",
    "starlette": "hub/dashboard/*",
    "sse_starlette": "hub/dashboard/*",
    "uvicorn": "hub/dashboard/serving.py hub/dashboard/connections.py",
    "aiomqtt": "hub/mqtt/*",
    "websockets": "hub/phone/serving.py",
    "segno": "hub/phone/pages.py",
    "prometheus_client": "*metrics.py",
    "cv2": "observer/*",
    "matplotlib": "studies/figures/*",
    "scipy": "observer/*",
}
OUTSIDE_WORLD = {
    *("time", "socket", "threading", "subprocess", "os", "pathlib", "signal", "tempfile", "shutil", "zipfile", "sys"),
    *("multiprocessing", "asyncio", "select", "selectors", "logging", "tomllib", "urllib", "http", "random", "secrets"),
    *("zenoh", "cv2"),
}
IMPURE = {
    "the mesh, with threads and clocks": (
        "common.inbox common.link common.open_links common.status common.subsession "
        "deploy.doctor.mesh deploy.security.routing "
        "fusion.fall_watch fusion.ingest fusion.membership fusion.person_worker "
        "fusion.publisher fusion.same_id fusion.scene_worker fusion.service "
        "fusion.server fusion.standby hub.dashboard.pictures hub.session "
        "hub.teaching.lesson_server hub.teaching.teaching_client "
        "hub.phone.running labanmesh_testing.* observer.foreign "
        "studies.replay.playback"
    ),
    "files": (
        "common.capture_file common.config common.credentials common.files common.tracker_choice "
        "deploy.doctor.machine deploy.doctor.scene_file deploy.commands "
        "deploy.doctor.security deploy.security.issuing fusion.checkpoint hub.dashboard.history hub.database "
        "hub.history.history_file hub.history.service "
        "hub.notify.notifying "
        "hub.people_names_file hub.phone.*_file hub.phone.pages hub.session "
        "observer.*_file observer.calibration.board observer.calibration.calibrated "
        "observer.files observer.learning.learning_sources observer.motion.importers observer.motion.importers.* "
        "fusion.preflight observer.runtime.preflight "
        "observer.runtime.scene_inputs observer.teaching.film_takes studies.evaluated_archives studies.experiments "
        "studies.output_files studies.report"
    ),
    "sockets, signals, processes, the terminal, the supervisor": (
        "*.commands *.instrumentation *.service common.health common.health_server common.interrupt "
        "common.lifecycle common.log_limit common.notify common.progress common.terminal common.tls "
        "deploy.doctor.broker deploy.doctor.cameras deploy.doctor.network deploy.home-assistant.* deploy.launcher "
        "hub.lan hub.phone.pages hub.phone.serving "
        "hub.dashboard.access hub.dashboard.application hub.dashboard.teach_routes "
        "hub.dashboard.connections hub.dashboard.serving hub.dashboard.streams hub.mqtt.broker "
        "hub.notify.sender hub.dashboard.history_routes hub.dashboard.teach_routes hub.dashboard.phone_routes "
        "hub.teaching.rehearsal hub.teaching.terminal_lesson hub.teaching.terminal hub.teaching.terminal_lesson "
        "studies.performer.cameras "
        "studies.demo* "
        "studies.commands observer.learning.learn_options observer.teaching.model_learner common.parallel "
        "hub.teaching.memory_commands"
    ),
    "the clock": (
        "fusion.metrics hub.teaching.page_interface observer.motion.playback observer.rendering.virtual_camera "
        "studies.evaluate studies.observing studies.stream"
    ),
    "OpenCV or matplotlib, cameras": (
        "observer.calibration.bundle observer.calibration.calibrate observer.calibration.detection "
        "observer.calibration.parameters observer.camera* observer.preview.* "
        "observer.recording.capture observer.rendering.canvas observer.runtime.pacing "
        "observer.rendering.scenery observer.tracking.* studies.figures studies.figures.*"
    ),
}
"""What modules use that are not pure, and the patterns of their names. All other modules are pure."""
PURE_ALL_THE_SAME = (
    "observer.camera.base",
    "observer.tracking.person_keeper",
    "observer.tracking.people",
    "observer.preview.track_doubts",
)
ALLOWED = {
    ("deploy.security.router_config", "common.tracker_choice"): "the names of sources, constants",
    ("hub.phone.pose_task", "zipfile"): "an archive in memory",
    ("common.tflite", "zipfile"): "an archive in memory",
    ("observer.tracking.tracker_kind", "pathlib"): "a tracker may be told the name of a file",
    ("observer.motion.sensors", "pathlib"): "a sensor is named with its file",
    ("studies.sensors", "pathlib"): "a sensor is named with its file",
    ("observer.geometry.views", "pathlib"): "a view may be the name of a camera file",
    ("observer.geometry.views", "observer.geometry.camera_file"): "a view may be the name of a camera file",
}


def room_of(module):
    return module.partition(".")[0]


PATTERNS = " ".join(IMPURE.values()).split()
BEHIND_VERBS = {verb.module for verb in (*VERBS.values(), *OTHER_FORMS.values())}
"""These talk to people, files and the mesh."""


def is_pure(module):
    known = module in BEHIND_VERBS or any(fnmatch(module, pattern) for pattern in PATTERNS)
    return module in PURE_ALL_THE_SAME or not known


def listed(faults):
    """The faults as the text of a failure."""
    return "\n" + "\n".join(sorted(set(faults)))


def test_this_test_finds_the_imports():
    assert {room_of(name) for name in FILES} == {*ROOMS, "labanmesh"}
    pairs = {(i.by, i.of) for i in all_imports()}
    assert ("fusion.engine.engine", "fusion.engine.segmenter") in pairs and ("common.link", "zenoh") in pairs
    lazy = [i for i in all_imports() if i.by == "fusion.commands" and i.of == "fusion.server"]
    assert lazy and not lazy[0].at_import
    assert any(i.for_types and i.of == "common.config" for i in all_imports() if i.by == "hub.mqtt.bridge")


def test_packages_import_only_what_they_may():
    faults = [
        f"{i.place} imports {i.of}: {room_of(i.by)} may import {', '.join(sorted(MAY_ENTER[room_of(i.by)]))}; "
        "move what both need to common, or let studies join them"
        for i in all_imports()
        if i.top in (*ROOMS, "labanmesh") and i.top not in MAY_ENTER[room_of(i.by)]
    ]
    assert not faults, listed(faults)


def test_the_command_line_imports_a_package_only_for_its_verb():
    allowed = (
        "common.command_options",
        "common.errors",
        "common.files",
        "common.interrupt",
        "common.missing_library",
        "common.plugins",
        "common.terminal",
        "common.text",
    )
    faults = [i.place for i in all_imports() if i.by == "labanmesh" and i.top in ROOMS and i.of not in allowed]
    assert not faults, f"labanmesh.py imports packages only through VERBS, so that --help is fast: {listed(faults)}"
    assert {room_of(verb.module) for verb in VERBS.values()} <= set(ROOMS)


@pytest.mark.parametrize(("library", "where"), ONLY_IN.items())
def test_each_heavy_library_is_imported_in_one_place(library, where):
    faults = [
        f"{i.place}: {library} is imported in {where} only; use that module"
        for i in all_imports()
        if i.top == library and not any(fnmatch(str(FILES[i.by].relative_to(HOUSE)), w) for w in where.split())
    ]
    assert not faults, listed(faults)


def test_pure_modules_do_not_use_the_outside_world():
    faults = [
        f"{i.place} imports {i.of}, which uses the outside world: pass it in, move that part to a file of its own, "
        "or, if this is the purpose of the module, list it in IMPURE with the reason"
        for i in all_imports()
        if is_pure(i.by) and i.by != "labanmesh" and not i.for_types and (i.by, i.of) not in ALLOWED
        if i.top in OUTSIDE_WORLD or (i.of in FILES and not is_pure(i.of))
    ]
    assert not faults, listed(faults)


def test_pure_modules_open_no_files_and_use_no_unseeded_random_numbers():
    forbidden = {"open", "print", "input", "read_text", "write_text", "read_bytes", "write_bytes", "urlopen"}
    faults = []
    for name in filter(is_pure, FILES):
        for call in (n for n in ast.walk(trees()[name]) if isinstance(n, ast.Call)):
            function = ast.unparse(call.func)
            unseeded = function.endswith("default_rng") and not call.args
            impure = function.rpartition(".")[2] in forbidden or function.startswith("np.load") or unseeded
            if name != "labanmesh" and impure:
                faults.append(f"{name} line {call.lineno}: {function}(...) in a pure module; pass in its result")
    assert not faults, listed(faults)


def test_the_exceptions_are_still_needed():
    used = {(i.by, i.of) for i in all_imports()}
    unused = [f"{by} -> {of}" for by, of in ALLOWED if (by, of) not in used]
    unused += [pattern for pattern in PATTERNS if not any(fnmatch(name, pattern) for name in FILES)]
    assert not unused, f"take these out of ALLOWED and IMPURE: {listed(unused)}"


def test_our_import_names_are_ours_alone():
    providers = packages_distributions()
    for name in (*ROOMS, "labanmesh"):
        assert set(providers.get(name, ())) == {"labanmesh"}, (
            f"{name} is provided by {providers.get(name)}: install labanmesh in an environment of its own (make clean, "
            "make test), or rename the room"
        )


def test_loggers_are_named_after_their_packages():
    for name, tree in trees().items():
        calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
        for call in (call for call in calls if ast.unparse(call.func).endswith("getLogger")):
            logger = call.args[0].value if call.args and isinstance(call.args[0], ast.Constant) else ast.unparse(call)
            assert logger in ("labanmesh", f"labanmesh.{room_of(name)}"), (
                f"{name} line {call.lineno}: the logger is {logger!r}; call it 'labanmesh.{room_of(name)}'"
            )


def test_a_constant_has_one_value():
    values = {}
    for name, tree in trees().items():
        for node in (n for n in tree.body if isinstance(n, ast.Assign | ast.AnnAssign) and n.value):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name) and target.id.isupper() and "TypeVar" not in ast.unparse(node.value):
                values.setdefault(target.id.strip("_"), {}).setdefault(ast.unparse(node.value), []).append(name)
    faults = [f"{name}: {places}" for name, places in values.items() if len(places) > 1]
    assert not faults, f"import the one, or give the other its own name: {listed(faults)}"


def test_no_module_is_longer_than_300_lines():
    lengths = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in FILES.items()}
    faults = [f"{name} has {lines} lines: split it; 300 is the limit" for name, lines in lengths.items() if lines > 300]
    assert not faults, listed(faults)


def test_tests_are_not_a_package():
    faults = [str(p) for p in (HOUSE / "tests").rglob("__init__.py")]
    assert not faults, f"tests are imported by path (importlib mode): remove {faults}"
