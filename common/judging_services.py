"""The fusion services that a listener has heard of: a verdict of any other process is nobody's judgement. Pure.

Anybody may publish on a mesh without certificates, and messages of another time are played onto it (`replay --onto`).
A service is known by a judgement, and one that stands by, or has just started, by its status.
"""

from collections import OrderedDict

from common.fall_messages import FallMessage
from common.messages import JudgementMessage, StatusMessage, VerdictMessage

SERVICES_LIMIT = 64
"""Services that are remembered, each with its id and session: names can be invented, and a service that is started
again has a new session."""


class JudgingServices:
    """Remembers the newest SERVICES_LIMIT services."""

    def __init__(self) -> None:
        self._heard: OrderedDict[tuple[str, str | None], None] = OrderedDict()

    def hear(self, message: JudgementMessage | StatusMessage) -> None:
        """Take in a judgement that is no verdict, or a fusion service's status."""
        service = (message.fusion if isinstance(message, JudgementMessage) else message.id), message.session
        self._heard[service] = None
        self._heard.move_to_end(service)
        if len(self._heard) > SERVICES_LIMIT:
            self._heard.popitem(last=False)

    def knows(self, verdict: VerdictMessage | FallMessage) -> bool:
        """Whether the verdict, or the stage of a fall, is of a service that was heard of; true before the first one."""
        return not self._heard or (verdict.fusion, verdict.session) in self._heard
