"""`labanmesh secure` and `labanmesh router` as a person uses them: sub-verbs, folders, changes while a router runs."""

import json
import os
import shutil
import signal
import subprocess
import threading
from functools import partial

import pytest
from processes import SOON_S, labanmesh, until

from benchmarks.timing import free_port
from common.config import read_scene
from common.errors import LabanmeshError
from common.link import Link
from deploy.security.routing import plain_rules, route, rules_in_file, rules_of_scenes
from labanmesh import main
from labanmesh_testing.mesh import running

OBSERVERS = "".join(f'[observers.{name}]\nsource = "m.npz"\n' for name in ("sofa", "shelf"))


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    mesh = f'mode = "router"\nendpoint = "tls/127.0.0.1:{free_port()}"\ncredentials = "credentials"\n'
    path.write_text(f'scene = "dojo"\n[mesh]\n{mesh}{OBSERVERS}')
    return path


@pytest.fixture
def secure(scene, capsys):
    """`labanmesh secure VERB scene.toml ...`: status, output, error."""

    def call(verb, *words):
        status = main(["secure", verb, str(scene), *words])
        out, err = capsys.readouterr()
        return status, out, err

    return call


def placed(scene, certificate):
    """The folder that `add` made, copied to its machine as a user would; here all machines are one."""
    target = scene.parent / f"on-{certificate}"
    shutil.copytree(scene.parent / "secure" / certificate, target)
    return str(target)


def test_from_nothing_to_credentials_for_each_machine(scene, secure):
    status, out, err = secure("init")
    assert (status, err) == (0, "")
    steps = [line.split()[2:] for line in out.splitlines() if "secure add" in line]
    assert [words[-1] for words in steps] == ["router", "fusion", "sofa", "shelf", "hub"]
    for *_, machine in steps:
        status, out, err = secure("add", machine)
        assert (status, err) == (0, "") and f"certificate {machine}.1" in out
        assert f"scp -rp {scene.parent / 'secure' / machine}.1 {machine}:FOLDER/credentials" in out
    status, out, _ = secure("list", "--json")
    assert [row["roles"] for row in json.loads(out)] == [
        ["router"], ["fusion:fusion"], ["observer:sofa"], ["observer:shelf"], ["hub"]
    ]  # fmt: skip
    assert json.loads(out)[0]["hosts"] == ["127.0.0.1", "localhost"]


def test_for_a_scene_without_security_init_prints_what_to_write(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text(f'scene = "dojo"\n{OBSERVERS}')
    assert main(["secure", "init", str(path)]) == 0
    out = capsys.readouterr().out
    assert 'endpoint = "tls/ADDRESS-OF-THE-ROUTER:7447"' in out and 'credentials = "credentials"' in out
    assert main(["secure", "rules", str(path)]) == 2
    assert "rules without certificates have no effect" in capsys.readouterr().err


def test_what_is_missing_is_shown_by_an_example_of_the_sub_verb_and_what_an_endpoint_is(scene, capsys):
    assert main(["secure", "add", str(scene)]) == 2
    assert "Missing argument 'SCENE', e.g. labanmesh secure add scene.toml attic --observer" in capsys.readouterr().err
    assert main(["router", "attic"]) == 2
    assert "endpoint 'attic': PROTOCOL/HOST:PORT is expected, e.g. tcp/0.0.0.0:7447" in capsys.readouterr().err


def test_renewal_prints_the_next_step(secure):
    secure("init")
    assert secure("list")[1].startswith("no certificate yet; the first: labanmesh secure add ")
    secure("add", "sofa")
    status, out, _ = secure("renew", "sofa")
    assert status == 0 and "sofa.2" in out and out.splitlines()[-1].endswith("sofa.1")
    assert out.splitlines()[-1].startswith("when it is in place: labanmesh secure revoke ")
    assert "sofa.2/* sofa:FOLDER/credentials/" in out, "-r would put the new folder inside the old one"
    assert secure("revoke", "sofa.1")[1].startswith("revoked: sofa.1\n")
    states = [line.split()[3:5] for line in secure("list")[1].splitlines()[1:]]
    assert states == [["revoked", "365"], ["in", "force"]]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("add", "attic"), "say what this machine is for"),
        (("add", "sofa", "--observer", "door"), "observer 'door': not in the scene"),
        (("renew", "attic"), "no such machine in the register; known: sofa"),
        (("revoke", "attic"), "no certificate in force has this name; in force: sofa.1"),
        (("add", "sofa"), "has certificate sofa.1"),
        (("init",), "keys are never overwritten"),
        (("bow",), "No such command 'bow'; see labanmesh secure --help"),
        (("list", "--to", "nowhere"), "register.json: no such file or directory; labanmesh secure init"),
    ],
)
def test_each_fault_is_one_line_and_status_2(secure, words, line):
    secure("init")
    secure("add", "sofa")
    status, out, err = secure(*words)
    assert (status, out) == (2, "") and line in err and err.count("\n") == 1


@pytest.fixture
def prepare(scene, secure):
    """Makes the authority and certificates, and puts the router's in place; returns a mesh section per certificate."""

    def run(*machines):
        secure("init")
        for machine in ("router", *machines):
            secure("add", machine)
        shutil.copytree(scene.parent / "secure" / "router.1", scene.parent / "credentials")
        return partial(mesh_of, scene)

    return run


def mesh_of(scene, certificate):
    return read_scene(scene, {}).mesh.model_copy(update={"credentials": placed(scene, certificate)})


def routing(rules):
    """A router in a thread that looks for changes all the time."""
    return running(lambda stop: route(rules, stop, poll_s=0.02))


def admitted(mesh, role="observer", refusal=""):
    """Whether a process is admitted now; a busy router may be too late for one attempt. refusal: why it may not be."""
    try:
        with Link.open(mesh, role, timeout_s=SOON_S) as link:
            return link.admitted(SOON_S)
    except LabanmeshError as error:
        assert refusal in str(error)
        return False


def test_a_running_router_takes_up_what_changes(scene, secure, prepare, monkeypatch, caplog):
    """New certificates, revocations, and rules that cannot be used; open links end with the old rules."""
    monkeypatch.setattr("common.link.ADMISSION_TIMEOUT_S", 0.5)
    sofa = prepare("sofa")("sofa.1")
    with routing(rules_of_scenes([scene])):
        until(lambda: admitted(sofa))
        register = scene.parent / "secure" / "register.json"
        good = register.read_text()
        register.write_text(good[: len(good) // 2])
        with Link.open(sofa, "observer", timeout_s=SOON_S) as early:
            until(lambda: "the old ones stay in force" in caplog.text)
            assert early.admitted(SOON_S)
            register.write_text(good)
            secure("add", "shelf")
            shelf = mesh_of(scene, "shelf.1")
            until(lambda: admitted(shelf, refusal="do not know certificate shelf.1"))
            assert early.admitted(SOON_S)  # it reconnected by itself
            secure("revoke", "sofa")
            until(lambda: not early.admitted(1.0))
        with pytest.raises(LabanmeshError, match=r"do not know certificate sofa\.1: revoked"):
            Link.open(sofa, "observer", timeout_s=SOON_S)
        until(lambda: admitted(shelf))


def test_a_router_runs_on_the_rules_that_secure_prints(scene, secure, prepare, tmp_path):
    hub = prepare("hub")("hub.1")
    file = tmp_path / "router.json5"
    file.write_text(secure("rules")[1])
    with routing(rules_in_file(file)):
        until(lambda: admitted(hub, "hub"))
    status, out, _ = secure("rules", "--credentials", "/run/credentials", "--listen", "tls/0.0.0.0:9")
    assert status == 0 and '"/run/credentials/key.pem"' in out and "tls/0.0.0.0:9" in out and '"hub.1"' in out


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda folder: None, "no such folder; copy the folder here"),
        (lambda folder: shutil.copytree(folder / "secure" / "sofa.1", folder / "credentials"),
         "certificate sofa.1 is for observer sofa, not for router"),
        (lambda folder: (folder / "secure" / "register.json").unlink()
         or shutil.copytree(folder / "secure" / "router.1", folder / "credentials"), "register.json: no such file"),
    ],
)  # fmt: skip
def test_a_router_that_cannot_be_secured_does_not_start(scene, secure, spoil, line):
    secure("init")
    secure("add", "router")
    secure("add", "sofa")
    spoil(scene.parent)
    with pytest.raises(LabanmeshError) as caught:
        route(rules_of_scenes([scene]), threading.Event())
    assert line in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("banana",), "endpoint 'banana': PROTOCOL/HOST:PORT is expected"),
        (("--config", "nowhere.json5"), "nowhere.json5: no such file or directory; `labanmesh secure rules SCENE`"),
        (("tcp/127.0.0.1:1", "--config", "x"), "says itself where to listen"),
    ],
)
def test_a_router_that_cannot_start_is_one_line(capsys, words, line):
    assert main(["router", *words]) in (1, 2)
    err = capsys.readouterr().err
    assert line in err and err.count("\n") == 1


def test_the_process_prints_where_it_listens_and_ends_cleanly(scene, prepare):
    prepare()
    endpoint = read_scene(scene, {}).mesh.endpoint
    with subprocess.Popen(labanmesh("router", "--scene", scene), stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr.readline() == f"labanmesh router: listening on {endpoint}\n"
        os.kill(process.pid, signal.SIGTERM)
        assert process.wait(SOON_S) == 0
        assert process.stderr.read() == "", "it has certificates and warns of nothing"


@pytest.mark.parametrize(
    ("endpoint", "warning"),
    [
        ("tcp/127.0.0.1:0", ""),
        (
            "tcp/0.0.0.0:0",
            "open on every interface of this machine without certificates: whoever reaches it may",
        ),
        ("tcp/[::]:0", "teach movements and make it forget them; labanmesh secure init SCENE, or listen on tcp/127"),
    ],
)
def test_a_router_without_certificates_says_what_strangers_may_do(endpoint, warning, caplog, tmp_path):
    file = tmp_path / "router.json5"
    file.write_text(json.dumps({"mode": "router", "listen": {"endpoints": {"router": [endpoint]}}}))
    for rules in (plain_rules(endpoint), rules_in_file(file)):
        caplog.clear()
        assert Link.check_router(rules.make(), "here") == [endpoint]
        route(rules, Opened())
        assert [warning in line for line in caplog.messages] == [True] * bool(warning)


class Opened(threading.Event):
    """Is set as soon as the router waits for it."""

    def wait(self, timeout=None):
        self.set()
        return True


def test_a_running_router_takes_up_a_scene_that_joins(scene, secure, monkeypatch, caplog):
    monkeypatch.setattr("common.link.ADMISSION_TIMEOUT_S", 0.5)
    folder = scene.parent
    for words in (["init"], ["add", "router"], ["add", "hub"]):
        assert main(["secure", words[0], str(folder), *words[1:]]) == 0
    shutil.copytree(folder / "secure" / "router.1", folder / "credentials")
    hub = read_scene(scene, {}).mesh.model_copy(update={"credentials": placed(scene, "hub.1")})
    with routing(rules_of_scenes([folder])):
        until(lambda: admitted(hub, "hub"))
        (folder / "garden.toml").write_text(scene.read_text().replace("dojo", "garden"))
        until(lambda: "not of scene 'garden'; labanmesh secure init" in caplog.text)
        assert main(["secure", "init", str(folder)]) == 0
        assert main(["secure", "add", str(folder), "pi", "--observer", "garden/sofa"]) == 0
        pi = hub.model_copy(update={"credentials": placed(scene, "pi.1")})
        until(lambda: admitted(pi))
    assert main(["secure", "list", str(scene)]) == 2  # one of the scenes alone
