"""Fixtures of tests with real Zenoh peers; what they are made of is in mesh_stage.py."""

import mesh_stage
import pytest


@pytest.fixture
def mesh(scene):
    """The mesh of the test's own `scene`, with one link where the others meet."""
    opened = mesh_stage.Mesh(scene.mesh)
    yield opened
    opened.close()
