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
            return (*log[:place], _with_revision(verdict, known), *log[place + 1 :])
    return (verdict, *log)[:limit]


def _with_revision(verdict: VerdictMessage, known: VerdictMessage) -> VerdictMessage:
    """`verdict` with the label that it replaces, also from a fusion service that does not say it."""
    replaced = known.revises if verdict.label == known.label else known.label
    if verdict.revises is not None or replaced is None:
        return verdict
    return verdict.model_copy(update={"revises": replaced})
