"""Why a movement has no verdict yet: a line for each case, and for any state a short line or none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config_sections import FusionConfig
from common.messages import WHY_LIMIT
from fusion.engine.segments import PooledState
from fusion.engine.verdicts import explain_undecided

CONFIG = FusionConfig(threshold=0.8, quorum=3, hold_s=0.2)


def why(p=0.9, agreeing=3, unlearned=0.0, observers=4, held_s=None, moved_s=5.0, label="wave", config=CONFIG):
    return explain_undecided(PooledState(0, label, p, agreeing, 0.1, unlearned), observers, held_s, moved_s, config)


@pytest.mark.parametrize(
    ("case", "line"),
    [
        ({"p": 0.79, "unlearned": 0.13}, "wave 79 % of the 80 % needed; 13 % something else"),
        ({"p": 0.7999, "unlearned": 0.004}, "wave 79 % of the 80 % needed"),
        ({"p": 0.05, "unlearned": 0.91}, "91 % something else; wave 5 % of the 80 % needed"),
        (
            {"p": 0.05, "agreeing": 0, "unlearned": 0.91},
            "91 % something else; wave 5 % of the 80 % needed; no observer votes for it, 3 needed",
        ),
        ({"p": 0.29}, "wave 29 % of the 80 % needed"),
        ({"agreeing": 2}, "2 of 3 observers needed vote for wave"),
        ({"agreeing": 1}, "1 of 3 observers needed votes for wave"),
        ({"agreeing": 0}, "no observer votes for wave, 3 needed"),
        ({"agreeing": 2, "observers": 2}, "2 of 3 observers needed are counted"),
        ({"agreeing": 1, "observers": 1}, "1 of 3 observers needed is counted"),
        ({"observers": 0, "label": ""}, "waiting for observers"),
        (
            {"p": 0.5, "agreeing": 2, "unlearned": 0.2},
            "wave 50 % of the 80 % needed; 2 of 3 observers needed vote for it; 20 % something else",
        ),
        ({"held_s": 0.0}, "wave for 0.0 of 0.2 s"),
        ({"held_s": 0.19}, "wave for 0.1 of 0.2 s"),
        ({"held_s": 0.1, "agreeing": 2}, "2 of 3 observers needed vote for wave"),
        ({"held_s": 1.0, "moved_s": 0.1}, "moving for 0.1 of 0.2 s"),
        ({"held_s": 1.0}, None),
    ],
)
def test_the_line_names_what_the_label_lacks(case, line):
    assert why(**case) == line


@given(
    p=st.floats(0, 1), agreeing=st.integers(0, 500), unlearned=st.floats(0, 1), observers=st.integers(0, 500),
    held_s=st.none() | st.floats(0, 1e9), moved_s=st.floats(0, 1e9), threshold=st.floats(1e-9, 1),
    quorum=st.integers(1, 500), hold_s=st.floats(0, 1e9),
)  # fmt: skip
def test_any_state_gives_a_short_line_or_lacks_nothing(threshold, quorum, hold_s, **case):
    config = CONFIG.model_copy(update={"threshold": threshold, "quorum": quorum, "hold_s": hold_s})
    line = why(**case, label="x" * 64, config=config)
    if line is None:
        assert case["p"] >= threshold and case["agreeing"] >= quorum and (case["held_s"] or 0.0) >= hold_s
    else:
        assert 0 < len(line) <= WHY_LIMIT and line.isascii() and line.isprintable()
