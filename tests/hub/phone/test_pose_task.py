"""The pose model's file for the browser, made of models without metadata."""

import io
import struct
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_pose_model import model

from common.errors import BadInput
from hub.phone.flat_buffer import Existing, FlatTable, flat_buffer, floats
from hub.phone.pose_task import BUFFERS, METADATA_LIST, _field, _items, _number, _reference, pose_task, with_scale


def string_at(content, place):
    start = _reference(content, place)
    return content[start + 4 : start + 4 + _number(content, start)]


@given(st.integers(1, 6), st.integers(1, 5))
def test_a_model_keeps_all_it_has_and_gets_metadata(outputs, buffers):
    old = model(outputs, buffers)
    new = with_scale(old, 127.5, 2.5)
    assert new.endswith(old) and new[4:8] == b"TFL3" and (len(new) - len(old)) % 16 == 0
    root = _reference(new, 0)
    assert _number(new, _field(new, root, 0)) == 3 and string_at(new, _field(new, root, 3)) == b"a model"
    held = _items(new, root, BUFFERS)
    assert len(held) == buffers + 1
    for number in range(1, buffers):
        place = _reference(new, _field(new, held[number], 0))
        assert new[place + 4 : place + 44] == bytes([number]) * 40 and (place + 4) % 16 == 0
    [entry] = _items(new, root, METADATA_LIST)
    assert string_at(new, _field(new, entry, 0)) == b"TFLITE_METADATA"
    assert _number(new, _field(new, entry, 1)) == buffers
    metadata = string_at(new, _field(new, held[buffers], 0))
    assert metadata[4:8] == b"M001" and struct.pack("<f", 127.5) in metadata and struct.pack("<f", 2.5) in metadata


def test_the_same_models_make_the_same_file():
    task = pose_task(model(), model(5))
    assert task == pose_task(model(), model(5))
    with zipfile.ZipFile(io.BytesIO(task)) as archive:
        assert archive.namelist() == ["pose_detector.tflite", "pose_landmarks_detector.tflite"]
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}


@pytest.mark.parametrize("content", [b"", b"no model at all", b"\xff\xff\xff\x7fTFL3", b"\x08\0\0\0TFL3", b"\0" * 64])
def test_another_file_is_one_line(content):
    with pytest.raises(BadInput, match="damaged"):
        with_scale(content, 0, 1)


def test_a_reference_to_the_older_file_is_found_behind_the_new_one():
    older = flat_buffer(FlatTable({0: 7}), b"OLD1")
    new = flat_buffer(FlatTable({0: Existing(_reference(older, 0)), 1: floats(1.0)}), b"NEW1", older)
    table = _reference(new, _field(new, _reference(new, 0), 0))
    assert _number(new, _field(new, table, 0)) == 7


def test_mediapipe_finds_the_same_metadata():
    """Its own library, where it is installed, reads what is written here."""
    schema = pytest.importorskip("mediapipe.tasks.metadata.metadata_schema_py_generated")
    from hub.phone.pose_task import _metadata

    whole = schema.ModelMetadataT.InitFromObj(
        schema.ModelMetadata.GetRootAsModelMetadata(bytearray(_metadata(2, 127.5, 2.5)), 0)
    )
    [graph] = whole.subgraphMetadata
    [picture] = graph.inputTensorMetadata
    assert len(graph.outputTensorMetadata) == 2
    assert picture.processUnits[0].options.mean == [127.5] and picture.processUnits[0].options.std == [2.5]
    assert picture.content.contentProperties.colorSpace == schema.ColorSpaceType.RGB
