"""The register and the certificates: what is issued, what counts, what is never overwritten."""

import json
import os
import shutil
import stat
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from hypothesis import given
from hypothesis import strategies as st

from common.certificate_authority import issue, make_authority
from common.credentials import Certificate, check_credentials, read_certificate
from common.errors import BadInput, LabanmeshError
from deploy.security.issuing import create_authority, open_authority, read_scenes
from deploy.security.register import IssuedCertificate, Register, Roles, as_rows, as_table
from deploy.security.requested_roles import roles_of

NOW = datetime(2027, 1, 31, 12, tzinfo=UTC)
IDS = st.sampled_from(["sofa", "shelf", "a-1_"])
CERTIFICATES = st.builds(
    IssuedCertificate,
    name=IDS,
    generation=st.integers(1, 9),
    roles=st.builds(
        Roles,
        observers=st.lists(IDS, max_size=2).map(tuple),
        fusions=st.lists(IDS, max_size=2).map(tuple),
        hub=st.booleans(),
        router=st.booleans(),
        pictures=st.booleans(),
        teach=st.booleans(),
    ),
    hosts=st.lists(IDS, max_size=2).map(tuple),
    serial=IDS,
    expires=st.datetimes(datetime(2027, 1, 1), datetime(2037, 1, 1), timezones=st.just(UTC)),
    revoked=st.none() | st.just(NOW),
)
SOFA = Roles(observers=("sofa",))


@pytest.fixture(scope="module")
def pair():
    return make_authority("dojo", NOW)


def write_scene(folder, name="dojo", observers=("sofa", "shelf", "both"), mesh="credentials = 'c'", more=""):
    text = f'scene = "{name}"\n[mesh]\nmode = "router"\nendpoint = "tls/judge.example:7447"\n'
    text += mesh + "\n" + "".join(f'[observers.{observer}]\nsource = "m.npz"\n' for observer in observers)
    (folder / f"{name}.toml").write_text(text + more)
    return folder / f"{name}.toml"


@pytest.fixture
def scenes(tmp_path):
    return read_scenes([write_scene(tmp_path, more='[fusion]\nid = "judge"\nstandby = ["second", "both"]\n')])


@pytest.fixture
def authority(scenes, tmp_path):
    return create_authority(tmp_path / "secure", scenes, NOW)


@pytest.fixture
def both(tmp_path):
    """Two scenes: cam1 is in both of them, sofa in one."""
    write_scene(tmp_path, "dojo", ("cam1", "sofa"))
    write_scene(tmp_path, "garden", ("cam1", "tree"))
    return read_scenes([tmp_path])


def loaded(pem):
    return x509.load_pem_x509_certificate(pem)


def test_an_authority_can_sign_machines_and_nothing_else(pair):
    ours = loaded(pair.certificate)
    basic = ours.extensions.get_extension_for_class(x509.BasicConstraints)
    assert basic.critical and basic.value.ca and basic.value.path_length == 0
    ours.verify_directly_issued_by(ours)


def test_a_certificate_is_signed_and_named_and_is_no_authority(pair):
    issued = issue(pair, "cam1.1", ("sofa.local", "10.0.0.7", "::1"), NOW, roles=("observer:cam1", "hub"))
    own = loaded(issued.pair.certificate)
    own.verify_directly_issued_by(loaded(pair.certificate))
    assert not own.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    names = own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["sofa.local"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["10.0.0.7", "::1"]
    assert own.serial_number == issued.serial and own.not_valid_after_utc == issued.expires == NOW + timedelta(days=365)
    assert own.not_valid_before_utc < NOW
    late = issue(pair, "a.1", (), NOW + timedelta(days=3600))
    assert late.expires == loaded(pair.certificate).not_valid_after_utc


@pytest.mark.parametrize(("roles", "serves"), [(("hub",), False), (("router",), True), (("hub", "router"), True)])
def test_only_a_router_may_be_a_server(pair, roles, serves):
    own = loaded(issue(pair, "a.1", (), NOW, roles=roles).pair.certificate)
    purposes = own.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert (ExtendedKeyUsageOID.SERVER_AUTH in purposes) == serves
    assert ExtendedKeyUsageOID.CLIENT_AUTH in purposes


@given(st.lists(CERTIFICATES, max_size=4), st.sampled_from([("dojo",), ("dojo", "garden")]))
def test_the_register_is_read_as_it_was_written(certificates, scenes):
    register = Register(scenes, tuple(certificates))
    assert Register.from_json(register.to_json(), "r.json") == register


@given(st.lists(CERTIFICATES, min_size=1, max_size=4), st.data())
def test_a_revoked_certificate_is_not_in_force_and_all_else_stays(certificates, data):
    register = Register(("dojo",), tuple(certificates))
    name = data.draw(st.sampled_from([n for each in certificates for n in (each.name, each.common_name)]))
    expected = {each.common_name for each in register.in_force() if name in (each.name, each.common_name)}
    if not expected:
        with pytest.raises(BadInput, match="no certificate in force"):
            register.revoke(name, NOW)
        return
    after, revoked = register.revoke(name, NOW)
    assert set(revoked) == expected and len(after.certificates) == len(certificates)
    assert [each for each in register.in_force() if each.common_name not in expected] == list(after.in_force())


@pytest.mark.parametrize(
    "text", ["", "[]", '{"version": 1}', '{"version": 3, "scene": "x"}', '{"scene": "x", "a": 1}', '{"version": 2}']
)
def test_a_file_that_is_no_register_is_one_line(text):
    with pytest.raises(BadInput, match=r"^r\.json: ") as caught:
        Register.from_json(text, "r.json")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "requested", "roles"),
    [
        ("sofa", Roles(), SOFA),
        ("judge", Roles(), Roles(fusions=("judge",))),
        ("second", Roles(), Roles(fusions=("second",))),
        ("router", Roles(), Roles(router=True)),
        ("hub", Roles(), Roles(hub=True)),
        ("hub", Roles(pictures=True), Roles(hub=True, pictures=True)),
        ("sofa", Roles(hub=True, pictures=True), Roles(hub=True, pictures=True)),
        ("hub", Roles(pictures=True, teach=True), Roles(hub=True, pictures=True, teach=True)),
        ("attic", Roles(observers=("sofa", "shelf"), hub=True), Roles(observers=("sofa", "shelf"), hub=True)),
        ("sofa", Roles(fusions=("second",)), Roles(fusions=("second",))),
        ("sofa", Roles(fusions=("dojo/second",), hub_of=("dojo",)), Roles(fusions=("second",), hub=True)),
    ],
)
def test_the_roles_of_a_machine(scenes, name, requested, roles):
    assert roles_of(scenes, name, requested) == roles


@pytest.mark.parametrize(
    ("several", "name", "requested", "line"),
    [
        (False, "attic", Roles(), "no process has this name (sofa, shelf, both, judge, second, hub, router)"),
        (False, "both", Roles(), "an observer and a fusion service have this name"),
        (False, "attic", Roles(observers=("door",)), "observer 'door': not in the scene; known: sofa"),
        (False, "attic", Roles(fusions=("third",)), "fusion service 'third': not in the scene 'dojo'; known: judge"),
        (False, "attic", Roles(hub_of=("kitchen",)), "scene 'kitchen': none of the scenes; known: dojo"),
        (False, "Attic", Roles(hub=True), "a-z"),
        (False, "a" * 60, Roles(hub=True), "at most 56"),
        (False, "sofa.1", Roles(hub=True), "a-z"),
        (False, "sofa", Roles(pictures=True), "--pictures: sofa is for observer sofa, and only a hub gets pictures"),
        (False, "judge", Roles(teach=True), "--teach: judge is for fusion judge, and only a hub teaches"),
        (True, "attic", Roles(observers=("cam1",)), "in scenes dojo and garden; say --observer dojo/cam1"),
        (True, "attic", Roles(observers=("door",)), "known: dojo/cam1, dojo/sofa, garden/cam1, garden/tree"),
        (True, "attic", Roles(observers=("garden/sofa",)), "observer 'sofa': not in the scene; known: cam1, tree"),
        (True, "attic", Roles(fusions=("kitchen/north",)), "scene 'kitchen': none of the scenes"),
        (True, "attic", Roles(fusions=("North",)), "--fusion = 'North'"),
    ],
)
def test_a_name_or_role_that_means_nothing_is_one_line(request, several, name, requested, line):
    with pytest.raises(BadInput) as caught:
        roles_of(request.getfixturevalue("both" if several else "scenes"), name, requested)
    assert line in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "requested", "words"),
    [
        ("sofa", Roles(), ("observer:dojo/sofa",)),
        ("pi", Roles(observers=("garden/cam1", "sofa")), ("observer:garden/cam1", "observer:dojo/sofa")),
        ("north", Roles(fusions=("north",)), ("fusion:north",)),
        ("north", Roles(fusions=("garden/north",)), ("fusion:garden/north",)),
        ("fusion", Roles(), ("fusion:fusion",)),
        ("hub", Roles(), ("hub",)),
        ("tablet", Roles(hub_of=("garden",)), ("hub:garden",)),
        ("tablet", Roles(hub_of=("garden",), pictures=True), ("hub:garden", "pictures")),
        ("tablet", Roles(hub_of=("garden",), teach=True), ("hub:garden", "teach")),
    ],
)
def test_roles_in_several_scenes(both, name, requested, words):
    """Fusion services that share scenes stand in no scene file: any id is one."""
    assert roles_of(both, name, requested).words == words


@pytest.fixture
def umask():
    """A process whose new files everybody may write."""
    old = os.umask(0)
    yield
    os.umask(old)


def test_keys_are_for_their_owner_alone(umask, authority, tmp_path):
    assert authority.add("sofa", SOFA, (), NOW).common_name == "sofa.1"
    place = tmp_path / "secure" / "sofa.1"
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in place.iterdir()}
    assert modes == {"ca.pem": 0o644, "certificate.pem": 0o644, "key.pem": 0o600}
    assert stat.S_IMODE(place.stat().st_mode) == stat.S_IMODE(place.parent.stat().st_mode) == 0o700
    files = {path.name: stat.S_IMODE(path.stat().st_mode) for path in place.parent.iterdir() if path.is_file()}
    assert files == {"ca-key.pem": 0o600, "lock": 0o600, "ca.pem": 0o644, "register.json": 0o644}
    assert read_certificate(place / "certificate.pem") == Certificate(
        "sofa.1", NOW - timedelta(hours=1), NOW + timedelta(days=365), ("observer:sofa",)
    )
    assert check_credentials(place, NOW) is None


def test_a_machine_is_renewed_under_the_next_number_and_keeps_its_roles(authority, tmp_path):
    roles = Roles(observers=("sofa",), hub=True)
    authority.add("sofa", roles, ("sofa.local",), NOW)
    key = (tmp_path / "secure" / "sofa.1" / "key.pem").read_bytes()
    authority.renew("sofa", (), NOW + timedelta(days=300))
    assert (tmp_path / "secure" / "sofa.1" / "key.pem").read_bytes() == key
    assert [(each.common_name, each.roles, each.hosts) for each in authority.register.in_force()] == [
        ("sofa.1", roles, ("sofa.local",)),
        ("sofa.2", roles, ("sofa.local",)),
    ]
    with pytest.raises(BadInput, match=r"has certificate sofa\.2; labanmesh secure renew SCENE sofa"):
        authority.add("sofa", roles, (), NOW)


def test_after_its_revocation_a_machine_gets_a_new_number(authority):
    authority.add("sofa", SOFA, (), NOW)
    assert authority.revoke("sofa", NOW) == ("sofa.1",)
    with pytest.raises(BadInput, match=r"sofa\.1 was revoked; labanmesh secure add"):
        authority.renew("sofa", (), NOW)
    assert authority.add("sofa", Roles(hub=True), (), NOW).common_name == "sofa.2"


def test_a_revocation_beside_a_renewal_is_not_lost(authority, scenes, tmp_path):
    """Each of them read the register before the other one wrote it."""
    authority.add("sofa", SOFA, (), NOW)
    authority.add("shelf", Roles(observers=("shelf",)), (), NOW)
    renewing, revoking = (open_authority(tmp_path / "secure", scenes) for _ in range(2))
    revoking.revoke("shelf", NOW)
    renewing.renew("sofa", (), NOW)
    assert [each.common_name for each in authority.register.in_force()] == ["sofa.1", "sofa.2"]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda n: authority.add(f"m{n}", Roles(hub=True), (), NOW), range(24)))
    assert len(authority.register.in_force()) == 26


def test_nothing_is_overwritten(authority, scenes, tmp_path):
    before = (tmp_path / "secure" / "ca-key.pem").read_bytes()
    with pytest.raises(BadInput, match="keys are never overwritten"):
        create_authority(tmp_path / "secure", scenes, NOW)
    (tmp_path / "secure" / "sofa.1").mkdir()
    with pytest.raises(BadInput, match="is there, but not in the register"):
        authority.add("sofa", SOFA, (), NOW)
    assert (tmp_path / "secure" / "ca-key.pem").read_bytes() == before and authority.register.certificates == ()


def test_an_authority_is_for_its_own_scenes(authority, tmp_path):
    garden = read_scenes([write_scene(tmp_path, "garden")])
    with pytest.raises(BadInput, match="the authority of scene 'dojo', not of scene 'garden'"):
        open_authority(tmp_path / "secure", garden)
    with pytest.raises(BadInput, match="labanmesh secure init SCENE makes an authority"):
        open_authority(tmp_path / "elsewhere", garden)


def test_a_scene_that_comes_later_joins_the_authority_and_nobody_gains_rights(authority, scenes, tmp_path):
    roles = Roles(observers=("sofa",), fusions=("judge",), hub=True)
    authority.add("attic", roles, (), NOW)
    more = [*scenes, *read_scenes([write_scene(tmp_path, "garden")])]
    extended = create_authority(tmp_path / "secure", more, NOW)
    assert extended.pair == authority.pair and extended.register.scenes == ("dojo", "garden")
    (attic,) = extended.register.in_force()
    assert attic.roles == Roles(observers=("dojo/sofa",), fusions=("dojo/judge",), hub_of=("dojo",))
    with pytest.raises(BadInput, match="also the authority of scene 'garden'; name the files of all"):
        authority.revoke("attic", NOW)


@pytest.mark.parametrize(
    ("mesh", "line"),
    [
        ("prefix = 'other'\ncredentials = 'c'", "another [mesh] than scene 'dojo'"),
        ("prefix = 'laban'", "all with credentials or none"),
    ],
)
def test_scenes_of_one_router_meet_at_one_place(scenes, tmp_path, mesh, line):
    garden = write_scene(tmp_path, "garden", mesh=mesh)
    for files in ([tmp_path], [garden, tmp_path / "dojo.toml"]):
        with pytest.raises(BadInput) as caught:
            read_scenes(files)
        assert line.replace("dojo", "garden" if len(files) > 1 else "dojo") in str(caught.value)
    shutil.copy(tmp_path / "dojo.toml", garden)
    with pytest.raises(BadInput, match="scene 'dojo' is in two of the files"):
        read_scenes([tmp_path])


def test_only_the_machine_with_the_key_can_issue(authority, scenes, tmp_path):
    (tmp_path / "secure" / "ca-key.pem").unlink()
    with pytest.raises(BadInput, match=r"ca-key\.pem: no such file or directory; only the machine with"):
        open_authority(tmp_path / "secure", scenes)


def test_a_folder_that_cannot_be_written_is_one_line_with_a_way_out(scenes, tmp_path):
    (tmp_path / "taken").touch()
    with pytest.raises(LabanmeshError, match=r"^cannot write .*taken.*: not a directory\. Name another folder with"):
        create_authority(tmp_path / "taken" / "secure", scenes, NOW)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_of_somebody_else_is_one_line_with_a_way_out(authority, tmp_path):
    (tmp_path / "secure").chmod(0o500)
    with pytest.raises(LabanmeshError, match=r"permission denied\. Name another folder with --to"):
        authority.add("sofa", SOFA, (), NOW)


def test_the_list_shows_state_and_days_left(authority):
    authority.add("sofa", SOFA, (), NOW, days=10)
    authority.add("shelf", Roles(observers=("shelf",), hub=True), (), NOW, days=20)
    authority.revoke("shelf", NOW)
    later, certificates = NOW + timedelta(days=12), authority.register.certificates
    lines = as_table(certificates, later).splitlines()
    assert lines[1].split() == ["sofa.1", "observer", "sofa", "expired", "-2", "2027-02-10"]
    assert lines[2].split() == ["shelf.1", "observer", "shelf,", "hub", "revoked", "8", "2027-02-20"]
    rows = json.loads(json.dumps(as_rows(certificates, NOW)))
    assert [(row["common_name"], row["state"], row["days_left"]) for row in rows] == [
        ("sofa.1", "in force", 10.0),
        ("shelf.1", "revoked", 20.0),
    ]


def swap(place: Path, name: str) -> None:
    """Another authority's file in the place of ours."""
    other = make_authority("dojo", NOW)
    issued = issue(other, "sofa.1", (), NOW).pair
    (place / name).write_bytes(issued.key if name == "key.pem" else other.certificate)


@pytest.mark.parametrize(
    ("spoil", "days", "line"),
    [
        (lambda place: (place / "key.pem").unlink(), 0, "key.pem: missing"),
        (lambda place: (place / "key.pem").chmod(0o640), 0, "others can read it (mode 0640); chmod 600"),
        (lambda place: (place / "ca.pem").write_text("x"), 0, "ca.pem: no certificate in PEM form"),
        (lambda place: (place / "key.pem").write_text("x"), 0, "key.pem: no private key"),
        (lambda place: swap(place, "key.pem"), 0, "not the key of"),
        (lambda place: swap(place, "ca.pem"), 0, "not signed by the authority in"),
        (lambda _: None, -1, "is valid only from"),
        (lambda _: None, 400, "expired on 2028-01-31"),
    ],
)
def test_credentials_that_do_not_fit_are_one_line(authority, tmp_path, spoil, days, line):
    authority.add("sofa", SOFA, (), NOW)
    spoil(tmp_path / "secure" / "sofa.1")
    fault = check_credentials(tmp_path / "secure" / "sofa.1", NOW + timedelta(days=days))
    assert line in str(fault) and "\n" not in str(fault) and fault.remedy
