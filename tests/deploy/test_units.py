"""The systemd units: systemd's own checks, and their commands at our command line."""

import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import typer
from processes import SOON_S

from common.config import MODELS_VARIABLE
from labanmesh import app_of

UNITS = Path(__file__).parents[2] / "deploy" / "systemd"
SERVICES = ("labanmesh-observer@.service", "labanmesh-fusion@.service", "labanmesh-router.service")
FILES = (*SERVICES, "labanmesh.target")
EXECUTABLE = "/usr/local/bin/labanmesh"
NOT_BAD = 30
"""In tenths of systemd's exposure level, 0 to 10: 3.0. What it calls unsafe begins at 9."""

with_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
services = pytest.mark.parametrize("name", SERVICES)


def settings(name, key):
    """The values of a key of a unit, in the file's order."""
    return re.findall(rf"^{key}=(.*)$", (UNITS / name).read_text("utf-8"), re.MULTILINE)


@pytest.fixture
def installed(tmp_path):
    """The units in a folder of their own, with the program that they start."""
    program = tmp_path / "labanmesh"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    for name in FILES:
        text = (UNITS / name).read_text("utf-8")
        (tmp_path / name).write_text(text.replace(EXECUTABLE, str(program)))
    return tmp_path


def complaints(folder):
    names = [folder / name.replace("@.", "@sofa.") for name in FILES]
    done = subprocess.run(["systemd-analyze", "verify", *names], capture_output=True, text=True, timeout=SOON_S)
    # verify reads the machine's own units too; complaints about those are not ours.
    return [line for line in (done.stdout + done.stderr).splitlines() if "labanmesh" in line]


@with_systemd
def test_systemd_has_no_complaint(installed):
    assert complaints(installed) == []


@with_systemd
@services
def test_systemd_rates_the_services_as_confined(name):
    command = ["systemd-analyze", "security", "--offline=true", f"--threshold={NOT_BAD}", "--no-pager", UNITS / name]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON_S)
    if "--offline" in done.stderr:
        pytest.skip("this systemd-analyze looks at running services only")
    assert done.returncode == 0, done.stdout + done.stderr


@with_systemd
def test_the_users_file_is_understood(tmp_path):
    if shutil.which("systemd-sysusers") is None:
        pytest.skip("systemd-sysusers is not installed")
    (tmp_path / "etc").mkdir()
    command = ["systemd-sysusers", f"--root={tmp_path}", UNITS / "labanmesh.sysusers"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON_S)
    assert done.returncode == 0, done.stderr
    assert re.search("^labanmesh:", (tmp_path / "etc" / "passwd").read_text(), re.MULTILINE)
    assert {user for name in SERVICES for user in settings(name, "User")} == {"labanmesh"}


def test_an_observer_keeps_what_it_is_taught_in_its_state_folder():
    observer = SERVICES[0]
    (state,) = settings(observer, "StateDirectory")
    assert f"{MODELS_VARIABLE}=%S/{state}" in " ".join(settings(observer, "Environment")).split()
    assert settings(observer, "ProtectSystem") == ["strict"] and not settings(observer, "ReadWritePaths")


def test_without_certificates_only_this_machine_reaches_the_router():
    (default,) = re.findall(r"LABANMESH_ROUTER=(\S+)", " ".join(settings(SERVICES[2], "Environment")))
    assert default == "tcp/127.0.0.1:7447"
    assert not re.search("^LABANMESH_ROUTER=", (UNITS / "labanmesh.env").read_text("utf-8"), re.MULTILINE)


@services
def test_the_command_of_a_service_is_parsed(name):
    (line,) = settings(name, "ExecStart")
    defaults = dict(re.findall(r"(\w+)=(\S+)", " ".join(settings(name, "Environment"))))
    line = re.sub(r"\$(\w+)", lambda match: defaults[match[1]], line.replace("%i", "sofa"))
    program, verb, *words = shlex.split(line)
    assert program == EXECUTABLE
    typer.main.get_command(app_of(verb)).make_context(verb, words)


def test_the_wheel_has_the_files_that_the_page_copies():
    carried = tomllib.loads((UNITS.parents[1] / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"][
        "package-data"
    ]
    assert "systemd/*" in carried["deploy"]
    page = (UNITS.parents[1] / "docs" / "guide" / "operate.md").read_text("utf-8")
    copied = set(re.findall(r'"\$files"/(\S+)', page))
    assert copied == {"*.service", "*.target", "labanmesh.sysusers", "labanmesh.env"}
    assert all(list(UNITS.glob(name)) for name in copied)
