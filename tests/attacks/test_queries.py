"""A query by a listener changes nothing: the service neither gives a scene away nor stops judging it."""

import time


def selectors(scene):
    """Those that hubs send, and those that reach the handover."""
    keys = scene.keys
    return (
        f"{keys.root}/**",
        f"{keys.root}/*/*/*",
        "**",
        f"{keys.root}/fusion/*/handover",
        keys.fusion_handover("fusion"),
    )


def test_queries_with_and_without_a_payload_change_nothing(stage, long_form):
    attacker, since_ns = stage.attacker(), time.time_ns()
    for scene in (stage.scenes[0], stage.scenes[-1]):
        for selector in selectors(scene):
            for payload in (None, b"second", b"nobody", b"\xff" * 70_000) if long_form else (b"second",):
                answers = attacker.ask(selector, payload, 0.05)
                assert not [key for key, _ in answers if key.endswith("/handover")], answers
    gaps = stage.gaps(since_ns)
    assert max(gaps.values()) <= stage.longest_gap_s, gaps
    # The first has a standby service, which may lead since an earlier attack.
    assert {owner for name in stage.names[1:] for owner in stage.witness.leaders(name, since_ns)} == {"fusion"}
