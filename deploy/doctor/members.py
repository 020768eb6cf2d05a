"""What one process on the mesh says of itself, and what is wrong with its messages, in words. Pure."""

from collections.abc import Iterator
from typing import Final

from deploy.doctor.finding import Finding, error, ok, warning
from deploy.doctor.heard import Said

GROUP: Final = "the mesh"
OLD_FRAME_S = 2.0
"""As long as a running process may be without a frame before it says degraded of itself."""
STANDING_BY = "standing by"
WAYS_OUT = {
    "wrong_version": "install the same labanmesh on every machine, and start that process again",
    "foreign_vocabulary": "learn its model again from the movements of the others: labanmesh learn",
    "from_the_future": "synchronise its clock (NTP)",
    "repeated": "two ways lead to the same process, or somebody replays it: look who publishes its key",
    "out_of_order": "its clock was set back, or two processes speak under this id",
    "past_session": "two processes speak under this id: stop one of them",
    "wrong_key": "somebody speaks under this observer's key: labanmesh secure lets each put below its own key only",
    "unknown_observer": "name it under [observers.ID] in the scene file, or stop it",
}
"""Per reason for which a message is not used."""
ANY_WAY_OUT = "see that process's log; what a message must be is in docs/reference/wire.md"


def member(name: str, said: Said, version: str, alive: bool) -> Iterator[Finding]:
    """State, newest frame and version of one process; `version`: of the labanmesh that asks."""
    yield _state(name, said, alive)
    theirs = said.status.version if said.status else ""
    if theirs and version and theirs != version:
        what = f"{name}: labanmesh {theirs}, here it is {version}"
        yield warning(GROUP, what, "install the same on every machine, and start that process again")
    for reason, count in sorted(said.bad.items()):
        what, to_do = strange_speech(reason, count)
        yield error(GROUP, f"{name}: {what}", to_do)


def strange_speech(reason: str, count: int) -> tuple[str, str]:
    """What and what to do for so many messages that were not used for this reason."""
    many = f"{count} message{'s' * (count != 1)} not used"
    return f"{many}: {reason.replace('_', ' ')}", WAYS_OUT.get(reason, ANY_WAY_OUT)


def seconds(skew_s: float) -> str:
    """`3600 s ahead of`, `0.7 s behind`."""
    size = f"{abs(skew_s):.1f} s" if abs(skew_s) < 10 else f"{abs(skew_s):.0f} s"
    return f"{size} {'ahead of' if skew_s > 0 else 'behind'}"


def _state(name: str, said: Said, alive: bool) -> Finding:
    status, age_s = said.status, said.frame_age_s
    if status is None:
        if said.bad:
            return warning(GROUP, f"{name}: is there, and its state cannot be read", "see the next lines")
        if not alive:
            return warning(GROUP, f"{name}: speaks, and says neither its state nor that it is alive", ANY_WAY_OUT)
        return warning(GROUP, f"{name}: alive, and does not say how it is", "look again in a moment; see its log")
    reason = f": {status.reason}" if status.reason else ""
    said_so = f"{name}: {status.state}{reason}"
    if status.state == "failed":
        return error(GROUP, said_so, "correct what it says, and start it again; its log says more")
    if not alive:
        return warning(GROUP, f"{said_so}; its last word, it is not alive", "start it again; see its log")
    if status.state == "degraded":
        return warning(GROUP, said_so, "labanmesh look SOURCE on its machine shows what its camera delivers")
    if status.state in ("starting", "stopping"):
        if status.reason.startswith(STANDING_BY):
            return ok(GROUP, said_so)
        return warning(GROUP, said_so, "look again in a moment; see its log")
    rate = "" if status.rate_hz is None else f", {status.rate_hz:g} Hz"
    if age_s is not None and age_s > OLD_FRAME_S and not status.reason.startswith(STANDING_BY):
        what = f"{said_so}, and its newest frame is {age_s:.0f} s old"
        return warning(GROUP, what, "labanmesh look SOURCE on its machine shows what its camera delivers")
    newest = "" if age_s is None else f", newest frame {age_s:.1f} s old"
    return ok(GROUP, f"{said_so}{rate}{newest}")
