"""All movement models by name."""

from collections.abc import Mapping

from common.errors import BadInput
from common.text import nearest
from observer.model.base import MovementModel
from observer.model.phase import Phase
from observer.model.stacked import Stacked
from observer.model.symbol_tables import FrameTable

MODELS: Mapping[str, type[MovementModel]] = {model.kind: model for model in (Phase, FrameTable, Stacked)}
DEFAULT_MODEL = Stacked.kind


def model_named(kind: str) -> type[MovementModel]:
    """The model of that name; raises BadInput with a suggestion for an unknown one."""
    if kind not in MODELS:
        raise BadInput(f"model = {kind!r}: unknown; {nearest(kind, MODELS)}")
    return MODELS[kind]
