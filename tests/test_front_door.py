"""The front door: what a person meets who types `labanmesh` and a verb, a wrong one, or Ctrl-C."""

import os
import subprocess
import sys

import pytest
import typer

import labanmesh
from common.errors import BadInput, LabanmeshError
from labanmesh import VERBS, Verb, main

ROOMS = ("common", "observer", "fusion", "hub", "studies", "deploy")
HEAVY = ("numpy", "zenoh", "pydantic", "typer", "rich", "cv2", "scipy", "matplotlib")


@pytest.fixture
def door(capsys):
    """Calls labanmesh; gives status, stdout and stderr."""

    def call(*words):
        status = main(words)
        out, err = capsys.readouterr()
        return status, out, err

    return call


@pytest.fixture
def verb(monkeypatch):
    """Puts a function of the test behind a verb."""

    def behind(function):
        function.__module__ = __name__
        monkeypatch.setitem(VERBS, "bow", Verb("test", "bow", "for this test"))
        monkeypatch.setattr(Verb, "load", lambda self: function)

    return behind


def process(*words, **more):
    return subprocess.run(words, capture_output=True, text=True, timeout=60, check=False, **more)


@pytest.mark.parametrize("words", [(), ("--help",), ("-h",), ("help",)])
def test_help_lists_all_verbs_with_their_purpose(door, words):
    status, out, err = door(*words)
    assert (status, err) == (0, "") and "usage: labanmesh VERB" in out
    for name, behind in VERBS.items():
        assert f"  {name} " in out and behind.purpose in out
    assert all(len(line) <= 100 for line in out.splitlines())


def test_help_opens_no_room_and_loads_nothing_heavy():
    look = "import sys, labanmesh; assert labanmesh.main(['--help']) == 0; print(*sys.modules, file=sys.stderr)"
    loaded = process(sys.executable, "-c", look).stderr.split()
    assert "common.errors" in loaded
    rooms = {name for name in loaded if name.partition(".")[0] in ROOMS} - {"common", "common.errors"}
    assert not rooms, f"imported for --help alone: {sorted(rooms)}; import them inside functions"
    assert not {name.partition(".")[0] for name in loaded} & set(HEAVY)


@pytest.mark.parametrize("words", [("--version",), ("-V",)])
def test_version_is_the_distributions(door, words):
    from importlib.metadata import version

    assert door(*words) == (0, f"labanmesh {version('labanmesh')}\n", "")


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        ("evalaute", "did you mean evaluate?"),
        ("observer", "did you mean observe?"),
        ("xyzzy", "known: demo, init, up"),
    ],
)
def test_an_unknown_verb_is_told_the_nearest(door, wrong, hint):
    status, out, err = door(wrong, "--help")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert err.startswith(f"labanmesh: '{wrong}': unknown verb; ") and hint in err


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_is_there_and_explains_itself_with_an_example(door, name):
    function = VERBS[name].load()
    assert callable(function)
    status, out, err = door(name, "--help")
    assert (status, err) == (0, ""), err
    assert f"Usage: labanmesh {name}" in out and "Example" in out and f"labanmesh {name}" in out.split("Example", 1)[1]
    assert function.__doc__.splitlines()[0].rstrip(".") in " ".join(out.split())


@pytest.mark.parametrize("name", VERBS)
def test_an_unknown_option_is_one_line_that_shows_the_way(door, name):
    status, out, err = door(name, "--no-such-option")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert err.startswith(f"labanmesh: {name}") and err.endswith(f"; see labanmesh {name} --help\n")
    assert "--no-such-option" in err or "Missing" in err


def test_a_missing_scene_file_is_one_line(door):
    for name in ("fuse", "watch", "up"):
        status, out, err = door(name, "nowhere.toml")
        assert (status, out) == (2, "") and err.count("\n") == 1 and "nowhere.toml" in err


def test_arguments_reach_the_verb_and_its_status_comes_back(door, verb):
    def bow(depth: int, json: bool = False) -> int:
        print(depth, json)
        return 3

    verb(bow)
    assert door("bow", "7", "--json") == (3, "7 True\n", "")
    status, _, err = door("bow", "deep")
    assert status == 2 and err.startswith("labanmesh: bow deep: ") and "integer" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "status"), [(BadInput("scene = 'X': lower case only"), 2), (LabanmeshError("cam1: gone"), 1)]
)
def test_an_error_is_one_line_and_a_status(door, verb, error, status):
    def bow() -> None:
        raise error

    verb(bow)
    assert door("bow") == (status, "", f"labanmesh: {error}\n")


@pytest.mark.parametrize("stop", [KeyboardInterrupt, typer.Abort])
def test_ctrl_c_is_130_and_no_traceback(door, verb, stop):
    def bow() -> None:
        raise stop

    verb(bow)
    status, out, err = door("bow")
    assert (status, out, err.strip()) == (130, "", "")


def test_a_verb_may_end_early_with_its_own_status(door, verb):
    def bow() -> None:
        raise typer.Exit(4)

    verb(bow)
    assert door("bow")[0] == 4


@pytest.mark.parametrize(
    ("module", "extra"), [("matplotlib.figure", "report"), ("cv2", "observer"), ("scipy.io", "observer")]
)
def test_what_a_plain_install_lacks_is_said_with_its_extra(door, verb, module, extra):
    def bow() -> None:
        raise ModuleNotFoundError(f"No module named {module!r}", name=module)

    verb(bow)
    library = module.partition(".")[0]
    way_out = f"labanmesh: bow: {library} is not installed on this machine; pip install 'labanmesh[{extra}]'\n"
    assert door("bow") == (1, "", way_out)


def test_a_defect_of_ours_is_not_dressed_up(verb):
    def bow() -> None:
        raise ModuleNotFoundError("No module named 'studies.gone'", name="studies.gone")

    verb(bow)
    with pytest.raises(ModuleNotFoundError):
        main(["bow"])


def test_the_extras_are_those_of_the_distribution():
    from importlib.metadata import metadata

    assert set(labanmesh.EXTRAS.values()) <= set(metadata("labanmesh").get_all("Provides-Extra"))


def test_a_reader_who_leaves_gets_no_complaint():
    reading, writing = os.pipe()
    os.close(reading)
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", "labanmesh", "--help"],
            stdout=writing,
            stderr=subprocess.PIPE,
            timeout=60,
            check=False,
        )
    finally:
        os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, b"")


def test_it_is_the_same_by_its_name_and_as_a_module():
    name = os.path.join(os.path.dirname(sys.executable), "labanmesh")  # noqa: PTH118, PTH120
    assert process(name, "--help").stdout == process(sys.executable, "-P", "-m", "labanmesh", "--help").stdout != ""
    ended = process(name, "evalaute")
    assert (ended.returncode, ended.stdout) == (2, "") and ended.stderr.count("\n") == 1
