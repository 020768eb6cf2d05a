"""Checks what the fusion service would refuse, without starting it: `python -m fusion.preflight SCENE`.

`labanmesh doctor` may not import this room and runs it as a process, which prints one line with a remedy, or nothing.
"""

import sys
from pathlib import Path

from common.config import sound_part
from common.errors import BadInput
from fusion.engine.rules import DEFAULT_RULE, get_rule


def fault_of(path: Path) -> str:
    """Why the rule of the scene file cannot fuse; "" if it can."""
    scene = sound_part(path)
    try:
        get_rule(scene.fusion.rule if scene else DEFAULT_RULE)
    except BadInput as fault:
        return str(fault)
    return ""


if __name__ == "__main__":
    print(fault_of(Path(sys.argv[1])))
