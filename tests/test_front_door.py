"""The command line: help, errors, exit statuses, and packages hidden by others."""

import errno
import os
import shutil
import subprocess
import sys
from typing import Annotated

import pytest
import typer
from processes import SOON_S

import labanmesh
from common.errors import BadInput, LabanmeshError
from labanmesh import OTHER_FORMS, RENAMED, VERBS, Verb, main

ROOMS = ("common", "observer", "fusion", "hub", "studies", "deploy")
HEAVY = ("numpy", "zenoh", "pydantic", "typer", "rich", "cv2", "scipy", "matplotlib")


@pytest.fixture
def run(capsys):
    """Runs labanmesh in this process; gives status, stdout and stderr."""

    def call(*words):
        status = main(words)
        out, err = capsys.readouterr()
        return status, out, err

    return call


@pytest.fixture
def verb(monkeypatch):
    """Registers a function of the test as the verb `bow`."""

    def behind(function):
        function.__module__ = __name__
        monkeypatch.setitem(VERBS, "bow", Verb("test", "bow", "for this test"))
        monkeypatch.setattr(Verb, "load", lambda self: function)

    return behind


def process(*words, **more):
    return subprocess.run(words, capture_output=True, text=True, timeout=SOON_S, check=False, **more)


@pytest.mark.parametrize("words", [(), ("--help",), ("-h",), ("help",)])
def test_help_lists_all_verbs_with_their_purpose(run, words):
    status, out, err = run(*words)
    assert (status, err) == (0, "") and "usage: labanmesh VERB" in out
    for name, behind in VERBS.items():
        assert f"  {name} " in out and behind.purpose in out
    assert all(len(line) <= 100 for line in out.splitlines())


def test_help_imports_no_package_and_nothing_heavy():
    look = "import sys, labanmesh; assert labanmesh.main(['--help']) == 0; print(*sys.modules, file=sys.stderr)"
    loaded = process(sys.executable, "-c", look).stderr.split()
    assert "common.errors" in loaded
    rooms = {name for name in loaded if name.partition(".")[0] in ROOMS} - {"common", "common.errors", "common.plugins"}
    assert not rooms, f"--help imports {sorted(rooms)}; import them inside functions"
    assert not {name.partition(".")[0] for name in loaded} & set(HEAVY)


@pytest.mark.parametrize("words", [("--version",), ("-V",)])
def test_version_is_that_of_the_distribution(run, words):
    from importlib.metadata import version

    assert run(*words) == (0, f"labanmesh {version('labanmesh')}\n", "")


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [("evalaute", "did you mean evaluate?"), ("observer", "did you mean observe?"), ("xyzzy", "known: demo, init, up")],
)
def test_an_unknown_verb_suggests_the_nearest(run, wrong, hint):
    status, out, err = run(wrong, "--help")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert err.startswith(f"labanmesh: '{wrong}': unknown verb; ") and hint in err


@pytest.mark.parametrize(("typed", "threads"), [({}, "1"), ({"OMP_NUM_THREADS": "3"}, "3")])
def test_a_verb_calculates_in_one_thread_unless_told_otherwise(run, monkeypatch, typed, threads):
    """Else a learned model takes up to seven times as much of the processors."""
    monkeypatch.setattr(os, "environ", dict(typed))
    run("completion", "bash")
    assert os.environ["OMP_NUM_THREADS"] == threads and os.environ["OPENBLAS_NUM_THREADS"] == "1"


@pytest.mark.parametrize("name", VERBS)
def test_help_of_every_verb_has_an_example(run, name):
    function = VERBS[name].load()
    assert callable(function)
    status, out, err = run(name, "--help")
    assert (status, err) == (0, ""), err
    assert f"Usage: labanmesh {name}" in out and "Example" in out and f"labanmesh {name}" in out.split("Example", 1)[1]
    assert function.__doc__.splitlines()[0].rstrip(".") in " ".join(out.split())
    # Every option is whole, within 80 columns; an example is one line that can be copied.
    lines = [line for line in out.splitlines() if "Example: " not in line]
    assert "\u2026" not in out and all(len(line) <= 80 for line in lines)
    assert out.count("Example: ") == function.__doc__.count("Example: ")


@pytest.mark.parametrize("name", ["camera", "hub", "secure"])
def test_help_of_a_verb_with_sub_verbs_says_in_whole_sentences_what_each_does(run, name):
    listed = " ".join(run(name, "--help")[1].partition("Commands:")[2].split())
    for command in VERBS[name].load().registered_commands:
        assert command.callback.__doc__.partition("\n")[0] in listed


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_the_old_name_of_a_verb_still_answers_with_one_line(run, old, new):
    status, out, err = run(old, "--help")
    assert status == 0 and err.count("\n") == 1 and f"{old} is now `labanmesh {new}`" in err
    assert old not in VERBS and (out, 0) == (run(*new.split(), "--help")[1], status)


@pytest.mark.parametrize(("verb", "option"), OTHER_FORMS)
def test_the_help_of_a_verb_names_the_option_that_turns_it_into_another(run, verb, option):
    assert option in run(verb, "--help")[1]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("doctor --process sofa", "doctor: --process: only with --ready; see labanmesh doctor --help"),
        ("doctor --ready --json", "doctor: --json: not with --ready"),
        ("evaluate --paper a.npz --views door", "evaluate: --views: not with --paper"),
        ("watch a.toml --foo", "watch: No such option: --foo"),
    ],
)
def test_an_option_of_another_form_of_a_verb_is_named_as_such(run, words, line):
    status, _, err = run(*words.split())
    assert status == 2 and line in err


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("labanmesh ca", {"camera", "capture"}),
        ("labanmesh camera ", {"look", "calibrate", "place", "record"}),
        ("labanmesh camera look --fr", {"--frames"}),
        ("labanmesh evaluate msr.npz --pa", {"--parameter", "--paper"}),
        ("labanmesh up ", set()),
        ("labanmesh up --e", {"--exit-when-done"}),
    ],
)
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_tab_completes_verbs_and_options_in_bash(run, typed, offered):
    words = typed.split(" ")
    script = run("completion")[1] + (
        f"COMP_WORDS=({' '.join(words[:-1])} '{words[-1]}'); COMP_CWORD={len(words) - 1}; _labanmesh; "
        'echo "${COMPREPLY[@]}"'
    )
    assert {*process("bash", "-c", script).stdout.split()} == offered


def test_help_flows_and_keeps_words_in_brackets(run, verb):
    def bow(depth: Annotated[int, typer.Option(help="As [fusion] says.")] = 1) -> None:
        """Bow to the referee.

        The first line of a paragraph ends where
        the source ends it ([fusion] standby).
        """

    verb(bow)
    out = run("bow", "--help")[1]
    assert "ends where the source ends it ([fusion] standby)." in " ".join(out.split()) and "As [fusion] says." in out
    assert any("ends where the source" in line for line in out.splitlines()), out


@pytest.mark.parametrize("name", VERBS)
def test_an_unknown_option_is_one_line_that_refers_to_help(run, name):
    status, out, err = run(name, "--no-such-option")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert err.startswith(f"labanmesh: {name}") and err.endswith(f"; see labanmesh {name} --help\n")
    assert "--no-such-option" in err or "Missing" in err


def test_a_missing_scene_file_is_one_line(run):
    for name in ("fuse", "watch", "up"):
        status, out, err = run(name, "nowhere.toml")
        assert (status, out) == (2, "") and err.count("\n") == 1 and "nowhere.toml" in err


def test_arguments_reach_the_verb_and_its_status_comes_back(run, verb):
    def bow(depth: int, json: bool = False) -> int:
        print(depth, json)
        return 3

    verb(bow)
    assert run("bow", "7", "--json") == (3, "7 True\n", "")
    status, _, err = run("bow", "deep")
    assert status == 2 and err.startswith("labanmesh: bow deep: ") and "integer" in err and err.count("\n") == 1


MISSING = "labanmesh: bow: {} is not installed on this machine; pip install 'labanmesh[{}]'"


def missing(module):
    return ModuleNotFoundError(f"No module named {module!r}", name=module)


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (BadInput("scene = 'X': lower case only"), 2, "labanmesh: scene = 'X': lower case only"),
        (LabanmeshError("cam1: gone"), 1, "labanmesh: cam1: gone"),
        (KeyboardInterrupt(), 130, ""),
        (typer.Abort(), 130, ""),
        (typer.Exit(4), 4, ""),
        (missing("matplotlib.figure"), 1, MISSING.format("matplotlib", "report")),
        (missing("scipy.io"), 1, MISSING.format("scipy", "observer")),
    ],
)
def test_an_exception_is_a_status_and_one_line_or_none(run, verb, error, status, line):
    def bow() -> None:
        raise error

    verb(bow)
    ended, out, err = run("bow")
    assert (ended, out, err.strip()) == (status, "", line)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError(errno.EMFILE, "Too many open files", "a.npz"), "too many open files; raise the limit"),
        (MemoryError(), "out of memory; "),
        (ImportError("libstdc++.so.6: failed to map segment from shared object"), "out of memory; "),
        (RuntimeError("can't start new thread"), "out of memory; "),
        (type("PanicException", (BaseException,), {})("Failed to init net"), "Zenoh cannot work here: Failed to init"),
    ],
)
def test_a_machine_that_cannot_is_one_line(run, verb, error, line):
    def bow() -> None:
        raise error

    verb(bow)
    status, out, err = run("bow")
    assert (status, out) == (1, "") and err.startswith(f"labanmesh: {line}") and err.count("\n") == 1
    assert "ulimit" in err


def test_too_few_open_files_is_one_line():
    limited = "import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20)); import labanmesh; "
    ended = process(sys.executable, "-c", limited + "sys.exit(labanmesh.main(['fuse', 'nowhere.toml']))")
    assert ended.returncode == 1 and ended.stderr.startswith("labanmesh: 20 open files are too few; raise the limit")


def test_the_home_of_an_unknown_user_is_one_line(run, tmp_path):
    scene = tmp_path / "s.toml"
    scene.write_text('scene = "dojo"\n[mesh]\ncredentials = "~nosuchuser/c"\n[observers.a]\nsource = "a.npz"\n')
    status, _, err = run("fuse", str(scene))
    assert status == 2 and "~nosuchuser/c: no user of this machine" in err and err.count("\n") == 1


def test_a_command_in_an_error_names_the_scene_file_that_was_typed(run, verb):
    def bow(scene: str = "") -> None:
        raise BadInput("no authority; labanmesh secure init SCENE makes one")

    verb(bow)
    typed = run("bow", "--scene", "my room.toml")
    assert typed[2] == "labanmesh: no authority; labanmesh secure init 'my room.toml' makes one\n"
    assert "labanmesh secure init SCENE makes one" in run("bow")[2]


def test_a_missing_module_of_ours_is_a_traceback(verb):
    def bow() -> None:
        raise missing("studies.gone")

    verb(bow)
    with pytest.raises(ModuleNotFoundError):
        main(["bow"])


@pytest.mark.parametrize("words", [("--help",), ("doctor",)])
def test_a_closed_pipe_is_not_an_error(words):
    reading, writing = os.pipe()
    os.close(reading)
    try:
        command = [sys.executable, "-P", "-m", "labanmesh", *words]
        ended = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, timeout=SOON_S, check=False)
    finally:
        os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, b"")


@pytest.mark.parametrize("place", ["common/__init__.py", "studies/__init__.py", "fusion/readme", "hub.py"])
def test_a_folder_that_hides_our_packages_is_one_line(tmp_path, place):
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).write_text("raise SystemExit('not ours')")
    hiding = tmp_path / (place.partition("/")[0])
    ended = process(sys.executable, "-m", "labanmesh", "--help", cwd=tmp_path)
    if ended.returncode:
        assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (2, "", 1)
        assert ended.stderr.startswith(f"labanmesh: {hiding} hides the package {hiding.stem!r} of labanmesh; run")
    else:
        # A folder that is no package hides ours only where they are installed in editable mode.
        assert place == "fusion/readme" and ended.stdout.startswith("labanmesh: ")
    assert process(sys.executable, "-P", "-m", "labanmesh", "--help", cwd=tmp_path).returncode == 0


def test_the_command_and_the_module_are_the_same():
    name = os.path.join(os.path.dirname(sys.executable), "labanmesh")  # noqa: PTH118, PTH120
    assert process(name, "--help").stdout == process(sys.executable, "-P", "-m", "labanmesh", "--help").stdout != ""
    ended = process(name, "evalaute")
    assert (ended.returncode, ended.stdout) == (2, "") and ended.stderr.count("\n") == 1


def numeric_options():
    """(words, option, least, most) of every option of every verb and sub-verb that takes a number."""

    def walk(words, command):
        for name, each in getattr(command, "commands", {}).items():
            yield from walk((*words, name), each)
        for parameter in command.params:
            kind = str(getattr(parameter.type_descriptor, "annotation", ""))
            if "int" in kind or "float" in kind:
                yield words, parameter.opts[0], parameter.min, parameter.max

    for name in VERBS:
        yield from walk((name,), typer.main.get_command(labanmesh.app_of(name)))


def test_every_number_on_the_command_line_has_bounds(run):
    options = list(numeric_options())
    assert len(options) > 30
    for words, option, least, most in options:
        assert least is not None and most is not None, f"{' '.join(words)} {option}: declare min and max"
        for value in ("nan", "inf", "-inf", "1e308", str(10**30), str(least - 1)):
            status, out, err = run(*words, f"{option}={value}")
            assert (status, out) == (2, "") and err.count("\n") == 1 and len(err) < 300, (words, option, value, err)
            assert option in err, err
