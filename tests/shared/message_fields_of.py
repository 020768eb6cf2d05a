"""The fields of any kind of message: posteriors are of msgspec, all others of pydantic."""

from common.messages import PosteriorMessage


def field_names(kind):
    return PosteriorMessage.__struct_fields__ if kind is PosteriorMessage else tuple(kind.model_fields)
