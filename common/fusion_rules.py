"""The names of the fusion rules, so that a scene file is checked before anything is computed. Pure."""

from common.errors import BadInput
from common.text import nearest

FUSION_RULES = ("guarded_product", "inverse_entropy", "log", "product", "min_entropy", "linear")
DEFAULT_RULE = FUSION_RULES[0]
RETIRED_RULES = {
    "robust_inverse_entropy": DEFAULT_RULE, "robust_product": "product", "iest": "inverse_entropy",
    "ieat": "inverse_entropy", "median": "log", "chernoff": "log",
}  # fmt: skip
"""Rules of earlier versions, and what stands in for them."""


def rule_name(name: str, where: str = "fusion.rule =") -> str:
    """The fusion rule of that name; raises BadInput, one line, for an unknown one.

    robust_inverse_entropy, the default of an earlier version, still stands for the default. where: what has the name.
    """
    if name == "robust_inverse_entropy":
        return DEFAULT_RULE
    if name in RETIRED_RULES:
        raise BadInput(f"{where} {name!r}: this rule is gone; use {RETIRED_RULES[name]!r}")
    if name not in FUSION_RULES:
        raise BadInput(f"{where} {name!r}: unknown rule; {nearest(name, FUSION_RULES)}")
    return name
