"""Learning a model in a process of its own while the observer goes on with the old one, and the files of models."""

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import LabanmeshError, reason_of
from common.teaching_messages import TEACHING_TEXT_LIMIT, LearnedReport, Unwanted
from observer.files import make_private, remove_file
from observer.learning.examples import CHOSEN
from observer.model.leaning import held_out_of
from observer.model.model_file import read_model
from observer.runtime.people_observer import AnyObserver

if TYPE_CHECKING:
    from observer.model.base import MovementModel

log = logging.getLogger("labanmesh.observer")
NICE = 10
"""Learning waits for whatever else the machine has to do: posteriors go on."""
LEARNER_END_S = 2.0
UMASK = 0o077
"""A model keeps examples of the motion that it was learned from: only the observer's user may read it."""
Build = Callable[["MovementModel"], AnyObserver]


class ModelLearner:
    """Learns a model from the takes file in a process of its own, and builds the observer that uses it.

    takes: the archive to learn from. model: the model file, which `adopt` replaces; the old one becomes
    NAME.before.model. build: makes an observer of a model. scene_model: the file that the scene names, which is in
    force while `model` does not exist; by default the same one.
    """

    def __init__(self, takes: Path, model: Path, build: Build, scene_model: Path | None = None) -> None:
        self._takes, self._model, self._build, self._scene_model = takes, model, build, scene_model or model
        self._next, self._before = _beside(model, "next"), _beside(model, "before")
        self._observer: AnyObserver | None = None
        self._process: subprocess.Popen[str] | None = None
        self._due_s: float | None = None
        self.busy, self.fault = False, ""
        self.learned: LearnedReport | None = None
        self.removed = False
        """Whether the model in force was removed; the observer that uses it sets this back."""

    def learn(self, labels: Sequence[str], references: Sequence[str] = ()) -> None:
        """Begin to learn these movements. references: LABEL:TRIAL of the takes that show how they should be done."""
        self.busy, self.fault, self.learned = True, "", None
        threading.Thread(target=self._learn, args=(list(labels), references), name="learn", daemon=True).start()

    @property
    def references(self) -> frozenset[str]:
        """LABEL:TRIAL of the takes that are references of the model in force."""
        try:
            header = read_model(self._in_force).header if self._in_force.exists() else None
        except LabanmeshError:
            return frozenset()
        return frozenset() if header is None else frozenset(header.provenance.get(CHOSEN, "").split(","))

    def adopt(self, in_s: float) -> None:
        """Replace the model file now, and the observer after so many seconds; raises LabanmeshError."""
        try:
            if self._model.exists():
                self._model.replace(self._before)
                make_private(self._before)
            self._next.replace(self._model)
        except OSError as error:
            raise LabanmeshError(f"{self._model}: cannot be replaced: {reason_of(error)}") from None
        self._due_s, self.learned = time.monotonic() + in_s, None

    def ready(self) -> AnyObserver | None:
        """The observer of the adopted model: once, when it is due; else None."""
        if self._due_s is None or time.monotonic() < self._due_s:
            return None
        observer, self._observer, self._due_s = self._observer, None, None
        return observer

    @property
    def _in_force(self) -> Path:
        return self._model if self._model.exists() else self._scene_model

    def forget(self, unwanted: Unwanted, *, in_force: bool) -> int:
        """Remove the models that were learned from unwanted takes; returns how many. in_force: also the one in force.

        The file that the scene names would be in force again after the taught one is gone. So it is removed with
        the taught one, and if it was learned from the person. Raises LabanmeshError for a file that cannot be removed,
        after the others have been.
        """
        now = self._in_force
        old = {self._next, self._before, _beside(self._scene_model, "next"), _beside(self._scene_model, "before")}
        old |= {self._scene_model} if in_force or unwanted.person else set()
        gone = [path for path in sorted(old - {now}) if _knows(path, unwanted)]
        gone += [now] if in_force and now.exists() else []
        if self._next in gone or now in gone:
            self.learned = self._observer = self._due_s = None
        faults = []
        for path in gone:
            try:
                remove_file(path)
            except LabanmeshError as error:
                faults.append(str(error))
        self.removed = self.removed or (now in gone and not now.exists())
        if faults:
            raise LabanmeshError("; ".join(faults))
        return len(gone)

    def knows(self, unwanted: Unwanted) -> bool:
        """Whether the model in force was learned from unwanted takes."""
        return _knows(self._in_force, unwanted)

    def close(self) -> None:
        """End a process that still learns."""
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(LEARNER_END_S)

    def _learn(self, labels: list[str], references: Sequence[str]) -> None:
        try:
            self._run(labels, references)
            model = read_model(self._next)
            self._observer = self._build(model)
            vocabulary, results = model.header.vocabulary, held_out_of(model.header)
            self.learned = LearnedReport(
                labels=list(vocabulary.labels), results=results, periods=vocabulary.periods,
                references={label: own.count for label, own in model.header.references.items()},
            )  # fmt: skip
        except (LabanmeshError, OSError) as error:
            self.fault = str(error)[:TEACHING_TEXT_LIMIT]
            log.warning("learning failed: %s", error)
        finally:
            self.busy = False

    def _run(self, labels: list[str], references: Sequence[str]) -> None:
        command = [sys.executable, "-P", "-m", "labanmesh", "learn", str(self._takes), "--labels", ",".join(labels)]
        # The people who teach are those who will be judged; a few takes by one of them tell little about other people.
        command += ["--known-people", "--body-parts", "auto", "-o", str(self._next)]
        command += ["--reference", ",".join(references)] if references else []
        self._process = process = subprocess.Popen(  # noqa: S603 - the command line is ours
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace", umask=UMASK,
        )  # fmt: skip
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, process.pid, NICE)
        text, _ = process.communicate()
        lines = [line for line in text.splitlines() if line.strip()]
        if process.returncode:
            raise LabanmeshError(lines[-1] if lines else f"learning ended with status {process.returncode}")
        for line in lines:
            log.info("%s", line)


def _beside(model: Path, word: str) -> Path:
    return model.with_name(f"{model.stem}.{word}{model.suffix}")


def _knows(path: Path, unwanted: Unwanted) -> bool:
    """Whether a model file was learned from unwanted takes; true also if it cannot be read, or does not say."""
    if not path.exists():
        return False
    try:
        header = read_model(path).header
    except LabanmeshError:
        return True
    people = header.provenance.get("subjects", unwanted.person)
    # A name may hold a comma.
    is_theirs = bool(unwanted.person) and f",{unwanted.person}," in f",{people},"
    return unwanted.everything or is_theirs or unwanted.label in header.vocabulary.labels
