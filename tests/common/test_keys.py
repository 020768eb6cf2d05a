"""Names: keys, identifiers, vocabularies and addresses, and the text helpers."""

import hashlib

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from common.address import Address
from common.errors import BadInput
from common.keys import SceneKeys, identifier, observer_of, scene_of
from common.text import named_numbers, one_of, plural, split_list
from common.vocabulary import Vocabulary

IDS = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=64)
LABELS = st.lists(
    st.text("abcxyz019_", min_size=1, max_size=64).filter(lambda s: s != "abstain"), min_size=2, max_size=9, unique=True
)


def test_the_keys_of_the_contract():
    keys = SceneKeys("dojo")
    assert keys.posterior("cam1") == "laban/dojo/observer/cam1/posterior"
    assert keys.observer_status("cam1") == "laban/dojo/observer/cam1/status"
    assert keys.observer_alive("cam1") == "laban/dojo/observer/cam1/alive"
    assert keys.fusion_status("f") == "laban/dojo/fusion/f/status"
    assert keys.fusion_alive("f") == "laban/dojo/fusion/f/alive"
    assert (keys.judgement, keys.verdict) == ("laban/dojo/judgement", "laban/dojo/verdict")
    assert keys.vocabulary == "laban/dojo/vocabulary"
    assert keys.posterior() == "laban/dojo/observer/*/posterior"
    assert SceneKeys("dojo", "home/laban").judgement == "home/laban/dojo/judgement"


@given(IDS, IDS, IDS)
def test_a_key_gives_back_its_scene_and_process(prefix, scene, process):
    keys = SceneKeys(scene, prefix)
    for key in (keys.posterior, keys.observer_status, keys.observer_alive, keys.fusion_status, keys.fusion_alive):
        assert (scene_of(key(process)), observer_of(key(process))) == (scene, process)


@given(st.text(max_size=70))
def test_an_identifier_is_legal_or_rejected_by_name(text):
    if 1 <= len(text) <= 64 and all(c in "abcdefghijklmnopqrstuvwxyz0123456789_-" for c in text):
        assert identifier(text, "scene") == text
    else:
        with pytest.raises(BadInput, match=r"^scene = ") as caught:
            identifier(text, "scene")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("words", "name"), [(("a/b",), "scene"), (("*",), "scene"), (("dojo", "laban/*"), "mesh.prefix")]
)
def test_an_illegal_scene_or_prefix_is_rejected(words, name):
    with pytest.raises(BadInput, match=f"^{name} = "):
        SceneKeys(*words)


def test_the_digest_of_a_vocabulary_is_the_documented_one():
    assert Vocabulary(("bow", "lunge")).digest == hashlib.sha256(b"bow\nlunge\n").hexdigest()[:16]
    assert Vocabulary(("bow", "lunge"), "other").digest == Vocabulary(("bow", "lunge")).digest
    assert Vocabulary(("ab", "c")).digest != Vocabulary(("a", "bc")).digest


@given(LABELS, st.randoms())
def test_every_label_and_the_order_count(labels, random):
    vocabulary = Vocabulary(tuple(labels))
    assert [vocabulary.index(label) for label in labels] == list(range(vocabulary.size))
    shuffled = labels.copy()
    random.shuffle(shuffled)
    assume(shuffled != labels)
    assert Vocabulary(tuple(shuffled)).digest != vocabulary.digest


@pytest.mark.parametrize(
    ("labels", "rule"),
    [
        (("bow",), "at least two"),
        (("bow", "lunge", "bow"), "'bow' occurs twice"),
        *((("bow", label), "use 1 to 64 lower case letters") for label in ("Lunge", "", "x" * 65, "lunge\n", "größe")),
        (("bow", "abstain"), "'abstain': reserved"),
    ],
)
def test_bad_labels_are_rejected_in_one_line(labels, rule):
    with pytest.raises(BadInput, match=rule) as caught:
        Vocabulary(labels)
    assert "\n" not in str(caught.value)


def test_an_unknown_label_lists_the_known_ones():
    with pytest.raises(BadInput, match="'punch': not in the vocabulary; known: bow, lunge"):
        Vocabulary(("bow", "lunge")).index("punch")


@pytest.mark.parametrize(
    ("text", "host", "port", "reachable"),
    [
        ("127.0.0.1:9464", "127.0.0.1", 9464, "127.0.0.1:9464"),
        ("attic:65535", "attic", 65535, "attic:65535"),
        ("0.0.0.0:1", "0.0.0.0", 1, "127.0.0.1:1"),  # noqa: S104 - a name only, nothing is bound
        ("[::]:0", "::", 0, "[::1]:0"),
    ],
)
def test_an_address_survives_the_round_trip_and_is_reached_on_this_machine(text, host, port, reachable):
    address = Address.parse(text, "metrics.listen")
    assert (address.host, address.port, str(address), str(address.reachable)) == (host, port, text, reachable)


@pytest.mark.parametrize(
    "text", ["9464", ":9464", "host:", "host:65536", "::1:9464", "a b:1", "host:1/x", "http://h:1"]
)
def test_a_bad_address_is_one_line(text):
    with pytest.raises(BadInput, match=r"^metrics\.listen = .*: must be HOST:PORT with a port up to 65535, e\.g\. "):
        Address.parse(text, "metrics.listen")


def test_text_helpers():
    assert [plural(n, "recording") for n in (0, 1, 2)] == ["0 recordings", "1 recording", "2 recordings"]
    assert [plural(n, "person", "people") for n in (1, 2)] == ["1 person", "2 people"]
    assert split_list("--labels", "a, b") == ("a", "b") and split_list("--labels", "") == ()
    assert named_numbers("-p", ["a=1", " b = 2.5"]) == {"a": 1.0, "b": 2.5}
    assert one_of("--rule", "log", ["log", "linear"]) == "log"


@pytest.mark.parametrize(
    ("parse", "words"),
    [(split_list, ("a,,b",)), *((named_numbers, ([text],)) for text in ("a", "=1", "a=b")), (one_of, ("lg", ["log"]))],
)
def test_a_bad_value_of_an_option_is_one_line(parse, words):
    with pytest.raises(BadInput, match=r"^--rule '.*': "):
        parse("--rule", *words)
