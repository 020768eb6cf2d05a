"""The scene file: defaults, errors as one line, environment."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import MODELS_VARIABLE, Scene, read_scene
from common.errors import BadInput, Faults

LEAST = 'scene = "dojo"\n[observers.cam1]\nsource = "motion.npz"\n'


def scene_of(observers):
    return 'scene = "dojo"\n' + "".join(f'[observers.cam{n}]\nsource = "m.npz"\n' for n in range(1, observers + 1))


THREE = scene_of(3)


@pytest.fixture
def scene(tmp_path):
    def read(text, **environment):
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        return read_scene(tmp_path / "scene.toml", environment)

    return read


@pytest.fixture
def fault(scene):
    def line(text, **environment):
        with pytest.raises(BadInput) as caught:
            scene(text, **environment)
        message = str(caught.value)
        assert "\n" not in message and "pydantic" not in message
        return message

    return line


def test_only_the_name_and_the_sources_have_no_default(scene):
    read = scene(LEAST)
    assert read.scene == "dojo" and read.roster == ("cam1",) and read.named_vocabulary is None
    assert read.keys.judgement == "laban/dojo/judgement" and read.observer("cam1").model == "cam1.model"


def test_a_key_that_is_set_counts(scene):
    read = scene(
        'scene = "dojo"\nvocabulary = ["lunging", "bowing"]\nvocabulary_name = "karate"\n'
        '[mesh]\nmode = "router"\nendpoint = "tls/judge.example:7447"\nprefix = "home/laban"\n'
        '[observers.cam1]\nsource = "m.npz"\nview = "yaw:45"\nmodel = "a.model"\nspeed = 0\nrecording = "all"\n'
    )
    assert read.named_vocabulary.labels == ("lunging", "bowing") and read.named_vocabulary.name == "karate"
    assert read.keys.judgement == "home/laban/dojo/judgement"
    assert (read.observer("cam1").model, read.observer("cam1").recording) == ("a.model", "all")


@pytest.mark.parametrize(("observers", "quorum"), [(1, 1), (2, 1), (3, 2), (4, 2)])
def test_the_default_quorum_is_half_of_the_observers(scene, observers, quorum):
    assert scene(scene_of(observers)).fusion.quorum == quorum


def test_file_names_start_from_the_folder_of_the_scene_file(scene, tmp_path, monkeypatch):
    assert scene(LEAST).place("motion.npz") == tmp_path / "motion.npz"
    monkeypatch.chdir(tmp_path)
    assert read_scene((tmp_path / "scene.toml").relative_to(tmp_path), {}).place("m") == tmp_path / "m"
    assert scene(LEAST).place(str(tmp_path.parent / "m")) == tmp_path.parent / "m"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("scene = = 1", "not TOML: Invalid value (at line 1, column 9)"),
        ('[observers.cam1]\nsource = "m"', "scene: missing; this key has no default"),
        ('scene = "d"', "no observers: name at least one"),
        ('scene = "d"\n[observers]', "no observers"),
        ('scene = "d"\nobservers = 3', "observers = 3: must be a table"),
        ('scene = "d"\n[observers]\ncam1 = "rtsps://nvr/KEY"', "observers.cam1 = 'rtsps://nvr/...': must be a table"),
        ('scene = "d"\n[observers.cam1]\nview = "door"', "observers.cam1.source: missing"),
        (LEAST.replace("source", "sorce"), "observers.cam1.sorce: unknown key; did you mean source?"),
        (LEAST.replace("observers", "observer"), "observer: unknown key; did you mean observers?"),
        (LEAST + "[fusion]\nxyz = 1", "fusion.xyz: unknown key; known: id, rule, quorum"),
        (LEAST + "[fusion]\nthreshold = 1.5", "fusion.threshold = 1.5: must be less than or equal to 1"),
        (LEAST + '[fusion]\nthreshold = "0.5"', "fusion.threshold = '0.5': must be a valid number"),
        (LEAST + "[fusion]\nquorum = 2", "fusion.quorum = 2: the scene has 1 observer, and no more can agree"),
        (LEAST + "[fusion]\ntemperature = 1e-4", "fusion.temperature = 0.0001: must be greater than or equal to 0.001"),
        (LEAST + "[fusion]\ntemperature = 1e4", "fusion.temperature = 10000.0: must be less than or equal to 1000"),
        (LEAST + "[fusion]\nfade_s = inf", "fusion.fade_s = inf: must be a finite number"),
        (LEAST + '[fusion]\nid = "F"', "fusion.id = 'F': 1 to 64 characters of a-z"),
        (LEAST + "recording = -1", 'observers.cam1.recording = -1: must be the index of a recording, from 0, or "all"'),
        (LEAST + '[mesh]\nmode = "cloud"', "mesh.mode = 'cloud': must be 'machine', 'router' or 'process'"),
        (LEAST + '[mesh]\nendpoint = "localhost"', "mesh.endpoint = 'localhost': must be PROTOCOL/HOST:PORT"),
        (LEAST + '[mesh]\nendpoint = "tcp/a:70000"', "mesh.endpoint = 'tcp/a:70000': the port must be 1 to 65535"),
        (LEAST + f'[mesh]\nendpoint = "{"x" * 5000}"', f"mesh.endpoint = '{'x' * 59}...: must be PROTOCOL/HOST:PORT"),
        (LEAST + '[hub.mqtt]\ntopics = "a b"', "hub.mqtt.topics = 'a b': must be parts of a-z, A-Z, 0-9"),
        (LEAST + '[hub.mqtt]\ndiscovery = ""', "hub.mqtt.discovery = '': must be parts of a-z"),
        (LEAST + '[hub.mqtt]\npassword_file = "p"', "hub.mqtt.password_file = 'p': a password needs a user"),
        (LEAST + '[metrics]\nlisten = "9464"', "metrics.listen = '9464': must be HOST:PORT with a port up to 65535"),
        (LEAST + '[mesh]\nprefix = "a b"', "mesh.prefix = 'a b': 1 to 64 characters"),
        (LEAST.replace("cam1", "Cam1"), "observers = 'Cam1': 1 to 64 characters"),
        (LEAST.replace('"dojo"', '"my dojo"'), "scene = 'my dojo': 1 to 64 characters"),
        ('vocabulary = ["a", "a"]\n' + LEAST, "label 'a' occurs twice"),
        ('vocabulary = "ab"\n' + LEAST, 'vocabulary = \'ab\': must be a list; e.g. vocabulary = ["wave", "clap"]'),
        ("# nothing yet\n", "empty; `labanmesh init` writes a scene file"),
        ("[mesh]", 'scene: missing; this key has no default; e.g. scene = "'),
        (LEAST + '[fusion]\nquorum = "two"', "fusion.quorum = 'two': must be a valid integer; e.g. quorum = 1"),
        (
            LEAST + '[fusion]\nquorum = "2"',
            "fusion.quorum = '2': must be a valid integer; write quorum = 2, without quotes",
        ),
        (LEAST + "[fusion]\nstart_s = 90", "fusion.start_s = 90: must be less than or equal to 60; choose 0 to 60"),
        (LEAST + "view = 30", 'observers.cam1.view = 30: must be text in quotes; write view = "30"'),
        (
            LEAST + 'loop = "yes"',
            "observers.cam1.loop = 'yes': must be true or false; write loop = true, without quotes",
        ),
        (LEAST + "rate_hz = true", "observers.cam1.rate_hz = true: must be a valid number; e.g. rate_hz = 15.0"),
        (LEAST + "size_px = [640]", "observers.cam1.size_px: item 2 is missing; e.g. size_px = [640, 480]"),
        (LEAST + "quorum = 1", "observers.cam1.quorum: unknown key; it belongs below [fusion]"),
        (
            LEAST + 'preview = "out.avi"',
            "observers.cam1.preview: this key was removed, delete it; picture_hz on the dashboard",
        ),
        (
            LEAST + "[observers.cam1.virtual]\nblur = 0.5",
            "observers.cam1.virtual: this key was removed, delete it; recorded motion is filmed in one room",
        ),
        (LEAST + "tls = true", "observers.cam1.tls: unknown key; it belongs below [hub.mqtt]"),
        (
            'scene = "d"\n[observers]\nsource = "0"',
            "observers.source = '0': must be a table, which starts with [observers.ID]",
        ),
    ],
)
def test_each_fault_is_one_line_with_file_key_value_and_rule(fault, tmp_path, text, line):
    assert fault(text).startswith(f"{tmp_path / 'scene.toml'}: {line}")


@pytest.mark.parametrize(
    ("line", "way_out"),
    [
        ("view = door", 'Invalid value (at line 4, column 8): view = door; text stands in quotes, KEY = "TEXT"'),
        ('view = "door', "Unterminated string (at end of document); the text in quotes has no end; close the quotes"),
        (
            'view = "door\n',
            "Illegal character '\\n' (at line 4, column 13): view = \"door; the text in quotes has no end",
        ),
        ('model = "C:\\Users\\a"', 'Invalid hex value (at line 4, column 14): model = "C:\\Users\\a"; a \\ within'),
        (
            "speed = 0,5",
            "Expected newline or end of document after a statement (at line 4, column 10): speed = 0,5; one KEY",
        ),
        (
            "view: door",
            "Expected '=' after a key in a key/value pair (at line 4, column 5): view: door; a line is KEY = VALUE",
        ),
        (
            "[observers.cam1]",
            "Cannot declare ('observers', 'cam1') twice (at line 4, column 16): [observers.cam1]; each",
        ),
        (
            'source = "1"\n',
            'Cannot overwrite a value (at line 4, column 13): source = "1"; each key stands once; remove one',
        ),
        (
            "source = rtsp://me:pw@cam/key",
            'Invalid value (at line 4, column 10): source = ...; text stands in quotes, KEY = "TEXT"',
        ),
        ('source = "me:pw@cam\n', "Illegal character '\\n' (at line 4, column 20): source = \"...; the text in quotes"),
        ("\0", "Invalid statement (at line 4, column 1): ?; a line is KEY = VALUE, [SECTION] or # COMMENT"),
    ],
)
def test_what_is_not_toml_names_the_line_and_what_is_right(fault, tmp_path, line, way_out):
    assert fault(LEAST + line).startswith(f"{tmp_path / 'scene.toml'}: not TOML: {way_out}")


def test_line_ends_and_the_mark_of_other_editors_are_read(tmp_path):
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf" + LEAST.replace("\n", "\r\n").encode())
    assert read_scene(tmp_path / "s.toml", {}).scene == "dojo"


@pytest.mark.parametrize(
    ("more", "faults"),
    [
        (
            "speed = -1\nsped = 1\nsorce = 1\n[fusion]\nruel = 1\nquorum = 9\n[mesh]\ncredentials = 'mesh'",
            [
                "observers.cam1.sped:",
                "observers.cam1.sorce:",
                "fusion.ruel:",
                "mesh.credentials",
                "observers.cam1.speed",
                "fusion.quorum = 9",
            ],
        ),
        (
            'follow_near = [0.5, 0.5]\n[people]\nmost = 1\nnames = ["a", "b"]\n[fusion]\nperiodic = 3',
            ["observers.cam1.follow = ", "people.names = ['a', 'b']", "fusion.periodic = 3"],
        ),
        (
            '[observers.Cam2]\nsource = "0"\n[notify.door]\n[fusion]\nstandby = ["fusion"]\nquorum = 3',
            ["observers = 'Cam2'", "notify.door: needs url", "fusion.standby = ['fusion']", "fusion.quorum = 3"],
        ),
    ],
)
def test_all_faults_are_listed_and_the_message_is_the_first(scene, tmp_path, more, faults):
    with pytest.raises(Faults) as caught:
        scene(LEAST + more, LABANMESH_FUSION_IDS="x")
    file = tmp_path / "scene.toml"
    begins = ["LABANMESH_FUSION_IDS: unknown", *(f"{file}: {fault}" for fault in faults)]
    for begin in begins:
        assert sum(fault.startswith(begin) for fault in caught.value.faults) == 1, begin
    assert len(caught.value.faults) == len(begins)
    assert str(caught.value) == f"{caught.value.faults[0]} ({len(begins) - 1} more: labanmesh doctor {file})"


def test_a_file_that_cannot_be_read_is_one_line(tmp_path):
    with pytest.raises(
        BadInput, match=r"nothing\.toml: no such file or directory; name a scene file, or let `labanmesh"
    ):
        read_scene(tmp_path / "nothing.toml", {})
    with pytest.raises(BadInput, match="is a directory"):
        read_scene(tmp_path, {})
    (tmp_path / "latin.toml").write_bytes(b'scene = "d\xe9"')
    with pytest.raises(BadInput, match="not UTF-8"):
        read_scene(tmp_path / "latin.toml", {})


def test_taught_models_have_a_folder_of_their_own_if_one_is_named(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "home"\n[observers.sofa]\nsource = "0"\nmodel = "models/sofa.model"\n')
    beside, taught = tmp_path / "models" / "sofa.model", tmp_path / "state" / "sofa.model"
    plain = read_scene(tmp_path / "s.toml", {})
    assert plain.taught_model("sofa") == plain.model_file("sofa") == beside
    apart = read_scene(tmp_path / "s.toml", {MODELS_VARIABLE: str(tmp_path / "state")})
    assert apart.taught_model("sofa") == apart.model_file("sofa") == taught
    for file, found in ((beside, beside), (taught, taught)):
        file.parent.mkdir()
        file.write_bytes(b"")
        assert apart.model_file("sofa") == found


def test_an_unknown_observer_lists_the_known_ones(scene):
    with pytest.raises(BadInput, match="observer 'cam9': not in the scene; known: cam1, cam2, cam3"):
        scene(THREE).observer("cam9")


def test_the_environment_overrides(scene):
    read = scene(
        THREE.replace("cam2", "cam-2") + "[fusion]\nthreshold = 0.5",
        LABANMESH_SCENE="garden",
        LABANMESH_VOCABULARY="a, b,c",
        LABANMESH_MESH_ENDPOINT="tcp/10.0.0.1:1",
        LABANMESH_FUSION_RULE="log",
        LABANMESH_FUSION_THRESHOLD="0.9",
        LABANMESH_FUSION_QUORUM="3",
        LABANMESH_OBSERVERS_CAM1_LOOP="true",
        LABANMESH_OBSERVERS_CAM_2_RECORDING="4",
        LABANMESH_OBSERVERS_CAM3_RECORDING="all",
        LABANMESH_DATA="elsewhere",
        HOME="h",
    )
    assert read.scene == "garden" and read.vocabulary == ("a", "b", "c") and read.mesh.endpoint == "tcp/10.0.0.1:1"
    assert (read.fusion.rule, read.fusion.threshold, read.fusion.quorum) == ("log", 0.9, 3)
    assert read.observer("cam1").loop and read.observer("cam-2").recording == 4
    assert read.observer("cam3").recording == "all"


@pytest.mark.parametrize(
    ("variable", "value", "line"),
    [
        ("LABANMESH_FUSION_THRESHOLD", "high", "LABANMESH_FUSION_THRESHOLD = 'high': must be a valid number"),
        ("LABANMESH_FUSION_THRESHOLD", "2", "LABANMESH_FUSION_THRESHOLD = '2': must be less than or equal to 1"),
        ("LABANMESH_FUSION_RULES", "log", "LABANMESH_FUSION_RULES: unknown environment variable; did you mean"),
        ("LABANMESH_OBSERVERS_CAM9_SPEED", "1", "LABANMESH_OBSERVERS_CAM9_SPEED: unknown environment variable"),
        ("LABANMESH_OBSERVERS_CAM1_PREVIEW", "a", "LABANMESH_OBSERVERS_CAM1_PREVIEW: its key was removed, unset it; "),
        ("LABANMESH_MESH_MODE", "cloud", "LABANMESH_MESH_MODE = 'cloud': must be 'machine', 'router' or 'process'"),
    ],
)
def test_a_fault_in_the_environment_names_the_variable(fault, variable, value, line):
    assert fault(LEAST, **{variable: value}).startswith(line)


def test_the_process_environment_is_the_default(tmp_path, monkeypatch):
    (tmp_path / "s.toml").write_text(LEAST)
    monkeypatch.setenv("LABANMESH_FUSION_RULE", "log")
    assert read_scene(tmp_path / "s.toml").fusion.rule == "log"


VALUES = st.recursive(
    st.booleans() | st.integers() | st.floats() | st.text("ab/ ", max_size=5),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text("abc", min_size=1), inner, max_size=2),
    max_leaves=4,
)


def toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return str(value).lower() if isinstance(value, bool | int | float) else f'"{value}"'


@given(st.sampled_from(["scene", "mesh", "fusion", "observers", "vocabulary", "observers.cam1", "mesh.mode"]), VALUES)
def test_any_value_anywhere_is_read_or_one_line(tmp_path_factory, key, value):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    rest = "" if key == "scene" else 'scene = "dojo"\n'
    observers = "" if key.startswith("observers") else '[observers.cam1]\nsource = "m"\n'
    path.write_text(f"{rest}{key} = {toml(value)}\n{observers}")
    try:
        read_scene(path, {})
    except BadInput as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("keys", ['follow = "nearest"', "follow_near = [0.5, 0.5]", 'follow = "tallest"'])
def test_a_mark_belongs_to_the_rule_nearest(tmp_path, keys):
    file = tmp_path / "scene.toml"
    file.write_text(f'scene = "dojo"\n[observers.cam1]\nsource = "0"\n{keys}\n')
    with pytest.raises(BadInput, match="follow"):
        read_scene(file, {})
    file.write_text('scene = "d"\n[observers.a]\nsource = "0"\nfollow = "nearest"\nfollow_near = [0.5, 1]\n')
    assert read_scene(file, {}).observers["a"].follow_near == (0.5, 1.0)


def test_a_periodic_movement_is_one_of_the_vocabulary():
    keys = {"scene": "dojo", "observers": {"door": {"source": "0"}}, "fusion": {"periodic": ["wav"]}}
    with pytest.raises(BadInput, match=r"'wav': no movement of the vocabulary; known: wave, clap"):
        Scene(vocabulary=("wave", "clap"), **keys)
    assert Scene(**keys).fusion.periodic == ("wav",)
