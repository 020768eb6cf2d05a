"""Reads and writes model files: .npz without pickles, described in docs/design/model.md.

`header` is a JSON text; arrays named `reference_...` are its reference takes (observer/model/model_file.py); all
other arrays are the model's own.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.message_types import TEXT_LIMIT, MovementTimes
from common.vocabulary import Vocabulary
from observer.features import hop_of, width_of
from observer.files import read_arrays, write_arrays
from observer.geometry.placement import PersonPlacement, placement_of, unlike
from observer.geometry.views import THIS_CAMERA, View, is_this_camera
from observer.model.base import Arrays, Header, MovementModel, array_in
from observer.model.parameters import check_parameters
from observer.model.registry import MODELS, find_model
from observer.motion.archive import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from observer.score.comparison import joints_of, limbs_of, weights_of
from observer.score.references import ReferenceSpread, ReferenceTake, ReferenceTakes

MODEL_FORMAT = 1


def write_model(path: Path, model: MovementModel) -> None:
    """Write the model, completely or not at all; raises BadInput or LabanmeshError as `write_arrays` does."""
    header = np.array(json.dumps(_as_json(model.header), indent=1))
    references = references_as_arrays(model.header.references)
    write_arrays(path, {"header": header, **model.arrays(), **references}, compressed=True)


def read_model(path: Path) -> MovementModel:
    """Read a model file; raises BadInput, one line with the reason, for anything else."""
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise BadInput(f"{path}: no such model file; make one with labanmesh learn") from None
    except ValueError as error:
        raise BadInput(f"{path}: not a model file ({error}); make one with labanmesh learn") from None
    if "header" not in arrays:
        raise BadInput(f"{path}: not a model file: it has no 'header', as labanmesh learn writes it")
    header = str(arrays.pop("header"))
    try:
        return _model_from(header, arrays)
    except BadInput as error:
        reason = str(error)
    except KeyError as error:
        reason = f"of another version of labanmesh, or damaged: it lacks {error}"
    except (TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError) as error:
        reason = f"damaged model file ({' '.join(f'{type(error).__name__}: {error}'.split())[:TEXT_LIMIT]})"
    raise BadInput(f"{path}: {reason}"[: 2 * TEXT_LIMIT] + f"; {_learn_again(path, header)}")


def _learn_again(path: Path, header: str) -> str:
    """The way out: the command that learns the model, where its header says from what."""
    with suppress(ValueError, TypeError, KeyError, AttributeError, RecursionError):
        document = json.loads(header)
        view, archive = str(document["view"]), str(document["provenance"]["archive"])
        seen_from = "" if view.partition(":")[0] == THIS_CAMERA else f" --view {view}"
        command = f"labanmesh learn {archive}{seen_from} -o {path}"
        if command.isprintable() and len(command) < TEXT_LIMIT + len(str(path)):
            return f"learn it again: {command}"
    return "learn it again"


def _model_from(text: str, arrays: dict[str, NDArray[Any]]) -> MovementModel:
    document = json.loads(text)
    if document["format"] != MODEL_FORMAT:
        raise BadInput(f"model format {document['format']}, this labanmesh reads {MODEL_FORMAT}")
    kind, header = find_model(str(document["kind"])), _header_from(document)
    if kind is None:
        raise BadInput(f"model kind {document['kind']!r} is unknown; known: {', '.join(MODELS)}")
    # Parameters that only earlier versions had are left out.
    own = {name: value for name, value in header.parameters.items() if name in kind.PARAMETERS}
    references = references_from_arrays(arrays, header.vocabulary.labels, header.body_parts, header.rate_hz)
    header = replace(header, parameters=own, references=references)
    check_parameters(header.parameters, kind.PARAMETERS)
    return kind.from_arrays(header, arrays)


def require_match(path: Path, model: MovementModel, vocabulary: Vocabulary | None, rate_hz: float | None) -> None:
    """Raise BadInput if the model was learned for another vocabulary or rate; None: any."""
    header = model.header
    if vocabulary is not None and header.vocabulary.digest != vocabulary.digest:
        theirs, ours = ", ".join(header.vocabulary.labels), ", ".join(vocabulary.labels)
        raise BadInput(f"{path}: learned for the vocabulary [{theirs}], the scene has [{ours}]: learn it again")
    if rate_hz is not None and abs(header.rate_hz - rate_hz) > 0.01 * rate_hz:
        raise BadInput(
            f"{path}: learned at {header.rate_hz:g} Hz, the source gives {rate_hz:g} Hz: "
            f"labanmesh learn ... --rate {rate_hz:g}"
        )


def doubt_of_view(path: Path, header: Header, view: View, name: str, person: PersonPlacement | None = None) -> str:
    """Why the model may fit badly if it was learned for another view than the observer's, `name`; "" if it fits.

    A model of this camera's own tracks fits every view of the observer, which it does not use. person: where the scene
    says that the person stands in the room of a camera file.
    """
    again = f"learn it again: labanmesh learn ... --view {name}"
    if is_this_camera(header.matrix):
        return ""
    if view.is_this_camera:
        return (
            f"{path}: learned for {header.view}, not from this camera's tracks; set view to {header.view}, or teach it"
        )
    if not np.allclose(view.matrix, header.matrix):
        return f"{path}: learned for {header.view}, but this observer sees from {view.name}; {again}"
    if person is None or not view.has_place:
        return ""
    if header.placement is None:
        return f"{path}: learned where its recordings say, but the scene has the person at {person}; {again} --place"
    if unlike(header.placement, person, header.parameters.get("facings", 1) > 1):
        return f"{path}: learned for a person at {header.placement}, the scene has them at {person}; {again} --place"
    return ""


def doubt_of_camera(path: Path, header: Header, observer: str, others: Collection[str]) -> str:
    """Why a model taught from the tracks of one of the `others`, observers of the scene, does not fit `observer`."""
    camera = header.view.partition(":")[2] if is_this_camera(header.matrix) else ""
    if camera == observer or camera not in others:
        return ""
    return f"{path}: taught from the tracks of {camera}, and this observer is {observer}; teach it from its own tracks"


def _as_json(header: Header) -> dict[str, Any]:
    background = {} if header.background is None else {"background": list(header.background)}
    person = header.placement
    placement = {} if person is None else {"placement": {"place": list(person.place), "facing": person.facing_deg}}
    times = {label: own.model_dump(exclude_none=True) for label, own in header.vocabulary.movements.items()}
    return {
        "format": MODEL_FORMAT,
        "kind": header.kind,
        "vocabulary": {
            "name": header.vocabulary.name,
            "hash": header.vocabulary.digest,
            "labels": list(header.vocabulary.labels),
            "movements": times,
        },
        "view": header.view,
        "matrix": header.matrix.tolist(),
        "rate_hz": header.rate_hz,
        "body_parts": list(header.body_parts),
        "parameters": dict(header.parameters),
        "provenance": dict(header.provenance),
        **background,
        **placement,
    }


def _header_from(document: dict[str, Any]) -> Header:
    words = document["vocabulary"]
    times = {str(label): MovementTimes.model_validate(own) for label, own in words.get("movements", {}).items()}
    header = Header(
        kind=document["kind"],
        vocabulary=Vocabulary(tuple(words["labels"]), words["name"], times),
        view=document["view"],
        matrix=np.array(document["matrix"], dtype=np.float64).reshape(3, 4),
        rate_hz=float(document["rate_hz"]),
        body_parts=tuple(document["body_parts"]),
        parameters={name: float(value) for name, value in document["parameters"].items()},
        provenance={name: str(value) for name, value in document["provenance"].items()},
        background=tuple(str(label) for label in document["background"]) if "background" in document else None,
        placement=_placement_from(document["placement"]) if "placement" in document else None,
    )
    if not LOWEST_RATE_HZ <= header.rate_hz <= HIGHEST_RATE_HZ:
        raise ValueError(f"rate_hz is {header.rate_hz:g}, {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g} Hz is expected")
    if not header.body_parts or not all(isinstance(part, str) for part in header.body_parts):
        raise ValueError("body_parts must be names")
    if not np.isfinite(header.matrix).all():
        raise ValueError("matrix contains NaN or infinity")
    return header


def _placement_from(document: dict[str, Any]) -> PersonPlacement | None:
    numbers = [float(number) for number in (*document["place"], document["facing"])]
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise ValueError(f"placement is {document}, x, y, z and an angle are expected")
    return placement_of(numbers[:3], numbers[3])


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
