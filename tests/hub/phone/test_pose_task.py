"""The pose model's file for the browser, made of models without metadata."""

import io
import struct
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_pose_model import model, pose_model

from common import tflite
from common.errors import BadInput
from common.tflite import Existing, FlatTable, field_place, flat_buffer, floats, items, number, reference
from hub.phone.pose_task import BUFFERS, METADATA_LIST, pose_task, with_scale


def string_at(content, place):
    start = reference(content, place)
    return content[start + 4 : start + 4 + number(content, start)]


@given(st.integers(1, 6), st.integers(1, 5))
def test_a_model_keeps_all_it_has_and_gets_metadata(outputs, buffers):
    old = model(outputs, buffers)
    new = with_scale(old, 127.5, 2.5)
    assert new.endswith(old) and new[4:8] == b"TFL3" and (len(new) - len(old)) % 16 == 0
    root = reference(new, 0)
    assert number(new, field_place(new, root, 0)) == 3 and string_at(new, field_place(new, root, 3)) == b"a model"
    held = items(new, root, BUFFERS)
    assert len(held) == buffers + 1
    for buffer in range(1, buffers):
        place = reference(new, field_place(new, held[buffer], 0))
        assert new[place + 4 : place + 44] == bytes([buffer]) * 40 and (place + 4) % 16 == 0
    [entry] = items(new, root, METADATA_LIST)
    assert string_at(new, field_place(new, entry, 0)) == b"TFLITE_METADATA"
    assert number(new, field_place(new, entry, 1)) == buffers
    metadata = string_at(new, field_place(new, held[buffers], 0))
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
    new = flat_buffer(FlatTable({0: Existing(reference(older, 0)), 1: floats(1.0)}), b"NEW1", older)
    table = reference(new, field_place(new, reference(new, 0), 0))
    assert number(new, field_place(new, table, 0)) == 7


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


def test_nothing_is_left_in_that_only_draws_the_outline():
    old = pose_model([1, 256, 256, 1])
    new = tflite.without_outline(old)
    root = reference(new, 0)
    [graph] = items(new, root, tflite.SUBGRAPHS)
    assert tflite.whole_numbers(new, graph, tflite.OUTPUTS) == [3, 4, 4, 6, 7]
    done = [tflite.whole_numbers(new, each, tflite.WRITES) for each in items(new, graph, tflite.OPERATIONS)]
    assert done == [[1], [3, 4], [6], [7]], "in their order, without those that make 2 and 5"
    assert new.endswith(old) and number(new, field_place(new, root, 0)) == 3


@pytest.mark.parametrize("other", [b"", b"no model", model(), model(5)])
def test_another_model_stays_as_it_is(other):
    assert tflite.without_outline(other) == tflite.task_without_outline(other) == other
    small = pose_model([1, 64, 64, 1])
    assert tflite.without_outline(small) == small


def test_the_real_models_lose_their_outline_alone():
    from hub.phone.pose_model_file import data_folder

    file = data_folder() / "pose_lite.task"
    if not file.is_file():
        pytest.skip("no pose model here: labanmesh phone --fetch")
    task = file.read_bytes()
    before, after = (zipfile.ZipFile(io.BytesIO(each)) for each in (task, tflite.task_without_outline(task)))
    detector, landmarks = before.namelist()
    assert after.read(detector) == before.read(detector)
    counts = [len(items(m, items(m, reference(m, 0), 2)[0], 3)) for m in (z.read(landmarks) for z in (before, after))]
    assert counts == [305, 258]
