"""A file with the slots of a TensorFlow Lite model that `pose_task` reads."""

import struct

from common.tflite import Bytes, FlatTable, FlatTables, flat_buffer, text


def model(outputs=3, buffers=2):
    """A file with the slots of a TensorFlow Lite model that matter here."""
    graph = FlatTable({2: Bytes(struct.pack(f"<{outputs}I", *range(outputs)), outputs)})
    data = FlatTables([FlatTable({}), *(FlatTable({0: Bytes(bytes([n]) * 40, 40)}) for n in range(1, buffers))])
    return flat_buffer(
        FlatTable({0: 3, 1: FlatTables([FlatTable({})]), 2: FlatTables([graph]), 3: text("a model"), 4: data}), b"TFL3"
    )


def pose_model(outline):
    """As MediaPipe's model of landmarks: of the eight numbered tensors the fifth is an outline of this shape, made of
    tensor 2, which nothing else reads."""

    def numbers(*values):
        return Bytes(struct.pack(f"<{len(values)}i", *values), len(values))

    tensors = [FlatTable({0: numbers(*(outline if n == 5 else (1, n)))}) for n in range(8)]
    steps = [((0,), (1,)), ((1,), (2,)), ((1,), (3, 4)), ((2,), (5,)), ((1,), (6,)), ((6,), (7,))]
    operations = [FlatTable({1: numbers(*reads), 2: numbers(*writes)}) for reads, writes in steps]
    graph = FlatTable(
        {0: FlatTables(tensors), 1: numbers(0), 2: numbers(3, 4, 5, 6, 7), 3: FlatTables(operations), 4: text("main")}
    )
    return flat_buffer(FlatTable({0: 3, 2: FlatTables([graph]), 4: FlatTables([FlatTable({})])}), b"TFL3")
