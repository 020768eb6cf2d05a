"""What the provenance of a model tells of its movements: the results of the cross-validation, and on which regions of
the body each leans, by what is lost when a region stands still. Pure."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from common.message_types import PARTS_LIMIT, BodyRegionShares
from observer.model.base import Example, Header
from observer.tracks import Floats32

if TYPE_CHECKING:
    from observer.model.segment_classifier import SegmentClassifier


REGIONS: Mapping[str, tuple[str, ...]] = {
    "left arm": ("left_hand", "left_wrist", "left_elbow"),
    "right arm": ("right_hand", "right_wrist", "right_elbow"),
    "left leg": ("left_foot", "left_ankle", "left_knee"),
    "right leg": ("right_foot", "right_ankle", "right_knee"),
    "trunk": ("head", "neck", "spine", "pelvis", "left_shoulder", "right_shoulder", "left_hip", "right_hip"),
}
"""Body parts by region; a part with another name is a region of its own."""
MOST_EXAMPLES = 6
"""Examples of each movement that are looked at: their mean hardly changes with more."""


def regions_of(body_parts: Sequence[str]) -> dict[str, list[int]]:
    """The regions that these parts have, with the parts' places in their order."""
    region_of = {part: region for region, parts in REGIONS.items() for part in parts}
    regions: dict[str, list[int]] = {}
    for place, part in enumerate(body_parts):
        regions.setdefault(region_of.get(part, part), []).append(place)
    return regions


def leans_on(
    segments: "SegmentClassifier", usual: Floats32, header: Header, examples: Sequence[Example]
) -> dict[str, dict[str, float]]:
    """By movement and region the mean nats that the ended movement loses when the region stays at its usual place.

    usual: (2 P,) as of `BodyTrace`; the examples' features are traces (F, 2 P + 3). At least 0.
    """
    regions, result = regions_of(header.body_parts), {}
    for movement, label in enumerate(header.vocabulary.labels):
        own = [e.features for e in examples if e.movement == movement]
        traces = [
            own[n].astype(np.float32) for n in np.linspace(0, len(own) - 1, min(len(own), MOST_EXAMPLES)).astype(int)
        ]
        shown = list(traces)
        for places in regions.values():
            columns = [2 * place + axis for place in places for axis in (0, 1)]
            for trace in traces:
                shown.append(trace.copy())
                shown[-1][:, columns] = usual[columns]
        logs = segments.log_posteriors(shown)[1, :, movement].reshape(1 + len(regions), -1).mean(axis=1)
        lost = zip(regions, (logs[0] - logs[1:]).tolist(), strict=True)
        result[label] = {region: round(max(nats, 0.0), 2) for region, nats in lost}
    return result


LEANS_ON = "leans_on"
"""Name in a model's provenance."""


LEAST_NATS_SHARE = 0.1
"""A region with less is not named."""


def large_shares(header: Header) -> dict[str, dict[str, float]]:
    """By movement, regions with their shares of its nats, LEAST_NATS_SHARE to 1; {} if the model does not know.

    With a single region there is nothing to tell.
    """
    shares: dict[str, dict[str, float]] = {}
    if len(regions_of(header.body_parts)) < 2:
        return shares
    with suppress(ValueError, AttributeError, TypeError):
        for label, row in json.loads(header.provenance.get(LEANS_ON, "{}")).items():
            ordered = sorted(((str(region), float(nats)) for region, nats in row.items()), key=lambda item: -item[1])
            total = sum(nats for _, nats in ordered)
            of_all = {region: nats / total for region, nats in ordered} if total > 0 else {}
            shares[label] = {region: share for region, share in of_all.items() if share >= LEAST_NATS_SHARE}
    return shares


def region_shares(header: Header) -> BodyRegionShares | None:
    """The large shares as an observer publishes them; None if the model does not know any."""
    rows = large_shares(header)
    regions = [*dict.fromkeys(region for row in rows.values() for region in row)][:PARTS_LIMIT]
    if not regions:
        return None
    of_labels = [rows.get(label, {}) for label in header.vocabulary.labels]
    percent = [[min(100, round(100 * row.get(region, 0.0))) for region in regions] for row in of_labels]
    return BodyRegionShares(hash=header.vocabulary.digest, regions=regions, shares=percent)


Judged = tuple[int, int]
"""Indices of a movement, and of the one as which a model recognised it that had not learned from its performer."""


def with_results(header: Header, results: Sequence[Judged], strange_named: float | None = None) -> Header:
    """The header that tells how many were tried, how many were right, and as what each movement was recognised.

    strange_named: the share of movements that the model does not know which it would name; None if unknown.
    """
    labels, table = header.vocabulary.labels, dict[str, Counter[str]]()
    for truth, judged in results:
        table.setdefault(labels[truth], Counter())[labels[judged]] += 1
    counts = {} if strange_named is None else {"strange_named": f"{strange_named:.2f}"}
    counts |= {"tried": str(len(results)), "right": str(sum(truth == judged for truth, judged in results))}
    return replace(header, provenance={**header.provenance, **counts, "held_out": json.dumps(table)})


def held_out_of(header: Header) -> dict[str, dict[str, int]]:
    """By movement as what its examples were recognised by models that had not learned from them; {} if unknown."""
    with suppress(ValueError, AttributeError, TypeError):
        table = json.loads(header.provenance.get("held_out", "{}"))
        return {str(truth): {str(label): int(n) for label, n in row.items()} for truth, row in table.items()}
    return {}
