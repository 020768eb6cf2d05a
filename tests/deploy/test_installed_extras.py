"""What pages, containers and the Home Assistant app install is what `make test-install` tries, and is enough."""

import re
from pathlib import Path

import pytest
from install_stage import ENVIRONMENTS, JOBS, extras_of

ROOT = Path(__file__).parents[2]
CONTAINERFILE, APP, PAGE = (
    (ROOT / name).read_text("utf-8")
    for name in (
        "deploy/container/Containerfile",
        "deploy/home-assistant/labanmesh/Dockerfile",
        "docs/guide/operate.md",
    )
)
TRIED = [extras_of(extras) for extras in ENVIRONMENTS]


def images():
    """Each image of the Containerfile: its extras, and the verb that it starts."""
    for text in re.split(r"^FROM plain AS ", CONTAINERFILE, flags=re.MULTILINE)[1:]:
        extras = re.search(r'"labanmesh\[(.*?)\]"', text)
        yield extras[1] if extras else "", re.search(r'^CMD \["(\w+)"', text, re.MULTILINE)[1]


def app():
    """The extras of the Home Assistant app, on each architecture."""
    template = re.search(r"\.whl\)\[(.*?)\]", APP)[1]
    return [template.replace("$extra", extra) for extra in re.findall(r"extra=(\w+)", APP)]


def on_the_page():
    """The extras of the machines of operate.md, on which systemd starts the processes."""
    return re.findall(r"\.whl\)\[(.*?)\]", PAGE)


def installed():
    yield from ((f"image of {verb}", extras, (verb,)) for extras, verb in images())
    yield from ((f"app with {extras}", extras, ("up", "observe", "fuse", "hub", "dashboard")) for extras in app())
    attic, dojo = on_the_page()
    yield "attic", attic, ("fuse", "router", "watch", "hub", "dashboard", "demo", "secure")
    yield "dojo", dojo, ("observe", "camera look", "camera calibrate")


@pytest.mark.parametrize(("where", "extras", "verbs"), list(installed()))
def test_what_is_installed_is_tried_and_is_enough(where, extras, verbs):
    assert extras_of(extras) in TRIED, f"{where}: add {extras!r} to ENVIRONMENTS of tests/install/install_stage.py"
    needs = {job.needs for job in JOBS if job.name in verbs} - {""}
    assert needs <= extras_of(extras), f"{where}: {', '.join(verbs)} need {needs}"
