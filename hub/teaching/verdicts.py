"""Verdicts since the last call. Pure."""

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hub.scene_state import is_abstention

if TYPE_CHECKING:
    from hub.session import ArrivedVerdict


def newly_decided(arrived: "deque[ArrivedVerdict]") -> Sequence[str]:
    """The labels of the verdicts in `arrived`, which is empty afterwards; each movement has one."""
    taken = [arrived.popleft() for _ in range(len(arrived))]
    new = [each.verdict for each in taken if not each.answered]
    return [each.label for each in new if each.stage == "decided" or is_abstention(each)]
