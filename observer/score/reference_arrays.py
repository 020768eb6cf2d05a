"""The references of a model's movements as the arrays of its file. Pure."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, array_in
from observer.model.body_trace import hop_of, width_of
from observer.score.comparison import joints_of, limbs_of, weights_of
from observer.score.references import ReferenceSpread, ReferenceTake, ReferenceTakes

LABELS_ARRAY = "reference_labels"
"""The array that a model file with references has."""


def references_as_arrays(references: Mapping[str, ReferenceTakes]) -> dict[str, NDArray[np.generic]]:
    """For a model file; nothing for a model without references."""
    if not references:
        return {}
    takes = [take for own in references.values() for take in own.takes]
    spreads = [own.spread for own in references.values()]
    return {
        LABELS_ARRAY: np.array([*references], np.str_),
        "reference_counts": np.array([len(own.takes) for own in references.values()], np.int32),
        "reference_traces": np.concatenate([take.trace for take in takes]).astype(np.float32),
        "reference_lengths": np.array([len(take.trace) for take in takes], np.int32),
        "reference_people": np.array([take.person for take in takes], np.str_),
        "reference_mirrored": np.array([take.mirrored for take in takes], np.bool_),
        "reference_usual": np.array([each.usual for each in spreads]),
        "reference_spreads": np.array([each.spread for each in spreads]),
        "reference_scales": np.array([(each.farthest, each.typical) for each in spreads]),
        "reference_remarked": np.array([each.remarked for each in spreads]),
    }


def references_from_arrays(
    arrays: Arrays, labels: Sequence[str], body_parts: Sequence[str], rate_hz: float
) -> dict[str, ReferenceTakes]:
    """The inverse, for a model of these labels, parts and rate; ValueError for arrays that do not fit."""
    if LABELS_ARRAY not in arrays:
        return {}
    own = [str(label) for label in arrays[LABELS_ARRAY]]
    joints = len(joints_of(body_parts))
    deviations = len(weights_of(limbs_of(body_parts), joints_of(body_parts)))
    traces = array_in(arrays, "reference_traces", (None, width_of(len(body_parts))), np.float32)
    lengths = array_in(arrays, "reference_lengths", (None,), np.int64)
    columns = {"usual": deviations, "spreads": deviations, "scales": 2, "remarked": joints}
    numbers = [array_in(arrays, f"reference_{n}", (len(own), count), np.float64) for n, count in columns.items()]
    if lengths.sum() != len(traces) or (lengths < 2).any() or (numbers[1] <= 0).any():
        raise ValueError("reference_traces do not fit reference_lengths, or spreads are not above 0")
    if len({*own}) != len(own) or not {*own} <= {*labels}:
        raise ValueError("references of movements that the model does not have")
    pieces = np.split(traces, np.cumsum(lengths)[:-1])
    takes = [
        ReferenceTake(trace, str(person), bool(mirrored))
        for trace, person, mirrored in zip(
            pieces, arrays["reference_people"], arrays["reference_mirrored"], strict=True
        )
    ]
    ends = np.cumsum(np.asarray(arrays["reference_counts"], np.int64))
    if len(ends) != len(own) or ends[-1] != len(takes):
        raise ValueError("reference_counts do not fit")
    result = {}
    for n, (label, end) in enumerate(zip(own, ends, strict=True)):
        usual, spreads, (farthest, typical), remarked = (each[n] for each in numbers)
        spread = ReferenceSpread(usual, spreads, float(farthest), float(typical), remarked)
        begin = int(ends[n - 1]) if n else 0
        result[label] = ReferenceTakes(takes[begin : int(end)], body_parts, rate_hz / hop_of(rate_hz), spread)
    return result
