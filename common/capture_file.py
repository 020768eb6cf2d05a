"""Capture files: the messages of a mesh with their arrival times, in the MCAP container (docs/guide/replay.md).

1. Append-only and without chunks: whatever the moment at which the writer is killed, all that was flushed is readable.
2. A channel is a key and the way it was heard: put, answered to a query, or a liveliness token coming and going.
3. The scene is in the file, as its text for people and as it counted (defaults, environment) for a replay.
"""

import io
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeVar, get_args

from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from pydantic import ValidationError

from common.config import Scene
from common.errors import BadInput, LabanmeshError

SUFFIX = ".mcap"
PROFILE = "labanmesh"
FORMAT = "1"
"""Version of what is in the file beside the messages; the messages carry their own."""
TEXT_NAME = "scene.toml"
CHANNELS_LIMIT = 10_000
"""So many keys are told apart; a peer that invents keys cannot fill the table, which MCAP ends at 65535."""
T = TypeVar("T")


APPEARED, GONE = b"\xc3", b"\xc2"
"""A token's payload: true and false in MessagePack."""

CaptureKind = Literal["put", "answer", "token"]


@dataclass(frozen=True, slots=True)
class CaptureRecord:
    """One thing that was heard: under which key, how, its bytes, and when it arrived (ns since 1970).

    `token`: a process came or went, the payload is CAME or WENT. `answer`: somebody was asked for his last word; its
    arrival is that of the answer, it may have been said long before.
    """

    kind: CaptureKind
    key: str
    payload: bytes
    arrived_ns: int


class CaptureWriter:
    """Appends records to a new file; a context manager, at whose end the file gets its index.

    Raises BadInput for a name without `.mcap` and for a file that exists, LabanmeshError when the disk refuses; what
    was written before stays readable.
    """

    def __init__(self, path: Path, scene: Scene, text: str, began_ns: int) -> None:
        self.path = path
        self.messages = 0
        self.left_out = 0
        self._stream = _created(path)
        self._channels: dict[tuple[CaptureKind, str], int] = {}
        self._writer = Writer(self._stream, compression=CompressionType.NONE, use_chunking=False)
        self._refusable(lambda: self._begin(scene, text, began_ns))

    @property
    def size(self) -> int:
        """Bytes so far, those included that are not flushed yet."""
        return self._stream.tell()

    def write(self, record: CaptureRecord) -> None:
        """Append one record; counted in `left_out` instead when its key is one too many."""
        channel = self._channel(record)
        if channel is None:
            self.left_out += 1
            return
        at_ns, number = record.arrived_ns, self.messages & 0xFFFFFFFF
        self._refusable(lambda: self._writer.add_message(channel, at_ns, record.payload, at_ns, number))
        self.messages += 1

    def flush(self) -> None:
        """Hand all that was written to the operating system: from then on a kill of this process loses none of it."""
        self._refusable(self._stream.flush)

    def close(self) -> None:
        """End the file with its index; a second call does nothing."""
        if not self._stream.closed:
            self._refusable(self._writer.finish)
            self._refusable(self._stream.close)

    def _begin(self, scene: Scene, text: str, began_ns: int) -> None:
        self._writer.start(PROFILE, "labanmesh")
        told = {"format": FORMAT, "scene": scene.model_dump_json()}
        self._writer.add_metadata(PROFILE, told)
        self._writer.add_attachment(began_ns, began_ns, TEXT_NAME, "application/toml", text.encode())
        self._stream.flush()

    def _channel(self, record: CaptureRecord) -> int | None:
        name = record.kind, record.key
        if name not in self._channels and len(self._channels) < CHANNELS_LIMIT:
            told: dict[str, str] = {"kind": record.kind}
            self._channels[name] = self._writer.register_channel(record.key, MessageEncoding.MessagePack, 0, told)
        return self._channels.get(name)

    def _refusable(self, step: Callable[[], T]) -> T:
        try:
            return step()
        except OSError as error:
            # Not the buffered stream: its own close would try to write again what the disk has just refused.
            self._stream.raw.close()
            raise LabanmeshError(
                f"{self.path}: {_why(error)} after {self.messages} messages; what was written stays readable; "
                "make room and capture into another file"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class CaptureFile:
    """A capture to be read, as often as wanted; raises BadInput, one line, for a file that is none.

    `scene`: as it counted where it was captured; `text`: its file. `complete`: whether it was ended, not killed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _opened(path) as stream:
            self._size = stream.seek(0, io.SEEK_END)
            if self._size == 0:
                raise BadInput(f"{path}: empty; nothing was captured into it")
            stream.seek(max(self._size - len(MCAP0_MAGIC), 0))
            self.complete = self._size > len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC
        head = self._head()
        self.scene = self._read_scene(head)
        self.text = head[2].data.decode(errors="replace") if isinstance(head[2], Attachment) else ""

    def records(self) -> Iterator[CaptureRecord]:
        """All that was heard, in the order of arrival; of a file that was cut off, all that is whole.

        Raises LabanmeshError where the file is damaged other than by being cut off.
        """
        channels: dict[int, tuple[CaptureKind, str]] = {}
        for found in self._found():
            if isinstance(found, Channel):
                channels[found.id] = self._kind(found), found.topic
            elif isinstance(found, Message):
                if found.channel_id not in channels:
                    raise LabanmeshError(f"{self.path}: damaged: a message of no known channel")
                kind, key = channels[found.channel_id]
                yield CaptureRecord(kind, key, found.data, found.log_time)

    @cached_property
    def began_ns(self) -> int:
        """When the first record arrived; 0 in a capture that heard nothing."""
        return next((record.arrived_ns for record in self.records()), 0)

    def _found(self) -> Iterator[McapRecord]:
        with _opened(self.path) as stream:
            # No record is longer than the file: a length that was cut off is not taken for the truth.
            # Chunks are not decompressed: a small file could hold gigabytes in one.
            records = StreamReader(stream, emit_chunks=True, record_size_limit=self._size).records
            try:
                for record in records:
                    if isinstance(record, Chunk):
                        raise LabanmeshError(
                            f"{self.path}: holds chunks, which captures do not have; "
                            "replay a file that `labanmesh capture` has written"
                        )
                    yield record
            except (EndOfFile, RecordLengthLimitExceeded):
                return
            except (McapError, ValueError, struct.error) as error:
                raise LabanmeshError(f"{self.path}: damaged at byte {stream.tell()}: {error}") from None

    def _head(self) -> tuple[Header, Metadata, McapRecord | None]:
        with _opened(self.path) as stream:
            if stream.peek(len(MCAP0_MAGIC))[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
                raise BadInput(f"{self.path}: not a capture; name a file that `labanmesh capture` has written")
        found = self._found()
        try:
            header, about, text = next(found, None), next(found, None), next(found, None)
        except LabanmeshError as error:
            raise BadInput(str(error)) from None
        if isinstance(header, Header) and header.profile != PROFILE:
            raise BadInput(
                f"{self.path}: an MCAP file of profile {header.profile!r}; a capture of ours is of {PROFILE!r}"
            )
        if not isinstance(header, Header) or not isinstance(about, Metadata):
            raise BadInput(f"{self.path}: cut off before the first message; capture again")
        return header, about, text

    def _read_scene(self, head: tuple[Header, Metadata, McapRecord | None]) -> Scene:
        told = head[1].metadata
        if told.get("format") != FORMAT:
            raise BadInput(
                f"{self.path}: capture format {told.get('format')!r}, this version reads {FORMAT!r}; "
                "read it with the version of labanmesh that wrote it, or a newer one"
            )
        try:
            return Scene.model_validate_json(told.get("scene", ""))
        except (ValidationError, BadInput) as error:
            raise BadInput(f"{self.path}: its scene cannot be used here: {str(error).splitlines()[0]}") from None

    def _kind(self, channel: Channel) -> CaptureKind:
        for kind in get_args(CaptureKind):
            if channel.metadata.get("kind") == kind:
                return kind  # type: ignore[no-any-return]
        raise LabanmeshError(f"{self.path}: damaged: channel {channel.topic!r} is of no known kind")


class _Whole(io.BufferedReader):
    """A file that ends rather than give less than it was asked for: what was cut off is not taken for a message."""

    def __init__(self, raw: io.FileIO) -> None:
        super().__init__(raw)
        self._size = self.seek(0, io.SEEK_END)
        self.seek(0)

    def read(self, size: int | None = -1, /) -> bytes:
        # A length that is damaged may be any number: nothing is reserved for more than there is.
        if size is not None and size > self._size:
            raise EndOfFile
        found = super().read(size)
        if size is not None and len(found) < size:
            raise EndOfFile
        return found


def _created(path: Path) -> io.BufferedWriter:
    if path.suffix != SUFFIX:
        raise BadInput(f"{path}: a capture is an MCAP file, its name ends in {SUFFIX}")
    try:
        return path.open("xb")
    except FileExistsError:
        raise BadInput(f"{path}: is there already, and captures are not overwritten; name another file") from None
    except OSError as error:
        raise LabanmeshError(f"{path}: {_why(error)}; name a file that can be written") from None


def _opened(path: Path) -> _Whole:
    try:
        return _Whole(io.FileIO(path))
    except OSError as error:
        raise BadInput(f"{path}: {_why(error)}; name a file that `labanmesh capture` has written") from None


def _why(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
