"""Acts early, and takes it back: labanmesh watch scene.toml --json | python early.py, with hub.certainty below 1."""

import json
import sys

LAMP = {"byebye": "off", "maestro": "on"}
for line in sys.stdin:
    said = json.loads(line)
    if said["kind"] == "early" and said["label"] in LAMP:
        print("lamp", LAMP[said["label"]], flush=True)
    elif said["kind"] in ("corrected", "withdrawn") and said["early"] in LAMP:
        print("lamp as before: it was not", said["early"], flush=True)
