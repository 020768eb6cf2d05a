"""The documents agree with the code: links and names exist, commands are valid, lists are complete."""

import ast
import json
import re
import shlex
import tomllib
from functools import cache
from itertools import chain

import msgpack
import pytest
import typer
from doc_pages import DOCS, ROOT, blocks
from message_fields_of import field_names
from public_surface import COMPLETION, MESSAGES, MODELS, REWRITE, SURFACE, completion, surface
from pydantic_core import PydanticUndefined
from source_imports import ROOMS

from common import messages
from common.config import Scene
from common.config_hub import DashboardConfig, HistoryConfig, HubConfig, MqttConfig, NotifyConfig
from common.config_people import FallenConfig, PeopleConfig, WatchConfig
from common.config_sections import (
    ClipsConfig,
    FusionConfig,
    MeshConfig,
    MetricsConfig,
    ObserverConfig,
    PersonConfig,
    TeachingConfig,
)
from common.vocabulary import Vocabulary
from common.wire import decode
from labanmesh import VERBS, app_of

REFERENCE = DOCS / "reference"
DESIGN = DOCS / "design"
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")])
SHELL = {".", "cd", "mkdir"}
"""Shell commands that a block may contain besides ours."""
FOLDERS = (*ROOMS, "examples", "benchmarks", "tests")
MODULES = [ROOT / "labanmesh.py", *chain(*((ROOT / folder).rglob("*.py") for folder in FOLDERS))]

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
messages_of_the_mesh = pytest.mark.parametrize("kind", MESSAGES)


def prose(page):
    return re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)


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


@cache
def classes():
    """The places of each class that the code defines; by their lines, to parse no file."""
    places: dict[str, list[str]] = {}
    for file in MODULES:
        for name in re.findall(r"^ *class (\w+)[(:]", file.read_text("utf-8"), re.MULTILINE):
            places.setdefault(name, []).append(str(file.relative_to(ROOT)))
    return places


def test_a_class_name_stands_for_one_thing():
    own = {name: [file for file in files if not file.startswith("tests/")] for name, files in classes().items()}
    assert {name: files for name, files in own.items() if len(files) > 1} == {}


@pages
def test_classes_exist(page):
    named = set(re.findall(r"`([A-Z][a-z]+(?:[A-Z][a-z]+)+)(?:\.\w+)?`", prose(page)))
    assert page.name == "CHANGELOG.md" or named <= classes().keys()


def test_every_package_is_in_the_tree_of_the_readme():
    packages = {path.parent.name + "/" for path in ROOT.glob("*/__init__.py")}
    listed = {row[0].strip("`") for row in table_rows(section(DOCS / "design" / "README.md", "The tree"))}
    assert packages <= listed
    assert all((ROOT / name).exists() for name in listed - {"folder"})


def command_lines(page):
    """Words of the commands in shell blocks, and in text blocks after a prompt, without comments and variables."""
    prompts = [line[2:] for text in blocks(page, "text") for line in text.splitlines() if line.startswith("$ ")]
    for line in chain(prompts, *(text.replace("\\\n", " ").splitlines() for text in blocks(page, "sh"))):
        words = [w for w in shlex.split(line, comments=True) if not re.match(r"[A-Z_0-9]+=", w)]
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
            module = ROOT / words[2].replace(".", "/")
            assert (module / "__main__.py").exists() or module.with_suffix(".py").exists(), words
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
    assert re.search(rf"^\| `{verb}[` ]", page, re.MULTILINE), f"docs/reference/commands.md lacks the row `{verb}`"
    rows = [row for row in table_rows(page) if {verb, "all", "both"} & set(re.split(r"[, ]+", row[1]))]
    listed = set(re.findall(r"`(-[\w-]+)`", " ".join(row[0] for row in rows)))
    command = command_of(verb)
    for inner in getattr(command, "commands", {verb: command}).values():
        assert options_of(inner) - {"--help"} <= listed


def in_order(schema):
    """The schema with its alternatives in one order: that of msgspec depends on its version."""
    if isinstance(schema, dict):
        return {name: sorted(map(str, part)) if name == "anyOf" else in_order(part) for name, part in schema.items()}
    return schema


@pytest.mark.parametrize("name", MODELS)
def test_the_schemas_are_those_of_the_models(name):
    schema = json.loads((REFERENCE / "schema" / f"{name}.json").read_text("utf-8"))
    current = json.loads(json.dumps(MODELS[name].model_json_schema()))
    assert in_order(schema) == in_order(current), f"docs/reference/schema/{name}.json is out of date; {REWRITE}"


def test_the_command_line_is_the_one_that_is_written_down():
    assert SURFACE.read_text("utf-8").splitlines() == surface().splitlines(), REWRITE
    assert COMPLETION.read_text("utf-8") == completion(), REWRITE


def fields_in(text):
    rows = table_rows(text)
    start = next(n for n, row in enumerate(rows) if row[0] == "field")
    return {row[0].strip("`") for row in rows[start + 1 :] if row[0].startswith("`")}


@messages_of_the_mesh
def test_the_reference_lists_every_field(kind):
    text = section(REFERENCE / "wire.md", kind)
    own = set(field_names(MESSAGES[kind]))
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
    assert set(fields) <= set(field_names(MESSAGES[kind]))
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
    "people": PeopleConfig,
    "fusion": FusionConfig,
    "observers": None,
    "observers.ID": ObserverConfig,
    "observers.ID.clips": ClipsConfig,
    "hub": HubConfig,
    "hub.mqtt": MqttConfig,
    "hub.dashboard": DashboardConfig,
    "metrics": MetricsConfig,
    "teaching": TeachingConfig,
    "watch": WatchConfig,
    "history": HistoryConfig,
    "notify": None,
    "notify.NAME": NotifyConfig,
    "watch.fallen": FallenConfig,
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
    assert any(symptom in file.read_text("utf-8") for file in MODULES if (ROOT / "tests") not in file.parents)


def test_every_dependency_is_listed_with_its_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    text = (DESIGN / "dependencies.md").read_text("utf-8")
    ours = [line for name in ("observer", "report", "capture", "mqtt", "dashboard") for line in extras[name]]
    for requirement in [*project["dependencies"], *ours]:
        name, bounds = re.match(r"([\w-]+)(.*)", requirement.replace(",", ", ")).groups()
        assert re.search(rf"^\| {name} \|.*\| {re.escape(bounds)} \|", text, re.MULTILINE), requirement
