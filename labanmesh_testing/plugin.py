"""The fixtures that pytest finds by the entry point `labanmesh`. Everything else is imported when one is used."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from labanmesh_testing.running_scene import SceneStarter


@pytest.fixture
def laban_scene(tmp_path: Path) -> "Iterator[SceneStarter]":
    """Starts scenes that end with the test: `laban_scene(labels, observers)` (docs/guide/testing.md)."""
    import labanmesh

    # A project may well have a package `common` of its own, which pytest puts first.
    if hidden := labanmesh.shadowed():
        pytest.fail(f"laban_scene: {hidden}", pytrace=False)
    from labanmesh_testing.running_scene import SceneStarter

    with ExitStack() as opened:
        yield SceneStarter(tmp_path, opened)
