"""Keys: the contract's, to the letter, and names that are safe in Zenoh, MQTT and Home Assistant."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from common.keys import SceneKeys, identifier, observer_of

IDS = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=64)


def test_the_contract():
    keys = SceneKeys("dojo")
    assert keys.posterior("cam1") == "laban/dojo/observer/cam1/posterior"
    assert keys.observer_status("cam1") == "laban/dojo/observer/cam1/status"
    assert keys.observer_alive("cam1") == "laban/dojo/observer/cam1/alive"
    assert keys.fusion_status("f") == "laban/dojo/fusion/f/status"
    assert keys.fusion_alive("f") == "laban/dojo/fusion/f/alive"
    assert (keys.judgement, keys.verdict) == ("laban/dojo/judgement", "laban/dojo/verdict")
    assert keys.vocabulary == "laban/dojo/vocabulary"
    assert keys.posterior() == "laban/dojo/observer/*/posterior"


def test_the_prefix_may_be_a_path():
    assert SceneKeys("dojo", "home/laban").judgement == "home/laban/dojo/judgement"


@given(IDS, IDS, IDS)
def test_an_observer_is_found_again_in_each_of_its_keys(prefix, scene, observer):
    keys = SceneKeys(scene, prefix)
    for key in (keys.posterior(observer), keys.observer_status(observer), keys.observer_alive(observer)):
        assert observer_of(key) == observer


@given(st.text(max_size=70))
def test_an_identifier_is_legal_or_refused_by_name(text):
    legal = 1 <= len(text) <= 64 and all(c in "abcdefghijklmnopqrstuvwxyz0123456789_-" for c in text)
    if legal:
        assert identifier(text, "scene") == text
    else:
        with pytest.raises(BadInput, match=r"^scene = ") as caught:
            identifier(text, "scene")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", ["", "Dojo", "do jo", "a/b", "*", "dojo\n", "x" * 65, "größe"])
def test_no_scene_or_prefix_that_is_no_key(bad):
    with pytest.raises(BadInput, match=r"^scene = "):
        SceneKeys(bad)
    if bad != "a/b":
        with pytest.raises(BadInput, match=r"^mesh.prefix = "):
            SceneKeys("dojo", f"laban/{bad}")
