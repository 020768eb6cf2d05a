"""Results of films, recordings and still people as text."""

from collections.abc import Iterator, Sequence

from benchmarks.clips.judging import ClipResult
from common.vocabulary import ABSTAIN


def line(result: ClipResult) -> str:
    """One film: truth, verdicts, and the best moment."""
    words = [
        f"{verdict.label} {verdict.at_s:.1f} s" + (f" -> {verdict.last}" if verdict.last != verdict.label else "")
        for verdict in result.verdicts
    ]
    best = result.best
    peak = (
        "never moving" if best is None else f"{best.label} {best.p:.2f} at {best.at_s:.1f} s, none {best.unlearned:.2f}"
    )
    mark = "right" if result.first_is_right else "WRONG" if result.words else "none "
    return (
        f"{result.name:6s} {result.seconds:4.1f} s {mark} {result.label:12s} {', '.join(words) or '-':40s} best: {peak}"
    )


def summary(results: Sequence[ClipResult], webcam: Sequence[str] = ()) -> str:
    """The figures: first verdicts of the films with a gesture, words about each of the others, named in `webcam`."""
    gestures = [result for result in results if result.label and result.name not in webcam]
    lines = [] if not gestures else [f"clips: {first_verdicts(gestures)}"]
    for result in results:
        if result.name in webcam:
            words = ", ".join(f"{v.label} {v.at_s:.1f} s" for v in result.words)
            lines.append(f"{result.name}: {len(result.words)} named ({words}), {len(result.verdicts)} in all")
    return "\n".join(lines)


def first_verdicts(results: Sequence[ClipResult]) -> str:
    """How many first verdicts are right, and what became of the others."""
    right = sum(result.first_is_right for result in results)
    wrong = sum(bool(result.words) and not result.first_is_right for result in results)
    abstained = sum(any(v.label == ABSTAIN for v in result.verdicts) for result in results)
    likeliest = sum(result.best is not None and result.best.label == result.label for result in results)
    return (
        f"first verdict right {right} of {len(results)}, wrong {wrong}, with an abstention {abstained}; "
        f"right label most probable at the best moment {likeliest}"
    )


def by_movement(results: Sequence[ClipResult]) -> Iterator[str]:
    """First verdicts for each movement, and of all."""
    for label in sorted({result.label for result in results}):
        yield f"{label:14s} {first_verdicts([result for result in results if result.label == label])}"
    yield f"{'all':14s} {first_verdicts(results)}"


def still_summary(kind: str, results: Sequence[ClipResult]) -> str:
    """How many people who stand still got a verdict that names a movement."""
    wrong = [result for result in results if result.words]
    words = sum(len(result.words) for result in results)
    first = min((v.at_s for result in wrong for v in result.words), default=None)
    when = "" if first is None else f", the first after {first:.1f} s"
    abstained = sum(bool(result.verdicts) and not result.words for result in results)
    return f"{kind}: {len(wrong)} of {len(results)} still people named, {words} times{when}; {abstained} abstentions"
