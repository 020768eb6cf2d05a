"""Fixtures of tests with real Zenoh peers; what they are made of is in mesh_stage.py."""

import pytest

from labanmesh_testing.mesh import Mesh


@pytest.fixture
def mesh(scene):
    """The mesh of the test's own `scene`, with one link where the others meet."""
    opened = Mesh(scene.mesh)
    yield opened
    opened.close()
