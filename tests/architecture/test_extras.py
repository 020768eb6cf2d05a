"""Each verb imports only what a plain install and its extras bring, from the source and pyproject.toml."""

import re
import sys
import tomllib
from collections import defaultdict
from functools import cache

import pytest
from doc_pages import DOCS
from source_imports import FILES, HOUSE, ROOMS, all_imports

from common import missing_library
from labanmesh import OTHER_FORMS, VERBS

PROVIDED_BY = {"sse_starlette": "sse-starlette", "prometheus_client": "prometheus-client", "zenoh": "eclipse-zenoh",
               "cv2": "opencv-python-headless"}  # fmt: skip
"""Import names that differ from the distribution's name."""
ON_REQUEST = {
    ("hub.dashboard.commands", "common.capture_file"): "dashboard --capture",
    ("observer.model.logistic", "scipy.optimize"): "learn",
    ("observer.motion.importers.florence3d", "scipy.io"): "import florence3d",
    ("observer.model.stacker", "scipy.optimize"): "learn",
    ("studies.report", "studies.figures"): "evaluate --report",
    ("hub.teaching.rehearsal", "studies.performer.cameras"): "teach --rehearse",
}
"""Imports that happen only if the user asks for something that needs another extra; and what the user types."""
STARTED = {
    **{name: verb.module for name, verb in VERBS.items()},
    **{" ".join(key): form.module for key, form in OTHER_FORMS.items()},
}
NOT_VERBS = (
    "labanmesh", "deploy.home-assistant.labanmesh.run", "observer.runtime.preflight",
    "fusion.preflight",
    "labanmesh_testing.plugin",
)  # fmt: skip
"""Modules that no verb imports: programs of their own."""


@cache
def imports_of():
    """What each module imports, at its import or later, also by a name in quotes; not for types alone."""
    of = defaultdict(set)
    for each in all_imports():
        if not each.for_types:
            of[each.by].add(each.of)
    for name in FILES.keys() - {"labanmesh"}:
        named = set(re.findall(r'"(\w+\.[\w.]+)"', FILES[name].read_text(encoding="utf-8")))
        of[name] |= named & FILES.keys() - {*NOT_VERBS}
    return of


def reached(module):
    """All modules of ours that may be imported after `module`, and (by, library) of others. Without ON_REQUEST."""
    modules, libraries, waiting = set(), set(), [module]
    while waiting:
        by = waiting.pop()
        if by not in modules:
            modules.add(by)
            packages = [by.rsplit(".", n)[0] for n in range(1, by.count(".") + 1)]
            wanted = {of for of in imports_of()[by] if (by, of) not in ON_REQUEST}
            waiting += [name for name in (*packages, *wanted) if name in FILES]
            libraries |= {(by, of.partition(".")[0]) for of in wanted - FILES.keys()}
    return modules, {(by, of) for by, of in libraries if of not in (*sys.stdlib_module_names, *ROOMS, "labanmesh")}


@cache
def declared():
    """Per extra ("" for the plain install) the distributions that it adds."""
    project = tomllib.loads((HOUSE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    return {extra: {re.match(r"[\w-]+", line)[0] for line in lines} for extra, lines in groups.items()}


@cache
def documented():
    """Per extra what needs it, as the reference says: verbs, and words that begin with a verb."""
    text = (DOCS / "reference" / "commands.md").read_text("utf-8").partition("\n## Extras\n")[2]
    rows = re.findall(r"^\| `(\w+)` \| ([^|]*) \|", text, re.MULTILINE)
    return {extra: set(re.findall(r"`([^`]+)`", uses)) for extra, uses in rows}


def extra_of(library):
    """The extra that brings a library; "" for the plain install."""
    name = PROVIDED_BY.get(library, library)
    found = [extra for extra, names in declared().items() if name in names and extra != "dev"]
    assert found, f"{library}: no extra of pyproject.toml brings it; declare it or do without"
    return found[0]


@pytest.mark.parametrize("verb", STARTED)
def test_a_verb_imports_only_what_its_extras_bring(verb):
    faults = [
        f"{by} imports {library}: only labanmesh[{extra_of(library)}] brings it, which `labanmesh {verb}` does not "
        "need; import it on use and list that in ON_REQUEST, or add the verb to docs/reference/commands.md, Extras"
        for by, library in sorted(reached(STARTED[verb])[1])
        if extra_of(library) and verb not in documented()[extra_of(library)]
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("verb", STARTED)
def test_the_help_of_a_verb_needs_no_extra(verb):
    modules, faults = [STARTED[verb]], []
    for module in modules:
        at_once = [each for each in all_imports() if each.by == module and each.at_import and not each.for_types]
        modules += [each.of for each in at_once if each.of in FILES and each.of not in modules]
        faults += [f"{each.place} imports {each.of}" for each in at_once if each.top in missing_library.EXTRAS]
    assert not faults, "import it in the function that needs it"


def test_the_pytest_plugin_costs_nothing_until_a_fixture_is_used():
    libraries = {library for _, library in reached("labanmesh_testing.plugin")[1]}
    assert {extra_of(library) for library in libraries} == {"", "testing"}
    at_start = [each for each in all_imports() if each.by in ("labanmesh_testing", "labanmesh_testing.plugin")]
    heavy = {each.of for each in at_start if each.at_import and not each.for_types} - sys.stdlib_module_names
    assert heavy - {"collections.abc"} == {"pytest"}


@pytest.mark.parametrize(("by", "of"), ON_REQUEST)
def test_what_is_imported_on_request_is_documented(by, of):
    assert of in imports_of()[by]
    libraries = reached(of)[1] if of in FILES else {(by, of.partition(".")[0])}
    extras = {extra for _, library in libraries if (extra := extra_of(library))}
    assert extras and all(ON_REQUEST[by, of] in documented()[extra] for extra in extras)


def test_the_reference_names_every_extra_that_a_verb_may_need():
    for extra, uses in documented().items():
        assert extra in declared() and {use.partition(" ")[0] for use in uses} <= {*VERBS, *declared()}
    named = {extra_of(library) for library in missing_library.EXTRAS}
    assert named == set(missing_library.EXTRAS.values()) and named <= documented().keys()
    assert all(missing_library.EXTRAS[library] == extra_of(library) for library in missing_library.EXTRAS)


def test_every_module_belongs_to_a_verb():
    modules = set().union(*(reached(module)[0] for module in (*STARTED.values(), *NOT_VERBS)))
    on_request = set().union(*(reached(of)[0] for _, of in ON_REQUEST if of in FILES))
    unused = FILES.keys() - modules - on_request
    assert not unused, f"nothing imports {sorted(unused)}; remove them, or list a program of its own in NOT_VERBS"
