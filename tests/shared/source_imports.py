"""The imports of our modules, from their source."""

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple

HOUSE = Path(__file__).parents[2]
ROOMS = ("common", "observer", "fusion", "hub", "studies", "deploy", "labanmesh_testing")


class Import(NamedTuple):
    """One import: the module, what it imports, the line, and whether it runs when the module is imported."""

    by: str
    of: str
    line: int
    at_import: bool
    for_types: bool

    @property
    def top(self):
        return self.of.partition(".")[0]

    @property
    def place(self):
        return f"{self.by} line {self.line}"


def module_name(path):
    parts = path.relative_to(HOUSE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(p): p for p in [HOUSE / "labanmesh.py", *(f for r in ROOMS for f in (HOUSE / r).rglob("*.py"))]}


@cache
def trees():
    """The syntax tree of each module. Not at import: every worker imports this file, and one runs its tests."""
    return {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in FILES.items()}


def imports_in(module, node, at_import=True, for_types=False):
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            continue  # an expression holds no import
        inside = at_import and not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
        types = for_types or (isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test))
        if isinstance(child, ast.Import):
            for alias in child.names:
                yield Import(module, alias.name, child.lineno, at_import, for_types)
        elif isinstance(child, ast.ImportFrom):
            assert child.level == 0, f"{module} line {child.lineno}: import by the full name, not by dots"
            for alias in child.names:
                whole = f"{child.module}.{alias.name}"
                of = whole if whole in FILES else child.module
                yield Import(module, of, child.lineno, at_import, for_types)
        else:
            yield from imports_in(module, child, inside, types)


@cache
def all_imports():
    return [each for name, tree in trees().items() for each in imports_in(name, tree)]
