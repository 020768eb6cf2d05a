"""Puts message_stage where the tests of common find it."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
