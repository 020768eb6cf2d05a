"""Two SIMULATED people in one scene, whose movements are known to the frame, and who sees them. Run as a process.
python fault_people.py SCENE.toml OBSERVER [LIE]: publishes what the observer sees of both, or one of LIES in its
place."""

import itertools
import random
import sys
import time
from pathlib import Path

from common import SECOND_NS
from common.config import read_scene
from common.floor_place import FloorPlace
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import PosteriorMessage, VocabularyReference
from common.wire import encode

LABELS = ("bowing", "lunging", "stretch", "waving")
PEOPLE = {"left": (1.0, 0.0), "right": (-1.0, 0.0)}
"""Where each stands on the floor, x and z in m."""
OBSERVERS = ("door", "corner", "wheel")
CYCLE_NS, MOVES_NS = 3 * SECOND_NS, round(1.4 * SECOND_NS)
"""Each movement and the rest after it, and the movement alone."""
APART_NS = {"left": 0, "right": round(0.4 * SECOND_NS)}
"""How much later each person begins."""
RATE_HZ = 20.0
ERROR_M = 0.05
"""Standard deviation of each coordinate of a place."""


def label_of(person, number):
    """What a person does in a cycle; never what the other does."""
    return LABELS[(number + 2 * (person == "right")) % len(LABELS)]


def seen(person, at_ns):
    """What they do at a time: the label, and whether they move."""
    number, since_ns = divmod(at_ns - APART_NS[person], CYCLE_NS)
    return label_of(person, number), since_ns < MOVES_NS


def sightings(person, at_ns, chance):
    """Of an honest observer: track, place, label, and whether they move."""
    x, z = PEOPLE[person]
    place = (x + chance.gauss(0, ERROR_M), z + chance.gauss(0, ERROR_M))
    return person, place, 0.04, *seen(person, at_ns)


def exchanged(at_ns, _since_ns, _chance):
    """Each at the other's place, with what the other does."""
    for person, other in itertools.permutations(PEOPLE):
        yield person, PEOPLE[other], 0.0001, *seen(person, at_ns)


def drifting(at_ns, since_ns, _chance):
    """Both move slowly to the other's place and back, for sure."""
    share = abs((since_ns / SECOND_NS / 4) % 2 - 1)
    for person, (x, z) in PEOPLE.items():
        yield person, (x * (2 * share - 1), z), 0.0001, *seen("left" if person == "right" else "right", at_ns)


def invented(at_ns, _since_ns, _chance):
    """Six more people, who all do something else."""
    for number in range(6):
        yield f"ghost{number}", (-2.5 + number, 2.0), 0.0001, LABELS[(at_ns // CYCLE_NS) % 4], True


def flapping(at_ns, _since_ns, chance):
    """New tracks in every frame, at either place, with any label."""
    for person in PEOPLE:
        track = f"{person}{chance.randrange(10**6)}"
        yield track, PEOPLE[chance.choice(list(PEOPLE))], 0.0001, chance.choice(LABELS), True


def merged(at_ns, _since_ns, _chance):
    """Both in the middle, in rest."""
    for person in PEOPLE:
        yield person, (0.0, 0.0), 0.0001, LABELS[0], False


def mistaken(at_ns, _since_ns, _chance):
    """Both where they are, always with the other's movement."""
    for person, other in itertools.permutations(PEOPLE):
        yield person, PEOPLE[person], 0.0001, *seen(other, at_ns)


LIES = {lie.__name__: lie for lie in (exchanged, drifting, invented, flapping, merged, mistaken)}


def publish(scene, link, stop, observer, lie=None):
    """Until `stop` is set, what `observer` sees."""
    chance, seq, began_ns = random.Random(observer), itertools.count(), time.time_ns()  # noqa: S311 - to be repeated
    publisher, vocabulary = link.publisher(scene.keys.posterior(observer)), scene.named_vocabulary
    reference = VocabularyReference(name=vocabulary.name, hash=vocabulary.digest)
    session = str(began_ns)
    link.announce(scene.keys.observer_alive(observer))
    print("publishes", flush=True)
    while not stop.wait(1 / RATE_HZ):
        now_ns = time.time_ns()
        honest = [sightings(person, now_ns, chance) for person in PEOPLE]
        for track, at, variance, label, moves in LIES[lie](now_ns, now_ns - began_ns, chance) if lie else honest:
            p = [0.01] * len(LABELS)
            p[LABELS.index(label)] = 1 - 0.01 * (len(LABELS) - 1)
            message = PosteriorMessage(
                v=1, scene=scene.scene, observer=observer, seq=next(seq), session=session, captured_ns=now_ns,
                sent_ns=now_ns, vocabulary=reference, p=p if moves else [0.25] * 4, rest=0.05 if moves else 0.95,
                frames=1, person=track, place=FloorPlace(at=at, covariance=(variance, 0.0, variance)),
            )  # fmt: skip
            publisher.put(encode(message))


if __name__ == "__main__":
    scene, observer = read_scene(Path(sys.argv[1])), sys.argv[2]
    with (
        stop_on_signals() as stop,
        Link.open(scene.mesh, "observer", process_id=observer, scene=scene.scene) as link,
    ):
        publish(scene, link, stop, observer, *sys.argv[3:])
