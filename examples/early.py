"""Acts early, and takes it back: labanmesh watch scene.toml --json | python early.py, with hub.certainty below 1."""

import json
import sys
from contextlib import suppress

if sys.stdin.isatty():
    sys.exit("usage: labanmesh watch SCENE --json | python early.py, e.g. SCENE = scene.toml")
LAMP = {"byebye": "off", "maestro": "on"}
with suppress(KeyboardInterrupt):
    for line in sys.stdin:
        word = json.loads(line)
        if word["kind"] == "early" and word["label"] in LAMP:
            print("lamp", LAMP[word["label"]], flush=True)
        elif word["kind"] in ("corrected", "withdrawn") and word["early"] in LAMP:
            print("lamp as before: it was not", word["early"], flush=True)
