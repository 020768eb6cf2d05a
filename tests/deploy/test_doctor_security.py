"""The doctor at a secured router with real certificates: it listens where it may, and reports why it may not."""

from datetime import UTC, datetime, timedelta

import pytest

from common.certificate_authority import issue
from common.config import read_scene
from common.link import Link
from deploy.doctor.findings import worst
from deploy.doctor.mesh import listen
from deploy.doctor.network import check_network, network_facts
from deploy.doctor.security import check_security, security_facts
from deploy.security.issuing import create_authority
from deploy.security.register import Roles
from deploy.security.router_config import router_config

ROLES = {
    "router": Roles(router=True),
    "cam1": Roles(observers=("cam1",)),
    "judge": Roles(fusions=("fusion",)),
    "desk": Roles(hub=True),
    "gone": Roles(hub=True),
}
TEXT = (
    'scene = "dojo"\n[observers.cam1]\nsource = "m.npz"\n'
    '[mesh]\nmode = "router"\nendpoint = "{endpoint}"\ncredentials = "secure/{who}.1"\n'
)


def now():
    return datetime.now(UTC)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("dojo")


@pytest.fixture(scope="module")
def authority(place):
    (place / "scene.toml").write_text(TEXT.format(endpoint="tls/127.0.0.1:0", who="router"))
    scene = read_scene(place / "scene.toml", {})
    authority = create_authority(place / "secure", [scene], now())
    for name, roles in ROLES.items():
        authority.add(name, roles, ["127.0.0.1"] if roles.router else (), now())
    authority.revoke("gone", now())
    return authority


@pytest.fixture(scope="module")
def router(place, authority):
    scene = read_scene(place / "scene.toml", {})
    with Link.router(router_config([scene], authority.register, [scene.mesh.endpoint]), "the test's router") as link:
        yield link.locator


@pytest.fixture
def seen_by(place, router, monkeypatch):
    """What the doctor finds on a machine with one of the folders of credentials."""
    monkeypatch.setattr("common.link.ADMISSION_TIMEOUT_S", 1.0)

    def see(who, endpoint=router):
        text = TEXT.format(endpoint=endpoint, who=who)
        if endpoint.startswith("tcp"):
            text = text[: text.index("credentials")]
        (place / "mine.toml").write_text(text)
        scene = read_scene(place / "mine.toml", {})
        facts = listen(scene, network_facts(scene.mesh), 0.5)
        return facts, check_network(facts.network), check_security(security_facts(facts.network), now())

    return see


@pytest.mark.parametrize(("who", "partly"), [("desk", False), ("judge", False), ("cam1", True)])
def test_a_certificate_that_may_listen_is_used(seen_by, who, partly):
    facts, network, security = seen_by(who)
    assert facts.traffic is not None and facts.partly is partly
    assert worst([*network, *security]) == "ok", [*network, *security]
    assert f"certificate {who}.1 for " in security[0].what


@pytest.mark.parametrize(("who", "scheme", "words"), [("gone", "tls/", "revoked"), ("desk", "tcp/", "TLS")])
def test_a_revoked_certificate_and_plain_text_are_reported(seen_by, router, who, scheme, words, monkeypatch):
    monkeypatch.setattr("deploy.doctor.mesh.OPEN_S", 0.5)  # the router admits it at no time
    facts, _, security = seen_by(who, router.replace("tls/", scheme))
    (fault,) = [finding for finding in security if finding.mark == "error"]
    assert facts.traffic is None and words in fault.what and fault.to_do


@pytest.mark.parametrize(("days", "mark", "words"), [(-1, "error", "expired"), (9, "warning", "more days")])
def test_expiry_is_reported(place, authority, seen_by, days, mark, words):
    pair = issue(authority.pair, "desk.1", (), now() - timedelta(days=2), roles=("hub",), days=days + 2).pair
    folder = place / "secure" / f"days{days}.1"
    folder.mkdir()
    for name, content in (
        ("ca.pem", authority.pair.certificate),
        ("certificate.pem", pair.certificate),
        ("key.pem", pair.key),
    ):
        (folder / name).write_bytes(content)
        (folder / name).chmod(0o600)
    _, _, security = seen_by(f"days{days}")
    (finding,) = [finding for finding in security if finding.mark != "ok"]
    assert finding.mark == mark and words in finding.what and "labanmesh secure renew SCENE desk" in finding.to_do


def test_a_key_that_others_can_read_is_reported(place, authority, seen_by):
    key = place / "secure" / "desk.1" / "key.pem"
    key.chmod(0o644)
    try:
        _, _, security = seen_by("desk")
    finally:
        key.chmod(0o600)
    (fault,) = [finding for finding in security if finding.mark == "error"]
    assert "others can read it" in fault.what and fault.to_do == f"chmod 600 {key}"
