"""Facets: how a movement is performed, each facet a distribution over a few values. Pure.

They are Laban's Effort factors, each with its two poles, and his Shape in three directions. The order of the values is
their order in messages. An observer may also send facets of its own, within the limits below.
"""

import re
from collections.abc import Mapping, Sequence

SUM_TOLERANCE = 1e-3
"""A distribution may miss a sum of 1 by this much: more than float32 arithmetic of a foreign observer loses."""
FACETS_LIMIT = 32
"""Facets in one posterior; more are rejected, so that an observer cannot grow every judgement."""
VALUES_LIMIT = 72
"""Values of one facet: as many as there may be facings."""
NAME = re.compile(r"[a-z0-9_-]{1,64}\Z")

EFFORT: Mapping[str, tuple[str, str]] = {
    "effort_time": ("sustained", "sudden"),
    "effort_weight": ("light", "strong"),
    "effort_space": ("indirect", "direct"),
    "effort_flow": ("free", "bound"),
}
SHAPE: Mapping[str, tuple[str, str, str]] = {
    "shape_horizontal": ("enclosing", "neither", "spreading"),
    "shape_vertical": ("sinking", "neither", "rising"),
    "shape_sagittal": ("retreating", "neither", "advancing"),
}
FACETS: Mapping[str, tuple[str, ...]] = {**EFFORT, **SHAPE}


class NotADistribution(ValueError):  # noqa: N818 - it names what the values are not
    """Probabilities that do not sum to 1, or one outside 0 to 1."""


def check_facets(facets: Mapping[str, Sequence[float]]) -> None:
    """Check name -> probabilities of the values; raises ValueError that names the facet and the rule.

    As `check_facet_names`, and each facet sums to 1.
    """
    check_facet_names(facets)
    for name, p in facets.items():
        require_sum(f"facet {name}", p)


def check_facet_names(facets: Mapping[str, Sequence[float]]) -> None:
    """Check name -> values; raises ValueError that names the facet and the rule.

    There are at most FACETS_LIMIT facets of at most VALUES_LIMIT values, and a known facet has exactly its values.
    """
    if len(facets) > FACETS_LIMIT:
        raise ValueError(f"{len(facets)} facets; at most {FACETS_LIMIT} are allowed")
    for name, p in facets.items():
        known = FACETS.get(name)
        if known is not None:
            if len(p) != len(known):
                raise ValueError(f"facet {name} has {len(p)} values; it has {len(known)}: {', '.join(known)}")
        elif not NAME.match(name):
            raise ValueError(f"facet {name[:64]!r}: a name is 1 to 64 characters of a-z, 0-9, _ and -")
        elif len(p) > VALUES_LIMIT:
            raise ValueError(f"facet {name} has {len(p)} values; at most {VALUES_LIMIT} are allowed")


def require_sum(name: str, p: Sequence[float]) -> None:
    """Raises NotADistribution that names the distribution `name` unless `p` sums to 1 within SUM_TOLERANCE."""
    if not abs(sum(p) - 1) <= SUM_TOLERANCE:
        raise NotADistribution(f"{name} sums to {sum(p):.6g}, not to 1")
