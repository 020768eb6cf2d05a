"""Makes a pose landmarker .task file of the two models in a wheel of mediapipe 0.10.21, for versions that carry none.

    pip download --no-deps --python-version 3.12 --platform manylinux_2_28_x86_64 --only-binary :all: mediapipe==0.10.21
    python -P -m observer.tracking.task_file mediapipe-0.10.21-*.whl pose.task

A .task file is a zip archive. Its models state how a byte of the picture becomes a number, which those in the wheel
leave to mediapipe's graphs: https://ai.google.dev/edge/litert/conversion/tensorflow/metadata
"""

import importlib
import io
import sys
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import BadInput, LabanmeshError, reason_of
from common.tracker_choice import INSTALL_MEDIAPIPE
from observer.files import write_file

MODULES_FOLDER = "mediapipe/modules"
TASK_MODELS: Mapping[str, tuple[str, float, float]] = {
    "pose_detector.tflite": ("pose_detection/pose_detection.tflite", 127.5, 127.5),
    "pose_landmarks_detector.tflite": ("pose_landmark/pose_landmark_full.tflite", 0.0, 255.0),
}
"""Name in the .task file -> file in the wheel, and the mean and deviation of its bytes."""
ALIGNED = 16
"""Bytes; TensorFlow Lite wants weights at multiples of it."""


def task_file(models: Mapping[str, bytes]) -> bytes:
    """The .task file of models by their names in TASK_MODELS. Raises BadInput without mediapipe."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as task:
        for name, (_, mean, deviation) in TASK_MODELS.items():
            task.writestr(name, _scaled(models[name], mean, deviation))
    return buffer.getvalue()


def models_in(wheel: Path) -> dict[str, bytes]:
    """The models of a wheel; raises BadInput for a file that has none."""
    try:
        with zipfile.ZipFile(wheel) as archive:
            return {name: archive.read(f"{MODULES_FOLDER}/{file}") for name, (file, _, _) in TASK_MODELS.items()}
    except OSError as error:
        raise BadInput(f"{wheel}: {reason_of(error)}") from None
    except (zipfile.BadZipFile, KeyError):
        raise BadInput(f"{wheel}: no wheel with a pose model; mediapipe 0.10.21 has one") from None


def _scaled(model: bytes, mean: float, deviation: float) -> bytes:
    """The model with metadata: (byte - mean) / deviation is what goes in."""
    flatbuffers, schema = _imported("flatbuffers"), _imported("mediapipe.tasks.metadata.schema_py_generated")
    unpacked = schema.ModelT.InitFromObj(schema.Model.GetRootAsModel(bytearray(model), 0))
    unpacked.buffers.append(schema.BufferT())
    unpacked.buffers[-1].data = np.frombuffer(_metadata(len(unpacked.subgraphs[0].outputs), mean, deviation), np.uint8)
    entry = schema.MetadataT()
    entry.name, entry.buffer = "TFLITE_METADATA", len(unpacked.buffers) - 1
    unpacked.metadata = [*(unpacked.metadata or []), entry]
    unpacked.buffers = [_AlignedBuffer(schema, buffer.data) for buffer in unpacked.buffers]
    builder = flatbuffers.Builder(2 * len(model))
    builder.Finish(unpacked.Pack(builder), b"TFL3")
    return bytes(builder.Output())


class _AlignedBuffer:
    """A buffer of weights that is packed at a multiple of ALIGNED, which the generated class does not."""

    def __init__(self, schema: Any, data: Any) -> None:  # noqa: ANN401 - generated code without types
        self._schema, self._data = schema, b"" if data is None else np.asarray(data, np.uint8).tobytes()

    def Pack(self, builder: Any) -> int:  # noqa: ANN401, N802 - called by generated code
        """Its place in the file."""
        place, length = 0, len(self._data)
        if length:
            builder.StartVector(1, length, ALIGNED)
            builder.head -= length
            builder.Bytes[builder.head : builder.head + length] = self._data
            place = builder.EndVector()
        self._schema.BufferStart(builder)
        if length:
            self._schema.BufferAddData(builder, place)
        return int(self._schema.BufferEnd(builder))


def _metadata(outputs: int, mean: float, deviation: float) -> bytes:
    flatbuffers, schema = _imported("flatbuffers"), _imported("mediapipe.tasks.metadata.metadata_schema_py_generated")
    numbers, step = schema.NormalizationOptionsT(), schema.ProcessUnitT()
    numbers.mean, numbers.std = [mean], [deviation]
    step.optionsType, step.options = schema.ProcessUnitOptions.NormalizationOptions, numbers
    image, picture = schema.ContentT(), schema.TensorMetadataT()
    image.contentPropertiesType = schema.ContentProperties.ImageProperties
    image.contentProperties = schema.ImagePropertiesT()
    image.contentProperties.colorSpace = schema.ColorSpaceType.RGB
    picture.content, picture.processUnits = image, [step]
    graph, whole = schema.SubGraphMetadataT(), schema.ModelMetadataT()
    graph.inputTensorMetadata = [picture]
    graph.outputTensorMetadata = [schema.TensorMetadataT() for _ in range(outputs)]
    whole.subgraphMetadata = [graph]
    builder = flatbuffers.Builder(0)
    builder.Finish(whole.Pack(builder), b"M001")
    return bytes(builder.Output())


def _imported(name: str) -> Any:  # noqa: ANN401 - mediapipe has no types
    try:
        return importlib.import_module(name)
    except ImportError:
        raise BadInput(f"{name} is missing: {INSTALL_MEDIAPIPE}") from None


def main(words: Sequence[str]) -> str:
    """Make the file; words: the wheel and the file to write. Returns what was done, one line."""
    if len(words) != 2:
        raise BadInput("name the wheel of mediapipe 0.10.21 and the .task file to write")
    wheel, output = map(Path, words)
    content = task_file(models_in(wheel))
    write_file(output, content, "Choose another path")
    return f'{output}: {len(content) / 1e6:.1f} MB; set pose_model = "{output}" in the observer\'s section'


if __name__ == "__main__":
    try:
        print(main(sys.argv[1:]))
    except LabanmeshError as fault:
        sys.exit(f"labanmesh: {fault}")
