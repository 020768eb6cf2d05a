"""Verdicts on a film through real processes: `labanmesh fuse`, and `labanmesh observe` with the mediapipe tracker.

Each film has its own processes and its own mesh on this machine. This process listens as a hub.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.clips.judging import AFTER_S, OBSERVER, ClipResult, collect_verdicts, moment
from benchmarks.clips.material import Clip, write_clip_camera, write_reduced
from benchmarks.crowd.trial import stop_process
from benchmarks.timing import free_port
from common import SECOND_NS
from common.config import Scene, read_scene
from common.config_sections import FusionConfig
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.wire import decode
from observer.model.base import MovementModel
from observer.model.model_file import write_model

START_TIMEOUT_S = 60.0
SCENE, CAMERA_FILE, MODEL_FILE = "scene.toml", "camera.toml", "camera.model"


@dataclass(slots=True)
class _Traffic:
    """Everything that a hub hears of one film, with times of arrival (Unix epoch, ns) of verdicts."""

    begin_ns: int = 0
    last_ns: int = 0
    posteriors: int = 0
    oldest_s: float = 0.0
    verdicts: list[tuple[int, VerdictMessage]] = field(default_factory=list)
    judgements: list[JudgementMessage] = field(default_factory=list)

    def take(self, posteriors: Inbox, verdicts: Inbox, judgements: Inbox) -> None:
        """Everything that has arrived."""
        for arrival in posteriors.take(0):
            message = decode(PosteriorMessage, arrival.payload)
            self.begin_ns = self.begin_ns or message.captured_ns
            self.last_ns = message.captured_ns
            self.posteriors += 1
            self.oldest_s = max(self.oldest_s, (arrival.arrived_ns - message.captured_ns) / SECOND_NS)
        self.verdicts += [(a.arrived_ns, decode(VerdictMessage, a.payload)) for a in verdicts.take(0)]
        self.judgements += [decode(JudgementMessage, a.payload) for a in judgements.take(0)]

    def since_begin_s(self, at_ns: int) -> float:
        """Seconds after the capture of the first frame."""
        return (at_ns - self.begin_ns) / SECOND_NS


@dataclass(frozen=True, slots=True)
class ProcessRun:
    """A film's result; posteriors: how many arrived. oldest_s: greatest age of a frame when its posterior arrived."""

    result: ClipResult
    posteriors: int
    oldest_s: float


def judge_through_processes(
    clip: Clip, rate_hz: float, view: str, model: MovementModel, config: FusionConfig
) -> ProcessRun:
    """Play a film once; raises LabanmeshError when a process fails or does not start."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_model(folder / MODEL_FILE, model)
        write_clip_camera(folder / CAMERA_FILE)
        shown = write_reduced(clip, folder)
        (folder / SCENE).write_text(_scene_text(shown, rate_hz, CAMERA_FILE if view == "camera" else view, config))
        scene = read_scene(folder / SCENE, {})
        with _started("fuse", folder), Link.open(scene.mesh, "hub") as hub:
            traffic = _heard(hub, scene, folder)
    verdicts = [(traffic.since_begin_s(at_ns), verdict) for at_ns, verdict in traffic.verdicts]
    moments = tuple(
        moment(j, traffic.since_begin_s(j.at_ns)) for j in traffic.judgements if j.at_ns >= traffic.begin_ns
    )
    seconds = traffic.since_begin_s(traffic.last_ns) + 1 / rate_hz
    result = ClipResult(clip.name, clip.label, seconds, collect_verdicts(verdicts), moments)
    return ProcessRun(result, traffic.posteriors, traffic.oldest_s)


def _scene_text(clip: Clip, rate_hz: float, view: str, config: FusionConfig) -> str:
    settings = config.model_dump(exclude_defaults=True)
    fusion = "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())
    return (
        f'scene = "clips"\n[mesh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n[fusion]\n{fusion}'
        f'[observers.{OBSERVER}]\nsource = {json.dumps(str(clip.file.absolute()))}\nview = "{view}"\n'
        f'tracker = "mediapipe"\nrate_hz = {rate_hz}\nmirrored = {json.dumps(clip.mirrored)}\nmodel = "{MODEL_FILE}"\n'
    )


def _heard(hub: Link, scene: Scene, folder: Path) -> _Traffic:
    inboxes = [hub.inbox(key) for key in (scene.keys.posterior(), scene.keys.verdict, scene.keys.judgement)]
    if not hub.presence(scene.keys.fusion_alive()).wait_for(1, START_TIMEOUT_S):
        raise LabanmeshError(f"`labanmesh fuse` did not start within {START_TIMEOUT_S:g} s")
    traffic = _Traffic()
    with _started("observe", folder, OBSERVER) as observer:
        while observer.poll() is None:
            traffic.take(*inboxes)
            time.sleep(0.02)
        if observer.returncode:
            raise LabanmeshError(f"`labanmesh observe` ended with status {observer.returncode}")
    end_s = time.monotonic() + AFTER_S
    while time.monotonic() < end_s:
        traffic.take(*inboxes)
        time.sleep(0.02)
    if not traffic.posteriors:
        raise LabanmeshError("no posterior arrived from `labanmesh observe`")
    return traffic


@contextmanager
def _started(verb: str, folder: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-P", "-m", "labanmesh", verb, str(folder / SCENE), *words]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)  # noqa: S603 - our verbs
    try:
        yield process
    finally:
        stop_process(process)
