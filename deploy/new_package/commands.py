"""The verb `labanmesh new`: a package of one's own that works, with its test, to be changed."""

import keyword
import re
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Annotated

import typer

from common.errors import BadInput, LabanmeshError, reason_of

ENTRY_POINT_GROUPS = {"observer": "verbs", "hub": "verbs", "rule": "rules"}
"""The group of entry points in which labanmesh looks for each kind of package."""
PACKAGE_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")


def new(
    kind: Annotated[str, typer.Argument(help="observer, hub or rule.")],
    name: Annotated[str, typer.Argument(help="What it is called: lower case letters, digits, underscores.")],
    folder: Annotated[Path | None, typer.Option("-o", "--output", help="The new folder; default: NAME.")] = None,
) -> None:
    """Write a small package of your own that extends labanmesh: pyproject.toml, one module and its test.

    observer: posteriors from a sensor of your own. hub: a program that reacts to verdicts. rule: another way to pool
    posteriors.

    Example: labanmesh new hub lamp
    """
    target = folder or Path(name)
    texts = package(kind, name)
    if target.exists():
        raise BadInput(f"{target}: exists already and is not overwritten; name another folder with -o")
    try:
        target.mkdir(parents=True)
        for file, text in texts.items():
            (target / file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise LabanmeshError(f"cannot write {target}: {reason_of(error)}. Name another folder with -o") from None
    typer.echo(f"wrote {', '.join(f'{target}/{file}' for file in texts)}; then:")
    typer.echo(f"  pip install -e '{target}[test]' && pytest {target}")
    use = f'in the scene file: [fusion] rule = "{name}"' if kind == "rule" else f"labanmesh {name} scene.toml"
    typer.echo(f"  {use}")


def package(kind: str, name: str) -> dict[str, str]:
    """The files of a new package, by name; raises BadInput for an unknown kind and for a name that cannot be used."""
    if kind not in ENTRY_POINT_GROUPS:
        raise BadInput(f"{kind!r}: observer, hub or rule is expected")
    if not PACKAGE_NAME.fullmatch(name) or keyword.iskeyword(name):
        raise BadInput(f"{name!r}: lower case letters, digits and underscores, 32 at most, a letter first")
    skeletons = files("deploy.new_package") / "skeletons"
    words = {"name": name, "group": ENTRY_POINT_GROUPS[kind], "object": "RULE" if kind == "rule" else name}
    return {
        file: Template((skeletons / f"{skeleton}.txt").read_text(encoding="utf-8")).substitute(words)
        for file, skeleton in (
            ("pyproject.toml", "pyproject"),
            (f"labanmesh_{name}.py", kind),
            (f"test_labanmesh_{name}.py", f"{kind}_test"),
        )
    }
