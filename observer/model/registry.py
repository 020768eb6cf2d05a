"""All movement models by name."""

from collections.abc import Mapping
from difflib import get_close_matches

from common.errors import BadInput
from observer.model.base import MovementModel
from observer.model.frame_table import FrameTable
from observer.model.phase import Phase
from observer.model.phase_symbols import PhaseSymbols

MODELS: Mapping[str, type[MovementModel]] = {model.kind: model for model in (Phase, PhaseSymbols, FrameTable)}
DEFAULT_MODEL = Phase.kind


def model_named(kind: str) -> type[MovementModel]:
    """The model of that name; raises BadInput that lists the known ones."""
    if kind not in MODELS:
        near = get_close_matches(kind, MODELS, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise BadInput(f"model = {kind!r}: unknown{hint}; known: {', '.join(MODELS)}")
    return MODELS[kind]
