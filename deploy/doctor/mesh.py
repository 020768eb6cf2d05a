"""What is to be said of the mesh: who is there, who is missing, whose clock, vocabulary or version is another. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from common.text import nearest
from deploy.doctor.finding import Finding, Mark, error, ok, warning
from deploy.doctor.heard import Heard, Said, judged_hash
from deploy.doctor.members import member, seconds, strange_speech

if TYPE_CHECKING:
    from common.config import Scene

GROUP: Final = "the mesh"
SKEW_S = 0.5
"""A clock that is off by more than this is told; fusion takes it out of the ages of opinions."""
NAMED = 6
"""So many strangers are named in one line."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What a mesh should hold. version: of the labanmesh that asks. path: of the scene file, for what to type.

    partly: this machine's certificate lets it hear no more than how the fusion services are.
    """

    scene: "Scene"
    version: str
    path: str
    partly: bool = False

    @property
    def fusions(self) -> tuple[str, ...]:
        """The fusion services that the scene names."""
        return self.scene.services

    @property
    def digest(self) -> str:
        """The vocabulary's hash, where the scene names one."""
        named = self.scene.named_vocabulary
        return named.digest if named else ""


def findings(expected: Expected, heard: Heard) -> list[Finding]:
    """All that is to be said of a mesh that was listened to."""
    if heard.silent:
        return [nobody(expected)]
    if expected.partly:
        what = "this machine's certificate is an observer's: it hears of the fusion services, and of nobody else"
        to_do = (
            "run doctor on the fusion machine, or with a certificate for a hub: labanmesh secure add SCENE NAME --hub"
        )
        return [*_fusions(expected, heard), warning(GROUP, what, to_do)]
    return [*_fusions(expected, heard), *_judging(expected, heard), *_observers(expected, heard)]


def nobody(expected: Expected) -> Finding:
    """Where all could be heard and nobody is there."""
    what = f"nobody of scene {expected.scene.scene} is on the mesh"
    return warning(GROUP, what, f"labanmesh up {expected.path}, or fuse and observe each on its machine")


def unheard(endpoint: str) -> Finding:
    """Where the mesh could not be listened to."""
    return warning(GROUP, f"not listened to, at {endpoint}", "put right what is said of network and security first")


def _fusions(expected: Expected, heard: Heard) -> Iterator[Finding]:
    present = list(dict.fromkeys([*sorted(heard.alive_fusions), *heard.fusions]))
    for name in present:
        said = heard.fusions.get(name, Said())
        if name not in expected.fusions:
            what = f"fusion service {name} is on the mesh and not in this scene file"
            yield error(
                GROUP, what, f"stop it, or name it: fusion.standby = [{name!r}]; every machine needs the same file"
            )
        alive = name in heard.alive_fusions or expected.partly
        yield from member(f"fusion service {name}", said, expected.version, alive)
        if said.skew_s is not None and abs(said.skew_s) > SKEW_S:
            what = f"this machine's clock is {seconds(-said.skew_s)} that of fusion service {name}"
            yield warning(GROUP, what, "synchronise both clocks (NTP): timedatectl set-ntp true, or chrony")
    for name in expected.fusions:
        if name not in present and present:
            what = f"fusion service {name} is missing"
            yield warning(GROUP, what, f"labanmesh fuse {expected.path} --id {name}")
    if not present:
        hint = "" if expected.digest else "; it waits until an observer says the vocabulary"
        yield error(GROUP, "no fusion service is alive: nobody judges", f"labanmesh fuse {expected.path}{hint}")


def _judging(expected: Expected, heard: Heard) -> Iterator[Finding]:
    judging = {name: said for name, said in heard.fusions.items() if said.judgements}
    if len(judging) > 1:
        what = f"{len(judging)} fusion services judge at once: {', '.join(judging)}"
        yield error(
            GROUP, what, "stop all but one, or let the others stand by: fusion.standby in the scene file of all"
        )
    for name, said in judging.items():
        if said.turns > 1:
            yield error(
                GROUP,
                f"two processes judge as fusion service {name}",
                "stop one, or give it an id of its own: fuse --id",
            )
    if judging:
        many, rate = sum(said.judgements for said in judging.values()), heard.listened_s
        yield ok(GROUP, f"{many} judgements in {rate:.1f} s by {', '.join(judging)}")
    elif heard.alive_fusions and heard.listened_s > 0:
        speaking = any(said.posteriors for said in heard.observers.values())
        what = f"no judgement within {heard.listened_s:.1f} s"
        if speaking:
            yield error(GROUP, f"{what}, though observers speak", "see fusion's log; start it again")
        else:
            yield warning(GROUP, f"{what}: no observer speaks", "see what is said of the observers")
    for reason, count in sorted(heard.unnamed.items()):
        what, to_do = strange_speech(reason, count)
        yield error(GROUP, f"judgements: {what}", to_do)


def _observers(expected: Expected, heard: Heard) -> Iterator[Finding]:
    scene = expected.scene
    present = set(heard.alive_observers) | set(heard.observers)
    missing = [name for name in scene.roster if name not in present]
    digest = expected.digest or judged_hash(heard.fusions)
    for name in scene.roster:
        if name in present:
            said = heard.observers.get(name, Said())
            yield from member(name, said, expected.version, name in heard.alive_observers)
            yield from _vocabulary(name, said, digest)
            yield from _two_of(name, said)
            yield from _account(name, said, heard)
    yield from _missing(expected, missing)
    yield from _strangers(expected, sorted(present - set(scene.roster)))


def _missing(expected: Expected, missing: list[str]) -> Iterator[Finding]:
    left, quorum = len(expected.scene.roster) - len(missing), expected.scene.fusion.quorum
    mark: Mark = "warning" if left >= quorum else "error"
    for name in missing:
        what = f"{name} is missing"
        if mark == "error":
            what += f": {left} of {len(expected.scene.roster)} are there, a verdict needs {quorum}"
        yield Finding(GROUP, mark, what, f"labanmesh observe {expected.path} {name}, on its machine; see its log")


def _vocabulary(name: str, said: Said, digest: str) -> Iterator[Finding]:
    foreign = sorted(said.hashes - {digest})
    if digest and foreign:
        what = f"{name} speaks another vocabulary ({', '.join(foreign)}) than the scene ({digest}): it does not count"
        yield error(GROUP, what, "learn its model again from the movements of the others: labanmesh learn")


def _two_of(name: str, said: Said) -> Iterator[Finding]:
    if said.turns > 1:
        what = f"two processes speak as {name}"
        yield error(GROUP, what, "stop one of them, or give it an id of its own in the scene file")


def _account(name: str, said: Said, heard: Heard) -> Iterator[Finding]:
    """What fusion has noticed of an observer: its clock, and what could not be used."""
    accounts = [
        account
        for fusion in heard.fusions.values()
        if fusion.status and fusion.judgements and (account := (fusion.status.observers or {}).get(name))
    ]
    for account in accounts[:1]:
        if account.skew_s is not None and abs(account.skew_s) > SKEW_S:
            what = f"{name}: its clock is {seconds(account.skew_s)} that of fusion"
            yield warning(GROUP, what, "synchronise it (NTP): timedatectl set-ntp true, or chrony, on its machine")
        told = {"foreign_vocabulary"} if said.hashes else set()
        for reason, count in sorted(account.rejected.items()):
            if count and reason not in told | set(said.bad):
                what, to_do = strange_speech(reason, count)
                yield warning(GROUP, f"{name}: {what}", to_do)


def _strangers(expected: Expected, strangers: list[str]) -> Iterator[Finding]:
    if not strangers:
        return
    named = ", ".join(strangers[:NAMED]) + (f" and {len(strangers) - NAMED} more" if len(strangers) > NAMED else "")
    near = nearest(strangers[0], expected.scene.roster)
    to_do = f"name it under [observers.ID] in every machine's scene file, or stop it; {near}"
    yield warning(GROUP, f"on the mesh and not in the scene: {named}; what they say does not count", to_do)
