"""Codes work once and name one observer; secrets bring a phone back until it is revoked."""

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from common.errors import BadInput
from hub.phone.register import CODE_LIFETIME, PhoneRegister, RefusedError, read_register

NOW = datetime(2026, 11, 26, 12, 0, tzinfo=UTC)
LATER = NOW + timedelta(minutes=1)


@pytest.fixture
def with_code():
    return PhoneRegister().with_code("phone1", "code", NOW)


def test_a_code_names_its_observer_and_works_once(with_code):
    register, phone = with_code.join("code", "secret", "Android", LATER)
    assert phone.observer == "phone1" and register.resume("secret") == phone
    with pytest.raises(RefusedError, match="used already"):
        register.join("code", "another", "iPhone", LATER)


@pytest.mark.parametrize(("code", "at", "reason"), [
    ("forged", LATER, "not known"), ("", LATER, "not known"), ("code", NOW + CODE_LIFETIME, "expired"),
])  # fmt: skip
def test_a_code_that_is_no_code_or_too_old_is_refused(with_code, code, at, reason):
    with pytest.raises(RefusedError, match=reason):
        with_code.join(code, "secret", "", at)


def test_a_code_replaces_the_open_one_of_the_same_observer_alone(with_code):
    register = with_code.with_code("phone2", "other", NOW).with_code("phone1", "new", NOW)
    with pytest.raises(RefusedError, match="not known"):
        register.join("code", "secret", "", LATER)
    assert register.join("new", "secret", "", LATER)[1].observer == "phone1"
    assert register.join("other", "secret", "", LATER)[1].observer == "phone2"


def test_a_code_that_was_scanned_before_the_next_one_was_shown_stays_good_until_it_expires(with_code):
    register = with_code.with_code("phone1", "new", LATER, beside="code")
    joined, _ = register.join("code", "secret", "", LATER)
    with pytest.raises(RefusedError, match="not known"):
        joined.join("new", "another", "", LATER)
    with pytest.raises(RefusedError, match="expired"):
        register.join("code", "secret", "", NOW + CODE_LIFETIME)
    third = register.with_code("phone1", "third", LATER, beside="new")
    with pytest.raises(RefusedError, match="not known"):
        third.join("code", "secret", "", LATER)
    for code in ("code", "new"):
        with pytest.raises(RefusedError):
            register.revoke("phone1", LATER).join(code, "secret", "", LATER)


def test_a_used_code_does_not_become_open_again(with_code):
    register, _ = with_code.join("code", "secret", "", LATER)
    with pytest.raises(RefusedError, match="used already"):
        register.with_code("phone1", "new", LATER, beside="code").join("code", "another", "", LATER)


def test_a_second_phone_takes_the_place_of_the_first(with_code):
    register, _ = with_code.join("code", "secret", "", LATER)
    register, second = register.with_code("phone1", "new", LATER).join("new", "second", "", LATER)
    assert register.phone_of("phone1") == second
    with pytest.raises(RefusedError, match="another one took its place"):
        register.resume("secret")


def test_a_revoked_phone_is_refused_and_its_code_too(with_code):
    register, _ = with_code.join("code", "secret", "", LATER)
    register = register.revoke("phone1", LATER)
    with pytest.raises(RefusedError, match="revoked"):
        register.resume("secret")
    with pytest.raises(RefusedError):
        with_code.revoke("phone1", LATER).join("code", "secret", "", LATER)
    with pytest.raises(BadInput, match="--revoke phone1: no phone and no open code; observers with a phone: none"):
        register.revoke("phone1", LATER)


def test_the_file_holds_neither_code_nor_secret(with_code):
    register, phone = with_code.join("code", "sesame", "", LATER)
    text = register.model_dump_json()
    assert "sesame" not in text and '"code"' not in text
    assert read_register(text, "file") == register and register.phone_of("phone1") == phone


@pytest.mark.parametrize("text", ["", "{", "[]", '{"phones": 3}', '{"phones": [{"observer": "X"}]}', '{"stranger": 1}'])
def test_a_damaged_file_is_one_line(text):
    with pytest.raises(BadInput, match=r"^dojo\.phones\.json: .*remove the file") as fault:
        read_register(text, "dojo.phones.json")
    assert "\n" not in str(fault.value)


class Phones(RuleBasedStateMachine):
    """Codes, joins and revocations in any order, beside a model that is a dictionary."""

    def __init__(self):
        super().__init__()
        self.register, self.open, self.used, self.holder, self.number = PhoneRegister(), {}, set(), {}, 0

    @rule(observer=st.sampled_from(["a", "b", "c"]))
    def show(self, observer):
        self.number += 1
        self.register = self.register.with_code(observer, f"code{self.number}", NOW)
        self.open[observer] = f"code{self.number}"

    @precondition(lambda self: self.open)
    @rule(data=st.data())
    def join(self, data):
        observer = data.draw(st.sampled_from(sorted(self.open)))
        code = self.open.pop(observer)
        self.register, _ = self.register.join(code, f"secret of {code}", "", LATER)
        self.used.add(code)
        self.holder[observer] = f"secret of {code}"

    @precondition(lambda self: self.holder)
    @rule(data=st.data())
    def revoke(self, data):
        observer = data.draw(st.sampled_from(sorted(self.holder)))
        self.register = self.register.revoke(observer, LATER)
        del self.holder[observer]
        self.open.pop(observer, None)

    @invariant()
    def exactly_the_holders_come_back(self):
        for code in self.used:
            with pytest.raises(RefusedError):
                self.register.join(code, "again", "", LATER)
            try:
                phone = self.register.resume(f"secret of {code}")
            except RefusedError:
                assert f"secret of {code}" not in self.holder.values()
            else:
                assert self.holder[phone.observer] == f"secret of {code}"


TestPhones = Phones.TestCase
