"""The last verdicts as a listener shows them: each movement once, with its last word. Pure."""

from common.messages import VerdictMessage

Verdicts = tuple[VerdictMessage, ...]


def with_verdict(log: Verdicts, verdict: VerdictMessage, limit: int) -> Verdicts:
    """The `limit` newest arrivals, newest first; a later word on a known movement replaces the one before in place.

    The order is that of arrival: after a fusion machine's clock is set back, its new verdicts still show. Older words
    change nothing: the same object is returned.
    """
    for place, known in enumerate(log):
        if known.id == verdict.id:
            if (verdict.at_ns, verdict.stage == "ended") < (known.at_ns, known.stage == "ended"):
                return log
            return (*log[:place], verdict, *log[place + 1 :])
    return (verdict, *log)[:limit]
