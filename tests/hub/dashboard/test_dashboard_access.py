"""Who may read the page: where it listens, the token, and whose page it answers to."""

import pytest

from common.address import Address
from common.errors import BadInput
from hub.dashboard.application import AccessControl, checked_token, is_loopback

WORD = "a-word-of-sixteen-and-more"


@pytest.mark.parametrize(
    ("text", "own"),
    [("127.0.0.1:8420", True), ("127.8.0.1:1", True), ("localhost:1", True), ("[::1]:80", True), ("[::]:80", False),
     ("0.0.0.0:8420", False), ("dojo.local:8420", False), ("192.168.1.5:80", False), ("localhost.evil:1", False)],
)  # fmt: skip
def test_where_only_this_machine_can_look(text, own):
    assert is_loopback(Address.parse(text, "listen")) == own


@pytest.mark.parametrize("text", ["", "short", "two words that are long enough", "ümlaut" * 5, "x" * 15])
def test_a_token_that_is_none_is_refused_and_not_told(text):
    with pytest.raises(BadInput, match="at least 16") as refused:
        checked_token(text, "hub.dashboard.token_file = t")
    assert not text or text not in str(refused.value)


def test_the_key_is_not_the_token_and_each_token_has_its_own():
    gate = AccessControl(checked_token(f" {WORD}\n", "file"))
    assert (
        WORD not in gate.cookie and gate.cookie != AccessControl(f"{WORD}2").cookie == AccessControl(f"{WORD}2").cookie
    )
    assert gate.admits(gate.cookie, "") and gate.admits("", f"Bearer {WORD}")
    for cookie, authorization in (("", ""), (WORD, ""), ("", WORD), ("", f"Bearer {WORD}x"), ("ü", "Bearer ü")):
        assert not gate.admits(cookie, authorization)


def test_without_a_token_only_this_machines_names_are_answered():
    gate = AccessControl(None)
    assert gate.admits("", "") and all(map(gate.answers_to, ("localhost", "127.0.0.1:8420", "[::1]:8420")))
    assert not any(map(gate.answers_to, ("evil.example:8420", "", "127.0.0.1.evil.example", "[::2]:1")))
    assert AccessControl(WORD).answers_to("dojo.local:8420")
