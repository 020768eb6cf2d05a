"""Inputs and outputs that an ONNX file declares, read without the onnx package.

The file is a protocol buffer: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto. Only the messages on the way from
the model to its tensors are read; weights are skipped.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from common.errors import BadInput, reason_of
from common.tracker_choice import ONNX

GRAPH, INITIALIZER, INPUT, OUTPUT = 7, 5, 11, 12
"""Fields of ModelProto (graph) and of GraphProto."""
ELEMENT_TYPES = {1: "float32", 2: "uint8", 6: "int32", 7: "int64", 10: "float16"}
"""TensorProto.DataType, as far as pictures come in them."""
EXPECTED = "an .onnx file of a pose model is expected"


@dataclass(frozen=True, slots=True)
class Tensor:
    """shape: None for a size that the file leaves open. kind: a name of numpy, "" for another."""

    name: str
    shape: tuple[int | None, ...]
    kind: str


@dataclass(frozen=True, slots=True)
class Signature:
    """What goes into a model and what comes out."""

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]

    def __str__(self) -> str:
        ins, outs = (
            ", ".join("x".join(str(n or "?") for n in t.shape) for t in ts) for ts in (self.inputs, self.outputs)
        )
        return f"{ins} to {outs}"


def read_signature(path: Path) -> Signature:
    """The signature of the model in a file; raises BadInput, one line, for a missing file and for another file."""
    if path.suffix != ONNX:
        raise BadInput(
            f'the tracker onnx needs a model file: pose_model = "FILE{ONNX}" (look: --pose-model FILE{ONNX})'
        )
    try:
        data = memoryview(path.read_bytes())
    except OSError as error:
        raise BadInput(f"pose_model = {str(path)!r}: {reason_of(error)}; {EXPECTED}") from None
    try:
        (graph,) = [value for field, value in _fields(data) if field == GRAPH]
        fields = list(_fields(_message(graph)))
        weights = {_text(_first(_message(value), 8)) for field, value in fields if field == INITIALIZER}
        inputs, outputs = ([_tensor(_message(v)) for f, v in fields if f == kind] for kind in (INPUT, OUTPUT))
        signature = Signature(tuple(t for t in inputs if t.name not in weights), tuple(outputs))
    except (ValueError, IndexError, UnicodeDecodeError):
        raise BadInput(f"pose_model = {str(path)!r}: not an ONNX file; {EXPECTED}") from None
    if not (signature.inputs and signature.outputs):
        raise BadInput(f"pose_model = {str(path)!r}: a model without inputs or outputs; {EXPECTED}")
    return signature


def _tensor(message: memoryview) -> Tensor:
    """Of a ValueInfoProto: name 1, type 2 (tensor_type 1: elem_type 1, shape 2: dim 1: dim_value 1)."""
    tensor = _message(_first(_message(_first(message, 2)), 1))
    sizes = [_sizes(_message(dim)) for field, dim in _fields(_message(_first(tensor, 2, b""))) if field == 1]
    kind = _first(tensor, 1, 0)
    return Tensor(_text(_first(message, 1)), tuple(sizes), ELEMENT_TYPES.get(kind, "") if isinstance(kind, int) else "")


def _sizes(dim: memoryview) -> int | None:
    size = _first(dim, 1, 0)
    return size if isinstance(size, int) and size > 0 else None


def _first(message: memoryview, wanted: int, default: int | bytes | None = None) -> int | memoryview:
    for field, value in _fields(message):
        if field == wanted:
            return value
    if default is None:
        raise ValueError(f"field {wanted} is missing")
    return default if isinstance(default, int) else memoryview(default)


def _message(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise ValueError("a number where a message is expected")
    return value


def _text(value: int | memoryview) -> str:
    return bytes(_message(value)).decode()


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """The fields of a message: numbers, and the bytes of everything else."""
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        field, wire = tag >> 3, tag & 7
        if wire == 0:
            number, at = _varint(message, at)
            yield field, number
            continue
        if wire not in (1, 2, 5):
            raise ValueError(f"wire type {wire}")
        length, at = _varint(message, at) if wire == 2 else ({1: 8, 5: 4}[wire], at)
        if at + length > len(message):
            raise ValueError("the message is cut off")
        yield field, message[at : at + length]
        at += length


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    number, shift = 0, 0
    while True:
        byte = message[at]
        number |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return number, at
        if shift > 63:
            raise ValueError("a number of more than 64 bits")
