"""Makes the .task file of MediaPipe's pose landmarker of the models in the npm package @mediapipe/pose; pure.

A .task file is a zip archive of two models. Each states how a byte of the picture becomes a number, which those of
@mediapipe/pose leave to a graph: https://ai.google.dev/edge/litert/conversion/tensorflow/metadata.
"""

import io
import struct
import zipfile

from common import tflite
from common.errors import BadInput
from common.tflite import Bytes, Existing, FlatTable, FlatTables, Node, flat_buffer, floats, text

DETECTOR, LANDMARKS = "pose_detector.tflite", "pose_landmarks_detector.tflite"
SCALES = {DETECTOR: (127.5, 127.5), LANDMARKS: (0.0, 255.0)}
"""Mean and deviation of a picture's bytes, as in MediaPipe's graphs pose_detection and pose_landmark."""
METADATA = b"M001"
BUFFERS, METADATA_LIST = 4, 6
"""Slots of a model (tensorflow/lite/schema/schema.fbs)."""
IMAGE, NORMALIZATION, RGB = 2, 1, 1
"""ContentProperties, ProcessUnitOptions and ColorSpaceType in metadata_schema.fbs."""


def pose_task(detector: bytes, landmarks: bytes) -> bytes:
    """The .task file of a detector and a model of landmarks; raises BadInput for bytes that are no such models."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as task:
        for name, model in ((DETECTOR, detector), (LANDMARKS, landmarks)):
            task.writestr(zipfile.ZipInfo(name, tflite.ANY_DATE), with_scale(model, *SCALES[name]))
    return buffer.getvalue()


def with_scale(model: bytes, mean: float, deviation: float) -> bytes:
    """The model with metadata: (byte - mean) / deviation is what goes in."""
    try:
        return _with_scale(model, mean, deviation)
    except (struct.error, IndexError):
        raise BadInput("a pose model is damaged: no TensorFlow Lite file") from None


def _with_scale(model: bytes, mean: float, deviation: float) -> bytes:
    if model[4:8] != tflite.MODEL:
        raise IndexError
    root = tflite.reference(model, 0)
    graph = tflite.items(model, root, tflite.SUBGRAPHS)[0]
    metadata = _metadata(len(tflite.vector(model, graph, tflite.OUTPUTS)), mean, deviation)
    buffers, earlier = (tflite.items(model, root, slot) for slot in (BUFFERS, METADATA_LIST))
    entry = FlatTable({0: text("TFLITE_METADATA"), 1: len(buffers)})
    changed: dict[int, Node] = {
        BUFFERS: FlatTables([*map(Existing, buffers), FlatTable({0: Bytes(metadata, len(metadata))})]),
        METADATA_LIST: FlatTables([*map(Existing, earlier), entry]),
    }
    return tflite.with_fields(model, changed)


def _metadata(outputs: int, mean: float, deviation: float) -> bytes:
    numbers = FlatTable({0: floats(mean), 1: floats(deviation)})
    image = FlatTable({0: IMAGE, 1: FlatTable({0: RGB})})
    picture = FlatTable({3: image, 4: FlatTables([FlatTable({0: NORMALIZATION, 1: numbers})])})
    graph = FlatTable({2: FlatTables([picture]), 3: FlatTables([FlatTable({}) for _ in range(outputs)])})
    return flat_buffer(FlatTable({3: FlatTables([graph])}), METADATA)
