"""Films of a gesture three times in a row, counted: the clips of Florence 3D Actions, by models of everybody else.

    LABANMESH_DATA=... python -m benchmarks.repetition_films [--only 1_1,1_2]

Each clip is played three times without a pause, by its tracks of mediapipe (benchmarks/clips), through an observer and
fusion, and what `labanmesh count` would show at the end is compared with three. The models are learned from the
recordings in 3-D of other people, each three times in a row too.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.clips.judging import BEGIN_NS, LATENCY_S, OBSERVER
from benchmarks.clips.learning import Learning
from benchmarks.clips.material import FOUR, centres_in, gesture_clips, recordings
from benchmarks.command_line import recordings_folder, run_command
from benchmarks.from_pixels import RecordedTracks
from common import SECOND_NS
from common.config_sections import FusionConfig
from common.text import split_list
from hub.counting.tally import RepetitionTally
from observer.model.base import MovementModel, Onset
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive import MotionArchive, Recording
from observer.motion.even_rate import Resampler
from observer.motion.importers.florence3d import FLORENCE_HZ
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.tracks import Floats, Frame, Tracks
from studies.fusion_engine import FusionEngine

TIMES = 3
AFTER_S = 4.0
"""So long fusion goes on after the film."""


def in_a_row(recording: Recording) -> Recording:
    """The same TIMES times without a pause."""
    return replace(recording, positions=np.concatenate([recording.positions] * TIMES))


def counted(centres: Floats, model: MovementModel, label: str) -> int:
    """How often `label` is counted in tracks (F, P, 2)."""
    config, header = FusionConfig(), model.header
    engine, tally = FusionEngine("films", [OBSERVER], header.vocabulary, config), RepetitionTally(label)
    tracks = RecordedTracks(iter(map(Tracks, centres)), header.body_parts)
    observer = Observer(tracks, model, Onset(), Resampler(header.rate_hz))
    encoder, step_ns, now_ns = PosteriorEncoder(header.vocabulary, "films"), round(SECOND_NS / config.step_hz), BEGIN_NS
    engine.roster.set_present(frozenset({OBSERVER}))

    def step_until(end_ns: int) -> int:
        at_ns = now_ns
        while at_ns + step_ns <= end_ns:
            at_ns += step_ns
            output = engine.step(at_ns)
            for message in (output.judgement, *output.verdicts):
                tally.update(message)
        return at_ns

    for n in range(len(centres)):
        captured_ns = BEGIN_NS + round(n * SECOND_NS / FLORENCE_HZ)
        sent_ns = captured_ns + round(LATENCY_S * SECOND_NS)
        posterior = observer.step(Frame(captured_ns, np.empty(0)))
        engine.receive(OBSERVER, encoder.encode(posterior, captured_ns, sent_ns), sent_ns)
        now_ns = step_until(sent_ns)
    if (last := observer.end()) is not None:
        engine.receive(OBSERVER, encoder.encode(last, captured_ns + 1, sent_ns), sent_ns)
    step_until(now_ns + round(AFTER_S * SECOND_NS))
    return tally.now.done


def repetition_films(
    only: Annotated[str, typer.Option(help="Names of clips, separated by commas; default: all 16.")] = "",
    tracks: Annotated[Path, typer.Option(help="Folder of the tracks; those missing are written there.")] = Path(
        "build/clips"
    ),
) -> None:
    """Count gestures in films that show each of them three times in a row.

    LABANMESH_DATA names the folder of recordings. Tracking needs mediapipe (.venv-mediapipe).

    Example: python -m benchmarks.repetition_films --only 1_1,1_2
    """
    data, wanted = recordings_folder(), split_list("--only", only)
    archive = recordings(data)
    learning = Learning(
        MotionArchive(archive.body_parts, tuple(map(in_a_row, archive.recordings))), FOUR, DEFAULT_MODEL, {}
    )
    tracks.mkdir(parents=True, exist_ok=True)
    exact: list[bool] = []
    for clip in gesture_clips(data):
        if not wanted or clip.name in wanted:
            model = learning.model(clip.subject, "camera")
            count = counted(_thrice(centres_in(clip, tracks)), model, clip.label)
            exact.append(count == TIMES)
            print(f"{clip.name} {clip.label}: {count} of {TIMES}", flush=True)
    print(f"exact {sum(exact)} of {len(exact)}")


def _thrice(centres: Floats) -> Floats:
    result: Floats = np.concatenate([centres] * TIMES)
    return result


if __name__ == "__main__":
    sys.exit(run_command(repetition_films, "repetition_films"))
