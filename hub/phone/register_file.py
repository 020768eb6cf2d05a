"""The register of phones in a file beside the scene file, which the server and `labanmesh phone --revoke` change."""

import fcntl
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from common.config import Scene
from common.errors import LabanmeshError, reason_of
from common.files import read_text, replace_file
from hub.phone.register import Phone, PhoneRegister, read_register

SECRET_BYTES = 16
"""128 random bits: nobody guesses them."""
PRIVATE = 0o600


def register_path(scene: Scene) -> Path:
    """Where the register of a scene lies."""
    return scene.place(f"{scene.scene}.phones.json")


@dataclass(slots=True)
class RegisterFile:
    """The register at `path`. Every change reads it anew under a lock, and replaces it as a whole."""

    path: Path
    _stamp: tuple[int, int] | None = None
    _register: PhoneRegister = field(default_factory=PhoneRegister)

    @property
    def register(self) -> PhoneRegister:
        """The register as it is now; raises BadInput for a damaged file, LabanmeshError for one that cannot be read."""
        try:
            stat = self.path.stat()
            stamp = (stat.st_mtime_ns, stat.st_ino)
            if stamp != self._stamp:
                self._register, self._stamp = read_register(read_text(self.path), str(self.path)), stamp
        except FileNotFoundError:
            self._register, self._stamp = PhoneRegister(), None
        except OSError as error:
            raise LabanmeshError(f"{self.path}: {reason_of(error)}") from None
        return self._register

    def new_code(self, observer: str, beside: str = "") -> str:
        """A new code for `observer`; beside: as for `PhoneRegister.with_code`."""
        code = secrets.token_urlsafe(SECRET_BYTES)
        with self._locked():
            self._write(self.register.with_code(observer, code, datetime.now(UTC), beside))
        return code

    def join(self, code: str, name: str) -> tuple[Phone, str]:
        """The phone that shows a code, and its new secret; raises RefusedError."""
        secret = secrets.token_urlsafe(SECRET_BYTES)
        with self._locked():
            register, phone = self.register.join(code, secret, name, datetime.now(UTC))
            self._write(register)
        return phone, secret

    def resume(self, secret: str) -> Phone:
        """The phone with that secret; raises RefusedError."""
        return self.register.resume(secret)

    def revoke(self, observer: str) -> None:
        """Revoke the phone and the open code of `observer`; raises BadInput if it has none."""
        with self._locked():
            self._write(self.register.revoke(observer, datetime.now(UTC)))

    @contextmanager
    def naming_page(self, port: int) -> Iterator[None]:
        """While this lasts, the register names the port of the page with the codes."""
        self._name_page(port)
        try:
            yield
        finally:
            # Another server may have begun in the meantime.
            if self.register.page_port == port:
                self._name_page(None)

    def _name_page(self, port: int | None) -> None:
        with self._locked():
            self._write(self.register.model_copy(update={"page_port": port}))

    def admits(self, phone: Phone) -> bool:
        """Whether a phone that was admitted still is."""
        held = self.register.phone_of(phone.observer)
        return held is not None and held.hash == phone.hash

    @contextmanager
    def _locked(self) -> Iterator[None]:
        try:
            lock = os.open(self.path.with_name(f".{self.path.name}.lock"), os.O_WRONLY | os.O_CREAT, PRIVATE)
        except OSError as error:
            raise LabanmeshError(f"{self.path}: {reason_of(error)}; phones are registered there") from None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield
        finally:
            os.close(lock)

    def _write(self, register: PhoneRegister) -> None:
        try:
            replace_file(self.path, register.model_dump_json(indent=1).encode() + b"\n", PRIVATE)
        except OSError as error:
            raise LabanmeshError(f"{self.path}: {reason_of(error)}; phones are registered there") from None
