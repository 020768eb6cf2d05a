"""Capture files: the messages of a mesh with their arrival times, in the MCAP container (docs/guide/replay.md).

1. Append-only and without chunks: everything that was flushed is readable whenever the writer is killed.
2. A channel is a key and the way in which its messages arrived: put, answer to a query, or liveliness token.
3. The file contains the scene: as its text for people, and with defaults and environment applied for a replay.
"""

import io
import json
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Self, TypeVar, get_args

from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from pydantic import ValidationError

from common.arrival import CaptureKind, CaptureRecord
from common.config import Scene
from common.config_input import without_removed
from common.errors import BadInput, LabanmeshError, reason_of
from common.message_types import LAST_INTEGER
from common.text import plural

CAPTURE_SUFFIX = ".mcap"
PROFILE = "labanmesh"
FORMAT = "1"
"""Version of the file without its messages, each of which carries its own."""
TEXT_NAME = "scene.toml"
CHANNELS_LIMIT = 10_000
"""Keys in one file: a peer that invents keys cannot fill the table of channels, which MCAP limits to 65535."""
T = TypeVar("T")


class CaptureWriter:
    """Appends records to a new file; a context manager, at whose end the file gets its index.

    Raises BadInput for a name without `.mcap` and for a file that exists, LabanmeshError if the disk refuses to write;
    what was written before stays readable.
    """

    def __init__(self, path: Path, scene: Scene, text: str, began_ns: int) -> None:
        self.path = path
        self.messages = 0
        self.left_out = 0
        self._stream = _create(path)
        self._channels: dict[tuple[CaptureKind, str], int] = {}
        self._writer = Writer(self._stream, compression=CompressionType.NONE, use_chunking=False)
        self._try(lambda: self._begin(scene, text, began_ns))

    @property
    def size(self) -> int:
        """Bytes so far, including those that are not flushed yet."""
        return self._stream.tell()

    def write(self, record: CaptureRecord) -> None:
        """Append one record; if its key is over CHANNELS_LIMIT it is counted in `left_out` instead."""
        channel = self._channel(record)
        if channel is None:
            self.left_out += 1
            return
        at_ns, number = record.arrived_ns, self.messages & 0xFFFFFFFF
        self._try(lambda: self._writer.add_message(channel, at_ns, record.payload, at_ns, number))
        self.messages += 1

    def flush(self) -> None:
        """Pass everything to the operating system, so that a kill of this process loses nothing."""
        self._try(self._stream.flush)

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if not self._stream.closed:
            self._try(self._writer.finish)
            self._try(self._stream.flush)
            # Some devices, as /dev/null, cannot be synced; a full disk has shown itself above.
            with suppress(OSError):
                os.fsync(self._stream.fileno())
            self._try(self._stream.close)

    def _begin(self, scene: Scene, text: str, began_ns: int) -> None:
        self._writer.start(PROFILE, "labanmesh")
        self._writer.add_metadata(PROFILE, {"format": FORMAT, "scene": scene.model_dump_json()})
        self._writer.add_attachment(began_ns, began_ns, TEXT_NAME, "application/toml", text.encode())
        self._stream.flush()

    def _channel(self, record: CaptureRecord) -> int | None:
        name = record.kind, record.key
        if name not in self._channels and len(self._channels) < CHANNELS_LIMIT:
            kind: dict[str, str] = {"kind": record.kind}
            self._channels[name] = self._writer.register_channel(record.key, MessageEncoding.MessagePack, 0, kind)
        return self._channels.get(name)

    def _try(self, step: Callable[[], T]) -> T:
        try:
            return step()
        except OSError as error:
            # The raw stream, because the buffered one would try to write again what the disk has just refused.
            self._stream.raw.close()
            raise LabanmeshError(
                f"cannot write {self.path}: {reason_of(error)}, after {plural(self.messages, 'message')} that stay "
                "readable; make room, or name a file on another disk with -o"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class CaptureFile:
    """Reads a capture, any number of times; raises BadInput, one line, for a file that is not a capture.

    `scene`: with defaults and environment applied; `text`: its file. `complete`: the writer has ended it and was not
    killed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _open(path) as stream:
            self._size = stream.seek(0, io.SEEK_END)
            if self._size == 0:
                raise BadInput(f"{path}: empty; nothing was captured into it")
            stream.seek(max(self._size - len(MCAP0_MAGIC), 0))
            self.complete = self._size > len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC
        head = self._head()
        self.scene = self._read_scene(head)
        self.text = head[2].data.decode(errors="replace") if isinstance(head[2], Attachment) else ""

    def records(self) -> Iterator[CaptureRecord]:
        """All records in the order of arrival; of a truncated file, the complete ones.

        Raises LabanmeshError where the file is damaged in another way.
        """
        channels: dict[int, tuple[CaptureKind, str]] = {}
        for entry in self._entries():
            if isinstance(entry, Channel):
                channels[entry.id] = self._kind(entry), entry.topic
            elif isinstance(entry, Message):
                if entry.channel_id not in channels:
                    raise LabanmeshError(f"{self.path}: damaged: a message without a channel; capture again")
                if entry.log_time > LAST_INTEGER:
                    raise LabanmeshError(f"{self.path}: damaged: a message from after the year 2262; capture again")
                kind, key = channels[entry.channel_id]
                yield CaptureRecord(kind, key, entry.data, entry.log_time)

    def _entries(self) -> Iterator[McapRecord]:
        with _open(self.path) as stream:
            # No record is longer than the file, so a damaged length reserves no memory. Chunks are not decompressed: a
            # small file could hold gigabytes in one.
            records = StreamReader(stream, emit_chunks=True, record_size_limit=self._size).records
            try:
                for record in records:
                    if isinstance(record, Chunk):
                        raise LabanmeshError(
                            f"{self.path}: holds chunks, which captures do not have; "
                            "name a file written by `labanmesh capture`"
                        )
                    yield record
            except (EndOfFile, RecordLengthLimitExceeded):
                return
            except (McapError, ValueError, struct.error) as error:
                raise LabanmeshError(f"{self.path}: damaged at byte {stream.tell()}: {error}") from None

    def _head(self) -> tuple[Header, Metadata, McapRecord | None]:
        with _open(self.path) as stream:
            if stream.peek(len(MCAP0_MAGIC))[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
                raise BadInput(f"{self.path}: not a capture; name a file that `labanmesh capture` has written")
        entries = self._entries()
        try:
            header, about, text = next(entries, None), next(entries, None), next(entries, None)
        except LabanmeshError as error:
            raise BadInput(str(error)) from None
        if isinstance(header, Header) and header.profile != PROFILE:
            raise BadInput(
                f"{self.path}: an MCAP file with profile {header.profile!r}; name one written by `labanmesh capture`"
            )
        if not isinstance(header, Header) or not isinstance(about, Metadata):
            raise BadInput(f"{self.path}: cut off before the first message; capture again")
        return header, about, text

    def _read_scene(self, head: tuple[Header, Metadata, McapRecord | None]) -> Scene:
        about = head[1].metadata
        if about.get("format") != FORMAT:
            raise BadInput(
                f"{self.path}: capture format {about.get('format')!r}, this version reads {FORMAT!r}; "
                "read it with the version of labanmesh that wrote it, or a newer one"
            )
        try:
            return _scene_of(about.get("scene", ""))
        except (ValidationError, BadInput) as error:
            raise BadInput(f"{self.path}: its scene cannot be used here: {str(error).splitlines()[0]}") from None

    def _kind(self, channel: Channel) -> CaptureKind:
        for kind in get_args(CaptureKind):
            if channel.metadata.get("kind") == kind:
                return kind  # type: ignore[no-any-return]
        raise LabanmeshError(f"{self.path}: damaged: channel {channel.topic!r} has an unknown kind; capture again")


class _Stream(io.BufferedReader):
    """A file that raises EndOfFile instead of returning fewer bytes than requested, as at a truncated message."""

    def __init__(self, raw: io.FileIO) -> None:
        super().__init__(raw)
        self._size = self.seek(0, io.SEEK_END)
        self.seek(0)

    def read(self, size: int | None = -1, /) -> bytes:
        # A damaged length can be any number: no memory is reserved for more than the file has.
        if size is not None and size > self._size:
            raise EndOfFile
        data = super().read(size)
        if size is not None and len(data) < size:
            raise EndOfFile
        return data


def _create(path: Path) -> io.BufferedWriter:
    if path.suffix != CAPTURE_SUFFIX:
        raise BadInput(f"{path}: a capture is an MCAP file; choose a name that ends in {CAPTURE_SUFFIX}")
    try:
        return path.open("xb")
    except FileExistsError:
        raise BadInput(f"{path}: exists, and captures are not overwritten; choose another name with -o") from None
    except OSError as error:
        raise LabanmeshError(f"cannot write {path}: {reason_of(error)}; choose another path with -o") from None


def _open(path: Path) -> _Stream:
    try:
        return _Stream(io.FileIO(path))
    except OSError as error:
        raise BadInput(f"cannot read {path}: {reason_of(error)}; name a file written by `labanmesh capture`") from None


def _scene_of(written: str) -> Scene:
    """The scene of a capture, which an earlier version may have written."""
    try:
        return Scene.model_validate_json(written)
    except ValidationError as error:
        known = None if error.errors()[0]["type"] == "json_invalid" else without_removed(json.loads(written), error)
        if known is None:
            raise
        return Scene.model_validate_json(json.dumps(known))
