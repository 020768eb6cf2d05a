"""How much code a reader has to know: the files that run from the bytes of posteriors to the bytes of a verdict."""

import sys
from pathlib import Path

import numpy as np
from engine_stage import STEP_NS

import common
import fusion
from benchmarks.posteriors import NAMES, engine_of, message, scene_of
from common import SECOND_NS
from common.inbox import Arrival
from common.keys import SceneKeys
from common.wire import encode
from fusion.ingest import PosteriorIngest

MOST_FILES = 20
"""Of fusion/ and common/ together."""
ROOMS = tuple(str(Path(room.__file__).parent) for room in (common, fusion))
SCENE = scene_of(4)
KEYS = SceneKeys(SCENE.scene)


def payloads(seq, at_ns, moves):
    """What four observers send of a movement, with all that they send by default, or of rest."""
    p = np.full(NAMES.size, 0.05)
    if moves:
        p[3] = 4.0
    sent = message(300 + seq, at_ns, p / p.sum()).with_fields(rest=0.02 if moves else 0.98)
    return {KEYS.posterior(observer): encode(sent) for observer in SCENE.roster}


def test_few_files_run_from_the_receipt_of_a_posterior_to_its_verdict():
    files, stages, now_ns = set(), [], 1_700_000_000 * SECOND_NS
    engine = engine_of(SCENE)
    ingest = PosteriorIngest(engine)
    for seq in range(60):
        now_ns += STEP_NS
        sent, before = payloads(seq, now_ns, moves=10 <= seq < 40), sys.getprofile()
        sys.setprofile(lambda frame, *_: files.add(frame.f_code.co_filename))
        try:
            for key, payload in sent.items():
                ingest.pass_on(ingest.read([Arrival(key, payload, now_ns)], now_ns), engine, now_ns)
            output = engine.step(now_ns)
            for published in (*output.verdicts, output.judgement):
                encode(published)
        finally:
            sys.setprofile(before)
        stages += [verdict.stage for verdict in output.verdicts]
    assert stages == ["decided", "ended"]
    ours = sorted(file for file in files if file.startswith(ROOMS))
    assert len(ours) <= MOST_FILES, "\n".join(ours)
