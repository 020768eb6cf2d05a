"""The text of an evaluation for people, from its JSON. Pure."""

from typing import Any

import numpy as np

from common.text import plural
from studies.metrics import confused_pairs, confusion_table

RESOLVED_SHOWN = 10


def as_text(figures: dict[str, Any]) -> str:
    """For people: the settings, the accuracy by view and fused over time, and the confusion table."""
    settings = f"{figures['model']}, {figures['rule']}, onset {figures['onset']}, turn {figures['turn']}"
    rows = [*((name, figures["per_view"][name]) for name in figures["views"]), ("fused", figures)]
    complete = figures.get("complete", {"n_test": 0})
    if 0 < complete["n_test"] < figures["n_test"]:
        rows.append(("complete", complete))
    width = max(len(name) for name, _ in rows)
    head = " " * width + "".join(f"{float(f):>7.0%}" for f in figures["accuracy_at"]) + "    end"
    lines = [
        f"{name:<{width}}" + "".join(f"{a:>7.3f}" for a in row["accuracy_at"].values()) + f"{row['accuracy']:>7.3f}"
        for name, row in rows
    ]
    calibration = ", ".join(f"{name} {figures['per_view'][name]['ece']:.3f}" for name in figures["views"])
    table = confusion_table(
        np.array(figures["confusion"]), figures["labels"], "judged (columns) against true (rows), fused"
    )
    parts = [
        f"{plural(figures['n_train'], 'recording')} learned, {figures['n_test']} judged; {settings}",
        "",
        "accuracy after this share of the movement:",
        head,
        *lines,
        *_sensors_text(figures),
        "",
        f"calibration error {figures['ece']:.3f} ({calibration}), Brier {figures['brier']:.3f}, "
        f"log loss {figures['log_loss']:.3f}",
        *_first_word_text(figures),
        *_facing_text(figures),
        f"learned in {figures['train_seconds']:.1f} s, {figures['seconds_per_frame'] * 1e3:.2f} ms per frame and view",
        *(stream_text(figures["stream"]) if "stream" in figures else ()),
        "",
        table,
    ]
    return "\n".join(parts)


def _sensors_text(figures: dict[str, Any]) -> list[str]:
    if not figures["sensors"]:
        return []
    counts = ", ".join(f"{name} {figures['per_view'][name]['n_test']}" for name in figures["views"])
    return [
        f"of {plural(figures['n_test'], 'performance')} the sensors recorded: {counts}; "
        f"all of them {figures['complete']['n_test']} (complete); a performance is judged by the sensors that have it"
    ]


def _first_word_text(figures: dict[str, Any]) -> list[str]:
    words = figures.get("first_word")
    if not words:
        return []
    if words["accuracy"] is None:
        return ["no verdict names a movement within a trial"]
    return [
        f"first words: {words['coverage']:.1%} of the trials get one, {words['accuracy']:.1%} of these are right, "
        f"median at {words['median_fraction']:.0%} of the movement; calibration error then "
        f"{figures['ece_first_word']:.3f}"
    ]


def _facing_text(figures: dict[str, Any]) -> list[str]:
    facing = figures["facing"]
    if facing is None:
        return []
    return [f"facing within 30 degrees in {facing['within_30_deg']:.1%}, median {facing['median_deg']:.1f} degrees"]


def resolved_pairs(figures: dict[str, Any]) -> str:
    """The movements that one view confuses and fusion tells apart, as nthrow and ok in the paper."""
    lines = []
    for name in figures["views"]:
        one, fused = np.array(figures["per_view"][name]["confusion"]), np.array(figures["confusion"])
        lines += [
            f"{name}: {pair.true} as {pair.judged} {plural(pair.count_in_one_view, 'time')}, fused {pair.count_fused}"
            for pair in confused_pairs(one, fused, figures["labels"])[:RESOLVED_SHOWN]
        ]
    return "\n".join(["confusions of one view that fusion resolves:", *(lines or ["none"])])


def stream_text(stream: dict[str, Any]) -> list[str]:
    """The scores by the first and the last word, by person, by threshold, and those of other motion, as lines."""
    lines = [
        f"in streams: {plural(stream['movements'], 'movement')} in {stream['minutes']:.1f} minutes, "
        f"median latency of right verdicts {_or_none(stream['median_latency_s'], '.2f', ' s')}, "
        f"right in {_or_none(stream['frames_right'], '.1%')} of the frames",
        "",
        *_by_word(stream),
    ]
    if len(stream["per_person"]) > 1:
        lines += ["", *_by_person(stream["per_person"])]
    if stream["unlearned"]:
        lines += [
            "",
            f"{stream['unlearned_named']:.1%} of {plural(stream['unlearned'], 'unlearned movement')} got a label, "
            f"{stream['unlearned_named_last_word']:.1%} by the last word",
            *_by_threshold(stream["by_threshold"]),
        ]
    return [*lines, *_other_motion(stream["other_motion"])] if "other_motion" in stream else lines


def _or_none(number: float | None, form: str, unit: str = "") -> str:
    return "none" if number is None else f"{number:{form}}{unit}"


STREAM_COLUMNS = ("f1", "precision", "recall", "false_alarms_per_minute", "abstentions_per_minute")
STREAM_HEAD = f"{'F1':>7}{'precision':>11}{'recall':>8}{'false/min':>11}{'abstained/min':>15}"


def _cells(row: dict[str, Any], suffix: str = "") -> str:
    """One row of STREAM_COLUMNS."""
    cells = zip((7, 11, 8, 11, 15), STREAM_COLUMNS, (3, 3, 3, 2, 2), strict=True)
    return "".join(f"{row[name + suffix]:>{width}.{digits}f}" for width, name, digits in cells)


def _by_word(stream: dict[str, Any]) -> list[str]:
    note = "false/min: verdicts that name a movement, a minute of other motion; abstained/min: a minute of all"
    rows = [f"{'first word':<11}{_cells(stream)}", f"{'last word':<11}{_cells(stream, '_last_word')}"]
    return [f"{'':<11}{STREAM_HEAD}", *rows, note]


def _by_person(people: dict[str, dict[str, Any]]) -> list[str]:
    width = max(len("by first word"), *map(len, people))
    rows = (
        f"{name:<{width}}{_cells(row)}{_or_none(row['median_latency_s'], '.2f', ' s'):>10}"
        for name, row in people.items()
    )
    return [f"{'by first word':<{width}}{STREAM_HEAD}{'latency':>10}", *rows]


def _other_motion(other: dict[str, Any]) -> list[str]:
    """Streams in which no movement of the vocabulary happens."""
    people = ", ".join(
        f"{name} {row['named_per_minute']:.2f} ({row['minutes']:.1f} minutes)"
        for name, row in other["per_person"].items()
    )
    return [
        "",
        f"other motion, {other['minutes']:.1f} minutes: {other['named_per_minute']:.2f} verdicts a minute name a "
        f"movement, {other['named_per_minute_last_word']:.2f} by the last word; "
        f"{other['abstentions_per_minute']:.2f} abstain; by person: {people}",
    ]


def _by_threshold(rows: list[dict[str, Any]]) -> list[str]:
    """The trade-off that [fusion] threshold controls, by the first and the last word of the verdicts."""
    names = ("unlearned_named", "recall", "f1")
    lines = ["threshold  named recall     F1, last word: named recall     F1"] if rows else []
    for row in rows:
        first = "".join(f"{row[name]:7.3f}" for name in names)
        last = "".join(f"{row[name + '_last_word']:7.3f}" for name in names)
        lines.append(f"{row['threshold']:9.2f}{first}{'':13}{last}")
    return lines
