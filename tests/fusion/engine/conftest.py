"""Puts engine_stage where the tests of the engine find it."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
