"""Makes the .task file of MediaPipe's pose landmarker of the models in the npm package @mediapipe/pose; pure.

A .task file is a zip archive of two models. Each states how a byte of the picture becomes a number, which those of
@mediapipe/pose leave to a graph: https://ai.google.dev/edge/litert/conversion/tensorflow/metadata. The new head of a
model lies in front of the old file, which stays as it is.
"""

import io
import struct
import zipfile

from common.errors import BadInput
from hub.phone.flat_buffer import Bytes, Existing, FlatTable, FlatTables, Node, flat_buffer, floats, text

DETECTOR, LANDMARKS = "pose_detector.tflite", "pose_landmarks_detector.tflite"
SCALES = {DETECTOR: (127.5, 127.5), LANDMARKS: (0.0, 255.0)}
"""Mean and deviation of a picture's bytes, as in MediaPipe's graphs pose_detection and pose_landmark."""
MODEL, METADATA = b"TFL3", b"M001"
VERSION, SUBGRAPHS, BUFFERS, METADATA_LIST = 0, 2, 4, 6
"""Slots of a model (tensorflow/lite/schema/schema.fbs)."""
MODEL_SLOTS = 8
OUTPUTS = 2
"""Slot of a graph."""
IMAGE, NORMALIZATION, RGB = 2, 1, 1
"""ContentProperties, ProcessUnitOptions and ColorSpaceType in metadata_schema.fbs."""
ANY_DATE = (1980, 1, 1, 0, 0, 0)
"""Without a date of its own the same models make the same file."""


def pose_task(detector: bytes, landmarks: bytes) -> bytes:
    """The .task file of a detector and a model of landmarks; raises BadInput for bytes that are no such models."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as task:
        for name, model in ((DETECTOR, detector), (LANDMARKS, landmarks)):
            task.writestr(zipfile.ZipInfo(name, ANY_DATE), with_scale(model, *SCALES[name]))
    return buffer.getvalue()


def with_scale(model: bytes, mean: float, deviation: float) -> bytes:
    """The model with metadata: (byte - mean) / deviation is what goes in."""
    try:
        return _with_scale(model, mean, deviation)
    except (struct.error, IndexError):
        raise BadInput("a pose model is damaged: no TensorFlow Lite file") from None


def _with_scale(model: bytes, mean: float, deviation: float) -> bytes:
    if model[4:8] != MODEL:
        raise IndexError
    root = _reference(model, 0)
    fields: dict[int, int | Node] = {
        slot: Existing(_reference(model, place))
        for slot in range(1, MODEL_SLOTS)
        if (place := _field(model, root, slot)) is not None
    }
    version = _field(model, root, VERSION)
    fields[VERSION] = 0 if version is None else _number(model, version)
    graph = _items(model, root, SUBGRAPHS)[0]
    metadata = _metadata(len(_vector(model, graph, OUTPUTS)), mean, deviation)
    buffers = _items(model, root, BUFFERS)
    fields[BUFFERS] = FlatTables([*map(Existing, buffers), FlatTable({0: Bytes(metadata, len(metadata))})])
    earlier = _items(model, root, METADATA_LIST)
    fields[METADATA_LIST] = FlatTables(
        [*map(Existing, earlier), FlatTable({0: text("TFLITE_METADATA"), 1: len(buffers)})]
    )
    return flat_buffer(FlatTable(fields), MODEL, model)


def _metadata(outputs: int, mean: float, deviation: float) -> bytes:
    numbers = FlatTable({0: floats(mean), 1: floats(deviation)})
    image = FlatTable({0: IMAGE, 1: FlatTable({0: RGB})})
    picture = FlatTable({3: image, 4: FlatTables([FlatTable({0: NORMALIZATION, 1: numbers})])})
    graph = FlatTable({2: FlatTables([picture]), 3: FlatTables([FlatTable({}) for _ in range(outputs)])})
    return flat_buffer(FlatTable({3: FlatTables([graph])}), METADATA)


def _number(content: bytes, place: int) -> int:
    return int(struct.unpack_from("<I", content, place)[0])


def _reference(content: bytes, place: int) -> int:
    return place + _number(content, place)


def _field(content: bytes, table: int, slot: int) -> int | None:
    """Where a field of the table lies; None: it has its default."""
    vtable = table - int(struct.unpack_from("<i", content, table)[0])
    if 4 + 2 * slot >= struct.unpack_from("<H", content, vtable)[0]:
        return None
    distance = int(struct.unpack_from("<H", content, vtable + 4 + 2 * slot)[0])
    return table + distance if distance else None


def _vector(content: bytes, table: int, slot: int) -> range:
    """Where the items of a vector lie, four bytes each."""
    place = _field(content, table, slot)
    if place is None:
        return range(0)
    start = _reference(content, place)
    return range(start + 4, start + 4 + 4 * _number(content, start), 4)


def _items(content: bytes, table: int, slot: int) -> list[int]:
    """Where the tables of a vector begin."""
    return [_reference(content, place) for place in _vector(content, table, slot)]
