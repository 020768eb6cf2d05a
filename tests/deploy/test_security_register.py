"""The register and the certificates: what is issued, what counts, what is never overwritten."""

import json
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from hypothesis import given
from hypothesis import strategies as st

from common.config import read_scene
from common.credentials import Certificate, check_credentials, read_certificate
from common.errors import BadInput
from deploy.security.authority import issue, make_authority
from deploy.security.issuing import found, opened
from deploy.security.listing import as_rows, as_table
from deploy.security.register import Machine, Register, Roles
from deploy.security.roles import roles_of

NOW = datetime(2027, 1, 31, 12, tzinfo=UTC)
IDS = st.sampled_from(["sofa", "shelf", "a-1_"])
ROLES = st.builds(
    Roles,
    observers=st.lists(IDS, max_size=2).map(tuple),
    fusions=st.lists(IDS, max_size=2).map(tuple),
    hub=st.booleans(),
    router=st.booleans(),
)
MACHINES = st.builds(
    Machine,
    name=IDS,
    generation=st.integers(1, 9),
    roles=ROLES,
    hosts=st.lists(IDS, max_size=2).map(tuple),
    serial=IDS,
    expires=st.datetimes(datetime(2027, 1, 1), datetime(2037, 1, 1), timezones=st.just(UTC)),
    revoked=st.none() | st.just(NOW),
)


@pytest.fixture(scope="module")
def pair():
    return make_authority("dojo", NOW)


@pytest.fixture
def scene(tmp_path):
    text = 'scene = "dojo"\n[mesh]\nmode = "router"\nendpoint = "tls/judge.example:7447"\ncredentials = "credentials"\n'
    text += "".join(f'[observers.{name}]\nsource = "m.npz"\n' for name in ("sofa", "shelf", "both"))
    (tmp_path / "scene.toml").write_text(text + '[fusion]\nid = "judge"\nstandby = ["second", "both"]\n')
    return read_scene(tmp_path / "scene.toml", {})


@pytest.fixture
def authority(scene, tmp_path):
    found(tmp_path / "secure", scene, NOW)
    return lambda: opened(tmp_path / "secure", scene)


def loaded(pem):
    return x509.load_pem_x509_certificate(pem)


def test_an_authority_can_sign_machines_and_nothing_else(pair):
    ours = loaded(pair.certificate)
    basic = ours.extensions.get_extension_for_class(x509.BasicConstraints)
    assert basic.critical and basic.value.ca and basic.value.path_length == 0
    ours.verify_directly_issued_by(ours)


def test_a_certificate_is_signed_named_and_no_authority_itself(pair):
    issued = issue(pair, "cam1.1", ("sofa.local", "10.0.0.7", "::1"), NOW, roles=("observer:cam1", "hub"))
    own = loaded(issued.pair.certificate)
    own.verify_directly_issued_by(loaded(pair.certificate))
    assert not own.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    names = own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["sofa.local"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["10.0.0.7", "::1"]
    assert own.serial_number == issued.serial and own.not_valid_after_utc == issued.expires == NOW + timedelta(days=365)
    assert own.not_valid_before_utc < NOW


@pytest.mark.parametrize(("roles", "serves"), [(("hub",), False), (("router",), True), (("hub", "router"), True)])
def test_only_a_router_may_be_a_server(pair, roles, serves):
    own = loaded(issue(pair, "a.1", (), NOW, roles=roles).pair.certificate)
    purposes = own.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert (ExtendedKeyUsageOID.SERVER_AUTH in purposes) == serves
    assert ExtendedKeyUsageOID.CLIENT_AUTH in purposes


def test_no_certificate_outlives_its_authority(pair):
    late = issue(pair, "a.1", (), NOW + timedelta(days=3600))
    assert late.expires == loaded(pair.certificate).not_valid_after_utc


@given(st.lists(MACHINES, max_size=4))
def test_the_register_is_read_as_it_was_written(machines):
    register = Register("dojo", tuple(machines))
    assert Register.from_json(register.to_json(), "r.json") == register


@given(st.lists(MACHINES, min_size=1, max_size=4), st.data())
def test_what_is_revoked_is_not_in_force_and_all_else_stays(machines, data):
    register = Register("dojo", tuple(machines))
    name = data.draw(st.sampled_from([n for m in machines for n in (m.name, m.common_name)]))
    meant = {m.common_name for m in register.in_force() if name in (m.name, m.common_name)}
    if not meant:
        with pytest.raises(BadInput, match="no certificate in force"):
            register.revoke(name, NOW)
        return
    after, gone = register.revoke(name, NOW)
    assert set(gone) == meant and len(after.machines) == len(machines)
    assert [m for m in register.in_force() if m.common_name not in meant] == list(after.in_force())


@pytest.mark.parametrize("text", ["", "[]", '{"version": 1}', '{"version": 2, "scene": "x"}', '{"scene": "x", "a": 1}'])
def test_a_file_that_is_no_register_is_one_line(text):
    with pytest.raises(BadInput, match=r"^r\.json: ") as caught:
        Register.from_json(text, "r.json")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "asked", "roles"),
    [
        ("sofa", Roles(), Roles(observers=("sofa",))),
        ("judge", Roles(), Roles(fusions=("judge",))),
        ("second", Roles(), Roles(fusions=("second",))),
        ("router", Roles(), Roles(router=True)),
        ("hub", Roles(), Roles(hub=True)),
        ("attic", Roles(observers=("sofa", "shelf"), hub=True), Roles(observers=("sofa", "shelf"), hub=True)),
        ("sofa", Roles(fusions=("second",)), Roles(fusions=("second",))),
    ],
)
def test_what_a_machine_is_for(scene, name, asked, roles):
    assert roles_of(scene, name, asked) == roles


@pytest.mark.parametrize(
    ("name", "asked", "line"),
    [
        ("attic", Roles(), "no process of the scene has this name"),
        ("both", Roles(), "an observer and a fusion service have this name"),
        ("attic", Roles(observers=("door",)), "observer 'door': not in the scene; known: sofa"),
        ("attic", Roles(fusions=("third",)), "fusion service 'third': not in the scene; known: judge"),
        ("Attic", Roles(hub=True), "a-z"),
        ("a" * 60, Roles(hub=True), "56 are the most"),
        ("sofa.1", Roles(hub=True), "a-z"),
    ],
)
def test_a_machine_that_is_for_nothing_is_one_line(scene, name, asked, line):
    with pytest.raises(BadInput) as caught:
        roles_of(scene, name, asked)
    assert line in str(caught.value) and "\n" not in str(caught.value)


def test_keys_are_for_their_owner_alone(scene, authority, tmp_path):
    place = authority().add(scene, "sofa", Roles(observers=("sofa",)), (), NOW)
    assert place == tmp_path / "secure" / "sofa.1"
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in place.iterdir()}
    assert modes == {"ca.pem": 0o644, "certificate.pem": 0o644, "key.pem": 0o600}
    assert stat.S_IMODE(place.stat().st_mode) == stat.S_IMODE(place.parent.stat().st_mode) == 0o700
    assert stat.S_IMODE((place.parent / "ca-key.pem").stat().st_mode) == 0o600
    assert read_certificate(place / "certificate.pem") == Certificate(
        "sofa.1", NOW - timedelta(hours=1), NOW + timedelta(days=365), ("observer:sofa",)
    )
    assert check_credentials(place, NOW) is None


def test_a_machine_is_renewed_under_the_next_number_and_keeps_its_roles(scene, authority):
    roles = Roles(observers=("sofa",), hub=True)
    first = authority().add(scene, "sofa", roles, ("sofa.local",), NOW)
    key = (first / "key.pem").read_bytes()
    second = authority().renew(scene, "sofa", (), NOW + timedelta(days=300))
    assert (first.name, second.name) == ("sofa.1", "sofa.2") and (first / "key.pem").read_bytes() == key
    assert [(m.common_name, m.roles, m.hosts) for m in authority().register.in_force()] == [
        ("sofa.1", roles, ("sofa.local",)),
        ("sofa.2", roles, ("sofa.local",)),
    ]
    with pytest.raises(BadInput, match=r"has certificate sofa\.2; labanmesh secure renew SCENE sofa"):
        authority().add(scene, "sofa", roles, (), NOW)


def test_after_its_revocation_a_machine_gets_a_new_number(scene, authority):
    authority().add(scene, "sofa", Roles(observers=("sofa",)), (), NOW)
    assert authority().revoke(scene, "sofa", NOW) == ("sofa.1",)
    with pytest.raises(BadInput, match=r"sofa\.1 was revoked; labanmesh secure add"):
        authority().renew(scene, "sofa", (), NOW)
    assert authority().add(scene, "sofa", Roles(hub=True), (), NOW).name == "sofa.2"


def test_nothing_is_overwritten(scene, authority, tmp_path):
    authority()
    before = (tmp_path / "secure" / "ca-key.pem").read_bytes()
    with pytest.raises(BadInput, match="keys are never overwritten"):
        found(tmp_path / "secure", scene, NOW)
    (tmp_path / "secure" / "sofa.1").mkdir()
    with pytest.raises(BadInput, match="is there, but not in the register"):
        authority().add(scene, "sofa", Roles(observers=("sofa",)), (), NOW)
    assert (tmp_path / "secure" / "ca-key.pem").read_bytes() == before and authority().register.machines == ()


def test_each_scene_has_its_own_authority(scene, authority, tmp_path):
    authority()
    other = scene.model_copy(update={"scene": "garden"})
    with pytest.raises(BadInput, match="the authority of scene 'dojo', not of 'garden'"):
        opened(tmp_path / "secure", other)
    with pytest.raises(BadInput, match="labanmesh secure init SCENE makes an authority"):
        opened(tmp_path / "elsewhere", scene)


def test_only_the_machine_with_the_key_can_issue(scene, authority, tmp_path):
    authority()
    (tmp_path / "secure" / "ca-key.pem").unlink()
    with pytest.raises(BadInput, match=r"ca-key\.pem: no such file or directory; only the machine with"):
        authority()


def test_the_list_says_what_counts_and_for_how_long(scene, authority):
    authority().add(scene, "sofa", Roles(observers=("sofa",)), (), NOW, days=10)
    authority().add(scene, "shelf", Roles(observers=("shelf",), hub=True), (), NOW, days=20)
    authority().revoke(scene, "shelf", NOW)
    later = NOW + timedelta(days=12)
    machines = authority().register.machines
    lines = as_table(machines, later).splitlines()
    assert lines[1].split() == ["sofa.1", "observer", "sofa", "expired", "-2", "2027-02-10"]
    assert lines[2].split() == ["shelf.1", "observer", "shelf,", "hub", "revoked", "8", "2027-02-20"]
    rows = json.loads(json.dumps(as_rows(machines, NOW)))
    assert [(row["common_name"], row["state"], row["days_left"]) for row in rows] == [
        ("sofa.1", "in force", 10.0),
        ("shelf.1", "revoked", 20.0),
    ]


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda place: (place / "key.pem").unlink(), "key.pem: missing"),
        (lambda place: (place / "key.pem").chmod(0o640), "others can read it (mode 0640); chmod 600"),
        (lambda place: (place / "ca.pem").write_text("x"), "ca.pem: no certificate in PEM form"),
        (lambda place: (place / "key.pem").write_text("x"), "key.pem: no private key"),
        (lambda place: swap(place, "key.pem"), "not the key of"),
        (lambda place: swap(place, "ca.pem"), "not signed by the authority in"),
    ],
)
def test_credentials_that_do_not_fit_are_one_line(scene, authority, tmp_path, spoil, line):
    place = authority().add(scene, "sofa", Roles(observers=("sofa",)), (), NOW)
    spoil(place)
    finding = check_credentials(place, NOW)
    assert line in str(finding) and "\n" not in str(finding) and finding.remedy


def swap(place: Path, name: str) -> None:
    """Another authority's file in the place of ours."""
    other = make_authority("dojo", NOW)
    issued = issue(other, "sofa.1", (), NOW).pair
    (place / name).write_bytes(issued.key if name == "key.pem" else other.certificate)


@pytest.mark.parametrize(("days", "line"), [(-1, "begins only on"), (400, "expired on 2028-01-31")])
def test_the_clock_counts(scene, authority, days, line):
    place = authority().add(scene, "sofa", Roles(observers=("sofa",)), (), NOW)
    assert line in str(check_credentials(place, NOW + timedelta(days=days)))
