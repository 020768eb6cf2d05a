"""The documents against the code: what they name exists, what they show runs, and what they list is complete."""

import ast
import json
import re
import shlex
import threading
import tomllib
from functools import cache
from itertools import chain
from pathlib import Path

import msgpack
import numpy as np
import pytest
import typer
from pydantic_core import PydanticUndefined

from common import messages
from common.config import (
    DashboardConfig,
    FusionConfig,
    HubConfig,
    MeshConfig,
    MetricsConfig,
    MqttConfig,
    ObserverConfig,
    Scene,
    VirtualConfig,
    read_scene,
)
from common.vocabulary import Vocabulary
from common.wire import decode
from labanmesh import VERBS, app_of
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.importers import csv_table
from observer.tracks import BODY_PARTS, Frame

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")])
MESSAGES = {
    kind: getattr(messages, f"{kind.capitalize()}Message")
    for kind in ("posterior", "judgement", "verdict", "status", "vocabulary")
}
REWRITE = "the last block of docs/reference/wire.md is the command that writes them anew"

SHELL = {".", "cd", "mkdir"}
"""Ordinary commands that a block of shell may hold."""

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def prose(page):
    return re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def section(page, heading):
    """What stands under a heading, down to the next one of that level."""
    return re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)[1]


def table_rows(text):
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if line[:1] == "|"]
    return [[cell.strip("| ") for cell in row] for row in rows if not set("".join(row)) <= set("-| ")]


def slugs(page):
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pages
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if target.startswith("https://"):
            continue
        file, _, anchor = target.partition("#")
        place = (page.parent / file) if file else page
        assert place.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in slugs(place), f"{page.name}: {target}"


@pages
def test_no_machine_is_named(page):
    assert not re.search(r"(?<![\w.])/(work|tmp|home|opt)\b|\.\./shared", page.read_text("utf-8"))


@cache
def names_in(file):
    """Functions, classes and constants of a module, and `Class.member`."""
    found = set()
    for node in ast.parse(file.read_text("utf-8")).body:
        found |= names_of(node)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{name}" for inner in node.body for name in names_of(inner)}
    return found


def names_of(node):
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {target.id for target in targets if isinstance(target, ast.Name)}


@pages
def test_code_that_is_named_exists(page):
    for path, name in re.findall(r"`([\w/]+\.py)(?::([\w.]+))?`", page.read_text("utf-8")):
        assert (ROOT / path).is_file(), f"{page.name}: {path}"
        assert not name or name in names_in(ROOT / path), f"{page.name}: {path}:{name}"


def test_every_room_is_in_the_tree_of_the_readme():
    packages = {path.parent.name + "/" for path in ROOT.glob("*/__init__.py")}
    named = {row[0].strip("`") for row in table_rows(section(ROOT / "README.md", "The tree"))}
    assert packages <= named
    assert all((ROOT / name).exists() for name in named - {"folder"})


def command_lines(page):
    """Commands of shell blocks, and of text blocks after a prompt, with the continuation and comments taken away."""
    prompts = [line[2:] for text in blocks(page, "text") for line in text.splitlines() if line.startswith("$ ")]
    for line in chain(prompts, *(text.replace("\\\n", " ").splitlines() for text in blocks(page, "sh"))):
        words = [w for w in shlex.split(line, comments=True) if not re.match(r"[A-Z_]+=", w)]
        if words:
            yield words


@cache
def command_of(verb):
    return typer.main.get_command(app_of(verb))


def told_apart(words):
    """The command that the words begin with, a sub-verb's own if there is one, and the words after it."""
    command = command_of(words[0])
    inner = getattr(command, "commands", {}).get(words[1]) if len(words) > 1 else None
    return (inner, words[2:]) if inner else (command, words[1:])


@pages
def test_commands_in_blocks_are_understood(page):
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for words in command_lines(page):
        if words[0] in SHELL or words[:2] == ["python", "make_motion.py"]:
            continue
        if words[0] == "make":
            assert f"\n{words[1]}:" in makefile, words
        elif words[:2] == ["python", "-m"]:
            assert (ROOT / words[2].replace(".", "/") / "__main__.py").exists(), words
        else:
            assert words[0] == "labanmesh", words
            command, rest = told_apart(words[1:])
            command.make_context(words[1], rest)


@pages
def test_commands_in_the_text_have_known_verbs_and_options(page):
    for line in re.findall(r"`labanmesh ([^`]+)`", prose(page)):
        words = line.split()
        if words[0] in ("VERB", "--help"):
            continue
        assert words[0] in VERBS, f"{page.name}: labanmesh {line}"
        parameters = told_apart(words)[0].params
        known = {option for p in parameters for option in (*p.opts, *p.secondary_opts)} | {"--help"}
        options = {word for word in words if word.startswith("--")}
        assert options <= known, f"{page.name}: labanmesh {line}"


@pytest.mark.parametrize("verb", VERBS)
def test_commands_lists_every_verb_and_option(verb):
    page = (DOCS / "reference" / "commands.md").read_text("utf-8")
    assert re.search(rf"^\| `{verb}[` ]", page, re.MULTILINE)
    command = command_of(verb)
    for inner in getattr(command, "commands", {verb: command}).values():
        options = {option for p in inner.params for option in (*p.opts, *p.secondary_opts) if option[:1] == "-"}
        rows = [row for row in table_rows(page) if {verb, "all", "both"} & set(re.split(r"[, ]+", row[1]))]
        listed = set(re.findall(r"`(-[\w-]+)`", " ".join(row[0] for row in rows)))
        assert options - {"--help"} <= listed, verb


@pytest.mark.parametrize("kind", MESSAGES)
def test_schemas_are_those_of_the_models(kind):
    written = json.loads((DOCS / "reference" / "schema" / f"{kind}.json").read_text("utf-8"))
    assert written == MESSAGES[kind].model_json_schema(), f"docs/reference/schema/{kind}.json is out of date; {REWRITE}"


def fields_in(text, head="field"):
    rows = table_rows(text)
    start = next(n for n, row in enumerate(rows) if row[0] == head)
    return {row[0].strip("`") for row in rows[start + 1 :] if row[0].startswith("`")}


@pytest.mark.parametrize("kind", MESSAGES)
def test_wire_tells_every_field(kind):
    text = section(DOCS / "reference" / "wire.md", kind)
    own = set(MESSAGES[kind].model_fields)
    if kind == "verdict":
        own -= set(messages.JudgementMessage.model_fields)
    if kind == "judgement":
        text, votes = text.split("\nA vote:\n")
        assert fields_in(votes.split("| state |")[0]) == set(messages.Vote.model_fields)
    assert fields_in(text) == own


@pytest.mark.parametrize("kind", MESSAGES)
def test_examples_of_messages_are_messages(kind):
    (example,) = re.findall(r"```json\n(.*?)```", section(DOCS / "reference" / "wire.md", kind), re.DOTALL)
    said = json.loads(example)
    assert set(said) <= set(MESSAGES[kind].model_fields)
    message = decode(MESSAGES[kind], msgpack.packb(said))
    if kind == "vocabulary":
        assert Vocabulary(tuple(message.labels)).digest == message.hash


DEPENDS_ON_THE_REST = {"observers.ID.model": "ID.model", "fusion.quorum": "half of the observers"}
DEFAULTS_IN_WORDS = {"vocabulary": "the models' own"} | DEPENDS_ON_THE_REST


def keys_of(model, prefix=""):
    return {f"{prefix}{name}": field.default for name, field in model.model_fields.items()}


SECTIONS = {
    "mesh": MeshConfig,
    "fusion": FusionConfig,
    "observers": None,
    "observers.ID": ObserverConfig,
    "observers.ID.virtual": VirtualConfig,
    "hub": HubConfig,
    "hub.mqtt": MqttConfig,
    "hub.dashboard": DashboardConfig,
    "metrics": MetricsConfig,
}


def test_scene_tells_every_key_with_its_default():
    expected = keys_of(Scene)
    for name, model in SECTIONS.items():
        expected |= keys_of(model, f"{name}.") if model else {}
    expected = {key: default for key, default in expected.items() if key not in SECTIONS}
    told = {row[0].strip("`"): row[1] for row in table_rows(section(DOCS / "reference" / "scene.md", "Every key"))[1:]}
    assert told.keys() == expected.keys()
    for key, default in expected.items():
        plain = "none" if default is PydanticUndefined else f"`{json.dumps(default)}`"
        assert told[key].strip("`") == DEFAULTS_IN_WORDS.get(key, plain).strip("`"), key


@pytest.mark.parametrize(
    "page", ["README.md", "docs/reference/scene.md", "docs/reference/wire.md", "docs/guide/operate.md"]
)
def test_scene_files_in_the_documents_are_read(page, tmp_path):
    whole = [text for text in blocks(ROOT / page, "toml") if "scene = " in text]
    assert whole
    for text in whole:
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        read_scene(tmp_path / "scene.toml", {})


def executed(text):
    names = {"__name__": "documented"}
    exec(compile(text, "docs", "exec"), names)  # noqa: S102 - our own documents
    return names


def test_the_archive_in_motion_is_written_and_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(DOCS / "reference" / "motion.md", "python")
    executed(code)
    assert capsys.readouterr().out == "1 recording\n"
    assert read_archive(Path("mine.npz")).recordings[0].label == "stand"


def test_the_table_in_motion_is_imported(tmp_path):
    (table,) = blocks(DOCS / "reference" / "motion.md", "csv")
    (tmp_path / "a.csv").write_text(table, encoding="utf-8")
    (recording,) = csv_table.import_files(tmp_path / "a.csv").archive.recordings
    assert recording.label == "wave" and recording.rate_hz == pytest.approx(30, rel=1e-3)
    assert np.isnan(recording.positions[2, 0]).all()


def extension(name):
    (code,) = [text for text in blocks(DOCS / "design" / "extend.md", "python") if name in text]
    return executed(code)


def test_the_model_in_extend_tells_movements_apart(monkeypatch):
    from observer.geometry.views import parse_view
    from observer.learning.learn import learn_view
    from observer.model import registry
    from observer.motion.projected import ProjectedTracker, frames_of
    from observer.runtime.pipeline import Observer

    def hands_at(height, size, label):
        body = np.array([[-0.3, height, 0], [0.3, -0.7, 0], [0, 0, 0]], dtype=np.float32) * size
        return Recording(np.tile(body, (20, 1, 1)), 15.0, label, str(size), "1")

    monkeypatch.setattr(registry, "MODELS", {**registry.MODELS, "average": extension("class Average:")["Average"]})
    people = [hands_at(h, size, label) for h, label in ((0.3, "up"), (-0.7, "down")) for size in (1, 2)]
    door = parse_view("door")
    model = learn_view(MotionArchive(BODY_PARTS, tuple(people)), door, Vocabulary(("up", "down")), kind="average")
    observer = Observer(ProjectedTracker(door, BODY_PARTS, BODY_PARTS), model)
    opinions = [observer.step(frame) for frame in frames_of(hands_at(0.25, 1.5, "up"))]
    assert opinions[-1].p[0] > 0.8


def test_the_other_examples_in_extend_do_what_they_say(tmp_path):
    pooled = extension("quadratic_mean")["RULE"].pool(np.array([[0.6, 0.4], [0.6, 0.4]]), np.full(2, 0.5))
    assert pooled.p == pytest.approx([0.6, 0.4])
    np.save(tmp_path / "wave-anna-1.npy", np.zeros((4, 3, 3)))
    (recording,) = extension("import_files")["import_files"](tmp_path).archive.recordings
    assert (recording.label, recording.subject) == ("wave", "anna")
    polled = extension("class Polled")["Polled"](lambda: np.zeros((3, 3)), 1000.0)
    assert next(polled.frames(threading.Event())).content.shape == (3, 3)
    brightest = extension("class Brightest")["KIND"].build(None)
    lamp = np.zeros((8, 8, 3), np.uint8)
    assert not brightest.update(Frame(0, lamp)).visible.any()
    lamp[2, 5] = 255
    assert brightest.update(Frame(0, lamp)).centres.tolist() == [[5, 2]]
    assert "print_verdicts" in extension("print_verdicts")


def test_dependencies_tells_every_dependency_and_its_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    text = (DOCS / "design" / "dependencies.md").read_text("utf-8")
    ours = [line for name in ("observer", "report", "capture", "mqtt", "dashboard") for line in extras[name]]
    for requirement in [*project["dependencies"], *ours]:
        name, bounds = re.match(r"([\w-]+)(.*)", requirement.replace(",", ", ")).groups()
        assert re.search(rf"^\| {name} \|.*\| {re.escape(bounds)} \|", text, re.MULTILINE), requirement
