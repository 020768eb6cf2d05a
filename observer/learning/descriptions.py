"""What `learn` and `forget` print about a model. Pure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from common.text import periods_line, plural

if TYPE_CHECKING:
    from pathlib import Path

    from observer.learning.editing import EditedModel
    from observer.model.base import Header
    from observer.motion.archive import MotionArchive


def describe_evaluation(header: "Header") -> str:
    """How well the model did on examples that it had not learned."""
    tried, right = int(header.provenance.get("tried", "0")), int(header.provenance.get("right", "0"))
    result = f"right {100 * right / tried:.0f} %" if tried else "its accuracy is unknown"
    strange = header.provenance.get("strange_named")
    named = "" if strange is None else f"; of movements that it does not know it names about {float(strange):.0%}"
    return f"tried on {_left_out(tried)}: {result}{_weighed(header)}{named}"


def describe_leaning(header: "Header") -> list[str]:
    """Which regions of the body the movements lean on; no line for a model that does not know, and for one region."""
    from observer.model.leaning import large_shares

    rows = large_shares(header)
    width = max(map(len, rows), default=0)
    named = {label: ", ".join(f"{region} {share:.0%}" for region, share in row.items()) for label, row in rows.items()}
    return [f"  {label:{width}}  leans on {regions}" for label, regions in named.items() if regions]


def describe_periods(header: "Header") -> list[str]:
    """Which movements are repeated; no line if none is."""
    periods = header.vocabulary.periods
    return [periods_line(periods)] if periods else []


def describe_placement(header: "Header", archive: "MotionArchive") -> list[str]:
    """For the model of a camera file, where it expects the person; no line for other views."""
    from observer.motion.projected import mean_place

    if not header.matrix[2, :3].any():
        return []
    if header.placement is not None:
        known = header.parameters.get("facings", 1) == 1
        place = ", ".join(f"{metres:.2f}" for metres in header.placement.place)
        return [f"for a person at {header.placement}" if known else f"for a person at [{place}] m, facing anywhere"]
    x, z = mean_place(archive)
    return [
        f"for a person where the recordings have theirs, on average at x, z = {x:.1f}, {z:.1f} m, facing -z; if they "
        "will stand elsewhere, say so with --place and --facing, which labanmesh camera place finds"
    ]


def describe_references(header: "Header") -> list[str]:
    """How many takes show how each movement should be done; no line for a model without references."""
    if not header.references:
        return []
    known = header.references.items()
    own = ", ".join(f"{label} by {plural(references.count, 'reference take')}" for label, references in known)
    return [f"scores {own}"]


def describe_addition(output: "Path", edited: "EditedModel") -> str:
    """The movements that were added, and how well they are recognised."""
    header, labels = edited.model.header, ", ".join(edited.labels)
    examples = f"{plural(edited.examples, 'example')} of {plural(edited.people, 'person', 'people')}"
    lines = [f"{output}: {labels} added from {examples}; {describe_vocabulary(header)}"]
    if edited.promoted:
        lines.append(f"no longer something else: {', '.join(edited.promoted)}")
    share = f": right {100 * edited.right / edited.tried:.0f} %" if edited.tried else ""
    lines.append(f"tried on {_left_out(edited.tried)} of {labels}{share}{_weighed(header)}")
    return "\n".join(lines)


def _left_out(count: int) -> str:
    return plural(count, "left-out example") if count else "no left-out examples"


def describe_background(header: "Header") -> str:
    """The background from which the model knows something else."""
    from observer.model.base import knows_blends_only

    known = list(header.background or ())
    seconds = float(header.provenance.get("other_motion_s", "0"))
    if seconds:
        people = plural(int(header.provenance["other_motion_people"]), "person", "people")
        known.append(f"{seconds / 60:.1f} minutes of other motion of {people}")
    if knows_blends_only(header):
        return "something else is known by blends of the movements; --background adds recordings of what else people do"
    return f"something else is known by blends of the movements and by {', '.join(known)}"


def describe_camera(header: "Header", recorded: Sequence[str]) -> str:
    """That the model holds for one place of one camera, and which of the parts `recorded` it reads."""
    camera = header.view.partition(":")[2]
    line = f"taught from the tracks of {camera or 'one camera'}: teach it again when the camera moves"
    left_out = len(set(recorded) - set(header.body_parts))
    read = ", ".join(header.body_parts)
    return f"{line}\nreads {read} of {plural(len(recorded), 'part')} in the tracks (--body-parts)" if left_out else line


def describe_vocabulary(header: "Header") -> str:
    """What to do with the other observers of the scene, whose posteriors would otherwise be rejected."""
    vocabulary = header.vocabulary
    return (
        f"{vocabulary.size} movements now: edit the models of all observers of the scene alike, because fusion rejects "
        f"posteriors of another vocabulary (this is {vocabulary.digest})"
    )


def _weighed(header: "Header") -> str:
    """That the members of the model are weighed by the examples left out; "" for a kind without something else."""
    return "" if header.background is None else ", and weighed by that"
