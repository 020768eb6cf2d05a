"""Checks what the fusion service would refuse, without starting it: `python -m fusion.preflight SCENE`.

`labanmesh doctor` may not import this room and runs it as a process, which prints one line with a remedy, or nothing.
"""

import sys
from pathlib import Path

from common.config import read_scene
from common.errors import BadInput
from fusion.engine.rules import get_rule


def fault_of(path: Path) -> str:
    """Why the scene file cannot be fused; "" if it can."""
    try:
        get_rule(read_scene(path).fusion.rule)
    except BadInput as fault:
        return str(fault)
    return ""


if __name__ == "__main__":
    print(fault_of(Path(sys.argv[1])))
