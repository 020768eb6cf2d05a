"""Puts the fuzzing suite's own module where its tests find it."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
