"""What installed packages add to labanmesh by entry points, as in `[project.entry-points."labanmesh.rules"]`.

docs/design/extend.md says what each group holds. Our own names come first: a package cannot replace one of them. The
entry points are looked up only for a name that is not ours, because that takes longer than most imports.
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Literal

from common.errors import LabanmeshError

Group = Literal["rules", "trackers", "models", "verbs"]


def plugins(group: Group) -> dict[str, EntryPoint]:
    """The entry points of a group, by name."""
    return {each.name: each for each in entry_points(group=f"labanmesh.{group}")}


def plugin(group: Group, name: str) -> object | None:
    """What an installed package adds under that name; None if none does.

    Raises LabanmeshError, one line that names the package, if it cannot be imported.
    """
    entry = plugins(group).get(name)
    if entry is None:
        return None
    try:
        loaded: object = entry.load()
        return loaded
    except Exception as error:  # a package of others may fail in any way
        package = entry.dist.name if entry.dist else entry.value
        raise LabanmeshError(f"{package}: its {name!r} cannot be loaded: {type(error).__name__}: {error}") from error
