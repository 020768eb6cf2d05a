"""The vocabulary: an order of names, and a digest that other languages can compute too."""

import hashlib

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from common.errors import BadInput
from common.vocabulary import Vocabulary

LABELS = st.lists(
    st.text("abcxyz019_", min_size=1, max_size=64).filter(lambda s: s != "abstain"), min_size=2, max_size=9, unique=True
)


def test_the_digest_is_the_documented_one():
    assert Vocabulary(("bow", "lunge")).digest == hashlib.sha256(b"bow\nlunge\n").hexdigest()[:16]
    assert Vocabulary(("bow", "lunge"), "other").digest == Vocabulary(("bow", "lunge")).digest


@given(LABELS, st.randoms())
def test_every_name_and_the_order_count(labels, random):
    vocabulary = Vocabulary(tuple(labels))
    assert [vocabulary.index(label) for label in labels] == list(range(vocabulary.size))
    shuffled = labels.copy()
    random.shuffle(shuffled)
    assume(shuffled != labels)
    assert Vocabulary(tuple(shuffled)).digest != vocabulary.digest


def test_names_that_run_together_are_told_apart():
    assert Vocabulary(("ab", "c")).digest != Vocabulary(("a", "bc")).digest


@pytest.mark.parametrize(
    ("labels", "rule"),
    [
        ((), "at least two"),
        (("bow",), "at least two"),
        (("bow", "lunge", "bow"), "'bow' occurs twice"),
        (("bow", "Lunge"), "'Lunge': use 1 to 64"),
        (("bow", ""), "'': use 1 to 64"),
        (("bow", "x" * 65), "1 to 64"),
        (("bow", "lunge\n"), "lower case letters"),
        (("bow", "größe"), "lower case letters"),
        (("bow", "abstain"), "'abstain': reserved"),
    ],
)
def test_bad_names_are_refused_in_one_line(labels, rule):
    with pytest.raises(BadInput, match=rule) as caught:
        Vocabulary(labels)
    assert "\n" not in str(caught.value)


def test_an_unknown_label_is_told_the_known_ones():
    with pytest.raises(BadInput, match="'punch': not in the vocabulary; known: bow, lunge"):
        Vocabulary(("bow", "lunge")).index("punch")
