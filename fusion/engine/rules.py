"""Fusion rules: the posteriors of N observers -> one pooled posterior. Each rule has a name in RULES. Pure.

To add a rule, put it into RULES; tests/contracts/test_rules.py then checks that it depends on no order of observers and
labels. Each has two steps, `weigh` and `mix` (weighing.py), so that joint posteriors over movement and facing are
pooled with the weights of the movements alone.
"""

from common.errors import BadInput
from common.fusion_rules import DEFAULT_RULE as DEFAULT_RULE
from common.fusion_rules import RETIRED_RULES
from common.plugins import plugin, plugins
from common.text import nearest
from fusion.engine.guarded_product import guarded_product, guarded_weights
from fusion.engine.weighing import (
    Rule,
    by_entropy,
    equal_weights,
    inverse_entropy,
    linear_mix,
    log_mix,
    minimum_entropy,
    same_exponent,
)

RULES = {
    rule.name: rule
    for rule in (
        # What a scene should use.
        Rule("guarded_product", guarded_weights, log_mix, guarded_product),
        # The paper's, to repeat and to surpass it.
        Rule("inverse_entropy", by_entropy(inverse_entropy), linear_mix),
        # The two axiomatic pools: safe for observers that share their evidence, and right for independent ones.
        Rule("log", same_exponent(lambda n: 1 / n), log_mix),
        Rule("product", same_exponent(lambda n: 1.0), log_mix),
        # Baselines: the surest observer alone, and no weights at all.
        Rule("min_entropy", by_entropy(minimum_entropy), linear_mix),
        Rule("linear", by_entropy(equal_weights), linear_mix),
    )
}


def get_rule(name: str, where: str = "fusion.rule =") -> Rule:
    """The rule of that name, ours or of an installed package; raises BadInput, one line, for an unknown one.

    robust_inverse_entropy, the default of an earlier version, stands for the default. where: what has the name.
    """
    if name == "robust_inverse_entropy":
        return RULES[DEFAULT_RULE]
    rule = RULES.get(name) or plugin("rules", name)
    if rule is None and name in RETIRED_RULES:
        raise BadInput(f"{where} {name!r}: this rule is gone; use {RETIRED_RULES[name]!r}")
    if not isinstance(rule, Rule):
        raise BadInput(f"{where} {name!r}: unknown rule; {nearest(name, (*RULES, *plugins('rules')))}")
    return rule
