"""A file with the slots of a TensorFlow Lite model that `pose_task` reads."""

import struct

from hub.phone.flat_buffer import Bytes, FlatTable, FlatTables, flat_buffer, text


def model(outputs=3, buffers=2):
    """A file with the slots of a TensorFlow Lite model that matter here."""
    graph = FlatTable({2: Bytes(struct.pack(f"<{outputs}I", *range(outputs)), outputs)})
    data = FlatTables([FlatTable({}), *(FlatTable({0: Bytes(bytes([n]) * 40, 40)}) for n in range(1, buffers))])
    return flat_buffer(
        FlatTable({0: 3, 1: FlatTables([FlatTable({})]), 2: FlatTables([graph]), 3: text("a model"), 4: data}), b"TFL3"
    )
