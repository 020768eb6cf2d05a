"""The documents agree with the code: names exist, commands and examples run, lists are complete."""

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
from common.config import Scene, read_scene
from common.config_sections import (
    ClipsConfig,
    DashboardConfig,
    FusionConfig,
    HubConfig,
    MeshConfig,
    MetricsConfig,
    MqttConfig,
    ObserverConfig,
    PersonConfig,
    TeachingConfig,
    VirtualConfig,
)
from common.picture_message import PictureMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from labanmesh import VERBS, app_of, main
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.importers import csv_table
from observer.tracks import BODY_PARTS, Frame

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
REFERENCE = DOCS / "reference"
DESIGN = DOCS / "design"
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")])
MESSAGES = {
    kind: getattr(messages, f"{kind.capitalize()}Message")
    for kind in ("posterior", "judgement", "verdict", "status", "vocabulary")
} | {"picture": PictureMessage}
REWRITE = "the last block of docs/reference/wire.md is the command that rewrites it"
SHELL = {".", "cd", "mkdir"}
"""Shell commands that a block may contain besides ours."""
FOLDERS = ("common", "observer", "fusion", "hub", "studies", "deploy", "examples", "benchmarks", "tests")
MODULES = [ROOT / "labanmesh.py", *chain(*((ROOT / folder).rglob("*.py") for folder in FOLDERS))]

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
messages_of_the_mesh = pytest.mark.parametrize("kind", MESSAGES)


def prose(page):
    return re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL)


def section(page, heading):
    """The text below a heading of the second level, up to the next one."""
    return re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)[1]


def table_rows(text):
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if line[:1] == "|"]
    return [[cell.strip("| ") for cell in row] for row in rows if not set("".join(row)) <= set("-| ")]


def anchors(page):
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pages
def test_links_lead_to_files_and_headings(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if target.startswith("https://"):
            continue
        file, _, anchor = target.partition("#")
        linked = (page.parent / file) if file else page
        assert linked.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(linked), f"{page.name}: {target}"


@pages
def test_no_path_of_one_machine_is_named(page):
    assert not re.search(r"(?<![\w.])/(work|tmp|home|opt)\b|\.\./shared", page.read_text("utf-8"))


@pytest.mark.parametrize("folder", ["guide", "reference", "design", "results"])
def test_the_index_of_a_folder_links_every_page(folder):
    index = (DOCS / folder / "README.md").read_text("utf-8")
    listed = set(re.findall(r"\]\(([\w-]+\.md)\)", index))
    assert listed == {page.name for page in (DOCS / folder).glob("*.md")} - {"README.md"}


def test_the_glossary_explains_each_term_once():
    terms = [row[0] for row in table_rows((DOCS / "glossary.md").read_text("utf-8")) if row[0] != "term"]
    assert len(terms) > 50 and sorted({*terms}) == sorted(terms)


@cache
def names_in(file):
    """Functions, classes and constants of a module, and `Class.member`."""
    names = set()
    for node in ast.parse(file.read_text("utf-8")).body:
        names |= names_of(node)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{name}" for inner in node.body for name in names_of(inner)}
    return names


def names_of(node):
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {target.id for target in targets if isinstance(target, ast.Name)}


@pages
def test_files_and_names_of_code_exist(page):
    text = page.read_text("utf-8")
    for path, name in re.findall(rf"`((?:{'|'.join(FOLDERS)})/[\w./-]*|labanmesh\.py)(?::([\w.]+))?`", text):
        assert (ROOT / path).exists(), f"{page.name}: {path}"
        assert not name or name in names_in(ROOT / path), f"{page.name}: {path}:{name}"


def test_pages_that_code_names_exist():
    files = [*MODULES, ROOT / "Makefile", ROOT / "pyproject.toml", *(ROOT / "deploy").rglob("*.*")]
    texts = [file.read_text("utf-8") for file in files if file.is_file() and file.suffix != ".pyc"]
    named = {name for text in texts for name in re.findall(r"(?<![\w/])docs/[\w/-]+\.md", text)}
    assert len(named) > 10 and {name for name in named if not (ROOT / name).exists()} == set()


def test_a_class_name_stands_for_one_thing():
    places: dict[str, list[str]] = {}
    for file in MODULES:
        if "tests" not in file.relative_to(ROOT).parts:
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if isinstance(node, ast.ClassDef):
                    places.setdefault(node.name, []).append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


@pages
def test_classes_exist(page):
    classes = set(re.findall(r"`([A-Z][a-z]+(?:[A-Z][a-z]+)+)(?:\.\w+)?`", prose(page)))
    assert page.name == "CHANGELOG.md" or classes <= set(chain(*(names_in(file) for file in MODULES)))


def test_every_package_is_in_the_tree_of_the_readme():
    packages = {path.parent.name + "/" for path in ROOT.glob("*/__init__.py")}
    listed = {row[0].strip("`") for row in table_rows(section(ROOT / "README.md", "The tree"))}
    assert packages <= listed
    assert all((ROOT / name).exists() for name in listed - {"folder"})


def command_lines(page):
    """Words of the commands in shell blocks, and in text blocks after a prompt, without comments and variables."""
    prompts = [line[2:] for text in blocks(page, "text") for line in text.splitlines() if line.startswith("$ ")]
    for line in chain(prompts, *(text.replace("\\\n", " ").splitlines() for text in blocks(page, "sh"))):
        words = [w for w in shlex.split(line, comments=True) if not re.match(r"[A-Z_]+=", w)]
        if words:
            yield words


@cache
def command_of(verb, *words):
    return typer.main.get_command(app_of(verb, words))


def subcommand(words):
    """The command or sub-command that the words begin with, and the words after it."""
    command = command_of(*words)
    inner = getattr(command, "commands", {}).get(words[1]) if len(words) > 1 else None
    return (inner, words[2:]) if inner else (command, words[1:])


def options_of(command):
    return {option for p in command.params for option in (*p.opts, *p.secondary_opts) if option[:1] == "-"}


@pages
def test_commands_in_blocks_are_valid(page):
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
            command, rest = subcommand(words[1:])
            command.make_context(words[1], rest)


@pages
def test_commands_in_the_text_have_known_verbs_and_options(page):
    for line in re.findall(r"`labanmesh\s([^`]+)`", prose(page)):
        words = line.split()
        if words[0] in ("VERB", "--help"):
            continue
        assert words[0] in VERBS, f"{page.name}: labanmesh {line}"
        options = {word for word in words if word.startswith("--")}
        assert options <= options_of(subcommand(words)[0]) | {"--help"}, f"{page.name}: labanmesh {line}"


@pytest.mark.parametrize("verb", VERBS)
def test_the_reference_lists_every_command_and_option(verb):
    page = (REFERENCE / "commands.md").read_text("utf-8")
    assert re.search(rf"^\| `{verb}[` ]", page, re.MULTILINE)
    rows = [row for row in table_rows(page) if {verb, "all", "both"} & set(re.split(r"[, ]+", row[1]))]
    listed = set(re.findall(r"`(-[\w-]+)`", " ".join(row[0] for row in rows)))
    command = command_of(verb)
    for inner in getattr(command, "commands", {verb: command}).values():
        assert options_of(inner) - {"--help"} <= listed


@messages_of_the_mesh
def test_the_schemas_are_those_of_the_models(kind):
    schema = json.loads((REFERENCE / "schema" / f"{kind}.json").read_text("utf-8"))
    assert schema == MESSAGES[kind].model_json_schema(), f"docs/reference/schema/{kind}.json is out of date; {REWRITE}"


def fields_in(text):
    rows = table_rows(text)
    start = next(n for n, row in enumerate(rows) if row[0] == "field")
    return {row[0].strip("`") for row in rows[start + 1 :] if row[0].startswith("`")}


@messages_of_the_mesh
def test_the_reference_lists_every_field(kind):
    text = section(REFERENCE / "wire.md", kind)
    own = set(MESSAGES[kind].model_fields)
    if kind == "verdict":
        own -= set(messages.JudgementMessage.model_fields)
    if kind == "judgement":
        text, votes = text.split("\nA vote:\n")
        assert fields_in(votes.split("| state |")[0]) == set(messages.Vote.model_fields)
    assert fields_in(text) == own


@messages_of_the_mesh
def test_examples_of_messages_are_messages(kind):
    (example,) = re.findall(r"```json\n(.*?)```", section(REFERENCE / "wire.md", kind), re.DOTALL)
    fields = json.loads(example)
    assert set(fields) <= set(MESSAGES[kind].model_fields)
    if kind == "picture":
        fields["jpeg"] = bytes.fromhex(fields["jpeg"].split(".")[0])
    message = decode(MESSAGES[kind], msgpack.packb(fields))
    if kind == "vocabulary":
        assert Vocabulary(tuple(message.labels)).digest == message.hash


DEFAULTS_IN_WORDS = {
    "observers.ID.model": "ID.model",
    "fusion.quorum": "half of the observers",
    "vocabulary": "the models' own",
}


def keys_of(model, prefix=""):
    return {f"{prefix}{name}": field.default for name, field in model.model_fields.items()}


SECTIONS = {
    "mesh": MeshConfig,
    "person": PersonConfig,
    "fusion": FusionConfig,
    "observers": None,
    "observers.ID": ObserverConfig,
    "observers.ID.virtual": VirtualConfig,
    "observers.ID.clips": ClipsConfig,
    "hub": HubConfig,
    "hub.mqtt": MqttConfig,
    "hub.dashboard": DashboardConfig,
    "metrics": MetricsConfig,
    "teaching": TeachingConfig,
}


def test_the_reference_lists_every_key_with_its_default():
    expected = keys_of(Scene)
    for name, model in SECTIONS.items():
        expected |= keys_of(model, f"{name}.") if model else {}
    expected = {key: default for key, default in expected.items() if key not in SECTIONS}
    listed = {row[0].strip("`"): row[1] for row in table_rows(section(REFERENCE / "scene.md", "Every key"))[1:]}
    assert listed.keys() == expected.keys()
    for key, default in expected.items():
        plain = "none" if default is PydanticUndefined else f"`{json.dumps(default)}`"
        assert listed[key].strip("`") == DEFAULTS_IN_WORDS.get(key, plain).strip("`"), key


@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        *(f"docs/{name}.md" for name in ("reference/scene", "reference/wire", "guide/operate", "guide/tutorial")),
    ],
)
def test_the_scene_files_of_the_documents_are_valid(page, tmp_path):
    complete = [text for text in blocks(ROOT / page, "toml") if "scene = " in text]
    assert complete
    for text in complete:
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        read_scene(tmp_path / "scene.toml", {})


@pytest.mark.parametrize(
    "symptom",
    [
        "already in use",
        "alive already",
        "make judgements of up to",
        "no router answers there",
        "do not know certificate",
        "waiting for fusion",
        "waiting for observers",
    ],
)
def test_troubleshooting_quotes_what_a_process_prints(symptom):
    assert symptom in (DOCS / "guide" / "troubleshooting.md").read_text("utf-8")
    assert any(symptom in file.read_text("utf-8") for file in MODULES if "tests" not in file.parts)


def test_the_scene_file_of_init_begins_as_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "dojo.toml"]) == 0
    (shown,) = blocks(DOCS / "guide" / "doctor.md", "toml")
    written = Path("dojo.toml").read_text("utf-8")
    # The line about `labanmesh look` names the first camera of the machine.
    assert all(line in written for line in shown.splitlines() if "labanmesh look" not in line)


def executed(text):
    names = {"__name__": "documented"}
    exec(compile(text, "docs", "exec"), names)  # noqa: S102 - the text is ours
    return names


def test_the_archive_example_is_written_and_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(REFERENCE / "motion.md", "python")
    executed(code)
    assert capsys.readouterr().out == "1 recording\n"
    assert read_archive(Path("mine.npz")).recordings[0].label == "stand"


def test_the_csv_example_is_imported(tmp_path):
    (table,) = blocks(REFERENCE / "motion.md", "csv")
    (tmp_path / "a.csv").write_text(table, encoding="utf-8")
    (recording,) = csv_table.import_files(tmp_path / "a.csv").archive.recordings
    assert recording.label == "wave" and recording.rate_hz == pytest.approx(30, rel=1e-3)
    assert np.isnan(recording.positions[2, 0]).all()


def extension(name):
    (code,) = [text for text in blocks(DESIGN / "extend.md", "python") if name in text]
    return executed(code)


def test_the_example_of_a_model_recognises_movements(monkeypatch):
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


def test_the_other_examples_of_extensions_work(tmp_path):
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


def test_every_dependency_is_listed_with_its_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    text = (DESIGN / "dependencies.md").read_text("utf-8")
    ours = [line for name in ("observer", "report", "capture", "mqtt", "dashboard") for line in extras[name]]
    for requirement in [*project["dependencies"], *ours]:
        name, bounds = re.match(r"([\w-]+)(.*)", requirement.replace(",", ", ")).groups()
        assert re.search(rf"^\| {name} \|.*\| {re.escape(bounds)} \|", text, re.MULTILINE), requirement
