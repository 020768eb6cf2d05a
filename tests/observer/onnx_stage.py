"""Tiny pose models as ONNX files, written by hand: keypoint k lies at the bright spot of the colour k modulo 3."""

import struct

import numpy as np

FLOAT, INT32, INT64 = 1, 6, 7
KEYPOINTS = 17


def _number(field, value):
    return _varint(field << 3) + _varint(value)


def _bytes(field, value):
    value = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _varint(value):
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def _tensor(name, array):
    array = np.asarray(array)
    kind = INT64 if array.dtype.kind == "i" else FLOAT
    data = array.astype("<i8" if kind == INT64 else "<f4").tobytes()
    return b"".join(_number(1, n) for n in array.shape) + _number(2, kind) + _bytes(8, name) + _bytes(9, data)


def _attribute(name, value):
    if isinstance(value, float):
        return _bytes(1, name) + _varint(2 << 3 | 5) + struct.pack("<f", value) + _number(20, 1)
    if isinstance(value, int):
        return _bytes(1, name) + _number(3, value) + _number(20, 2)
    return _bytes(1, name) + b"".join(_number(8, n) for n in value) + _number(20, 7)


def _node(kind, inputs, outputs, **attributes):
    parts = [_bytes(1, name) for name in inputs] + [_bytes(2, name) for name in outputs]
    parts += [_bytes(4, kind)] + [_bytes(5, _attribute(n, v)) for n, v in attributes.items()]
    return b"".join([*parts, _bytes(3, f"node_{outputs[0]}")])


def _value(name, shape, kind=FLOAT):
    sizes = b"".join(_bytes(1, _number(1, n) if n else _bytes(2, "open")) for n in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, kind) + _bytes(2, sizes)))


def _model(nodes, weights, inputs, outputs):
    graph = b"".join(
        [_bytes(1, node) for node in nodes]
        + [_bytes(2, "pose")]
        + [_bytes(5, _tensor(name, array)) for name, array in weights.items()]
        + [_bytes(11, value) for value in inputs]
        + [_bytes(12, value) for value in outputs]
    )
    return _number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13))


def _colours(gain=1.0):
    """(17, 3, 1, 1): keypoint k reads the colour k modulo 3."""
    weights = np.zeros((KEYPOINTS, 3, 1, 1))
    weights[range(KEYPOINTS), np.arange(KEYPOINTS) % 3] = gain
    return weights


def simcc(width=48, height=64, split=2):
    """Like RTMPose: curves over x and y; a value of 1 where the standardised colour is that of a full byte."""
    nodes = [
        _node("Conv", ["input", "colours"], ["heat"], kernel_shape=[1, 1]),
        _node("ReduceMax", ["heat"], ["columns"], axes=[2], keepdims=0),
        _node("ReduceMax", ["heat"], ["rows"], axes=[3], keepdims=0),
        _node("MatMul", ["columns", "to_x"], ["simcc_x"]),
        _node("MatMul", ["rows", "to_y"], ["simcc_y"]),
    ]
    weights = {
        "colours": _colours(0.4),
        "to_x": np.repeat(np.eye(width), split, axis=1) * np.tile([1.0] + [0.9] * (split - 1), width),
        "to_y": np.repeat(np.eye(height), split, axis=1) * np.tile([1.0] + [0.9] * (split - 1), height),
    }
    outputs = [_value("simcc_x", (1, KEYPOINTS, split * width)), _value("simcc_y", (1, KEYPOINTS, split * height))]
    return _model(nodes, weights, [_value("input", (1, 3, height, width))], outputs)


def _spots(heat, height, width, columns):
    """Nodes and weights: (1, 17, H, W) heat -> (17, columns) the rows of `columns` (H*W, n) at the brightest spot."""
    nodes = [
        _node("Reshape", [heat, "flat"], ["line"]),
        _node("Softmax", ["line"], ["share"], axis=-1),
        _node("MatMul", ["share", "grid"], ["spots"]),
    ]
    return nodes, {"flat": np.array([KEYPOINTS, height * width]), "grid": columns(*np.mgrid[:height, :width])}


def movenet(width=48, height=48, kind=INT32):
    """Like MoveNet: channels last, whole numbers; y, x, confidence."""
    nodes, weights = _spots(
        "heat", height, width,
        lambda v, u: np.stack([v.ravel() / height, u.ravel() / width, 0.8 * np.ones(v.size)], axis=1),
    )  # fmt: skip
    nodes = [
        _node("Cast", ["serving_default_input:0"], ["number"], to=FLOAT),
        _node("Transpose", ["number"], ["first"], perm=[0, 3, 1, 2]),
        _node("Conv", ["first", "colours"], ["heat"], kernel_shape=[1, 1]),
        *nodes,
        _node("Reshape", ["spots", "shape"], ["StatefulPartitionedCall:0"]),
    ]
    weights |= {"colours": _colours(), "shape": np.array([1, 1, KEYPOINTS, 3])}
    inputs = [_value("serving_default_input:0", (1, height, width, 3), kind)]
    return _model(nodes, weights, inputs, [_value("StatefulPartitionedCall:0", (1, 1, KEYPOINTS, 3))])


def yolo(width=64, height=64, confidence=0.9):
    """Like YOLO-pose: 56 rows for each of 2 boxes; the second is unsure and empty."""
    nodes, weights = _spots(
        "heat", height, width, lambda v, u: np.stack([u.ravel(), v.ravel(), 0.8 * np.ones(v.size)], axis=1)
    )
    nodes = [
        _node("Conv", ["images", "colours"], ["heat"], kernel_shape=[1, 1]),
        *nodes,
        _node("Reshape", ["spots", "column"], ["keypoints"]),
        _node("Concat", ["box", "keypoints"], ["person"], axis=1),
        _node("Concat", ["person", "nobody"], ["output0"], axis=2),
    ]
    weights |= {
        "colours": _colours(255.0),
        "column": np.array([1, 3 * KEYPOINTS, 1]),
        "box": np.array([32.0, 32.0, 30.0, 50.0, confidence]).reshape(1, 5, 1),
        "nobody": np.zeros((1, 56, 1)),
    }
    return _model(nodes, weights, [_value("images", (1, 3, height, width))], [_value("output0", (1, 56, 2))])


def classifier():
    """A model that finds no keypoints."""
    nodes = [_node("GlobalAveragePool", ["images"], ["classes"])]
    return _model(nodes, {}, [_value("images", (1, 3, 32, 32))], [_value("classes", (1, 3, 1, 1))])


def unknown():
    """A model with an operation that nobody knows."""
    nodes = [_node("Frobnicate", ["images"], ["classes"])]
    return _model(nodes, {}, [_value("images", (1, 3, 32, 32))], [_value("classes", (1, 56, 9))])
