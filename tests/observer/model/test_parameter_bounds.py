"""Each parameter of each kind of model has bounds, which the docs list; model files with anything else are refused."""

import copy
import json
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import Header, Onset, with_defaults
from observer.model.model_file import read_model, write_model
from observer.model.registry import MODELS
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import read_archive
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS
from studies.performer import perform

DOCS = Path(__file__).parents[3] / "docs" / "design" / "model.md"
VOCABULARY = Vocabulary(("byebye", "lunging"))
DOOR = parse_view("door")
NUMBERS = (math.nan, math.inf, -1, 0, 1e-320, 1e9, 1e308, -1e308, 10**400, None, "x", [], {})


def rows():
    """The table of the docs: a row for each parameter, with the kinds that have it."""
    kinds = {}
    for kind, model in MODELS.items():
        for name, parameter in model.PARAMETERS.items():
            kinds.setdefault((name, f"{parameter.default:g}", parameter.values), []).append(f"`{kind}`")
    return [f"| `{name}` | {', '.join(of)} | {default} | {values} |" for (name, default, values), of in kinds.items()]


def test_the_docs_list_every_parameter_with_its_bounds():
    text = DOCS.read_text()
    missing = [row for row in rows() if row not in text]
    assert not missing, "\n".join(["docs/design/model.md lacks", *missing])


@pytest.mark.parametrize("kind", MODELS)
def test_a_parameter_outside_its_bounds_is_one_line(kind):
    header = Header(kind, VOCABULARY, "door", np.eye(3, 4), 15.0, BODY_PARTS)
    for name, parameter in MODELS[kind].PARAMETERS.items():
        low, high = parameter.low, parameter.high
        wrong = [math.nan, math.inf, -math.inf, 1e308, -1e308, math.nextafter(high, math.inf), low - 1e-3]
        wrong += [1e-320] * (low > 0) + [low + 0.5] * parameter.whole
        for value in wrong:
            with pytest.raises(BadInput, match=f"parameter {name} = .* is expected$") as refused:
                with_defaults(replace(header, parameters={name: value}), MODELS[kind].PARAMETERS)
            assert "\n" not in str(refused.value)


@pytest.fixture(scope="module")
def learned():
    """Recordings, and the arrays of a model file of each kind."""
    archive = perform(("1", "2"), movements=VOCABULARY.labels, trials=2, seed=1)
    return archive, {}


@pytest.fixture
def arrays(learned, tmp_path):
    archive, known = learned

    def of(kind):
        if kind not in known:
            write_model(tmp_path / kind, learn_view(archive, DOOR, VOCABULARY, kind=kind, calibrate=False))
            with np.load(tmp_path / kind) as file:
                known[kind] = {name: file[name] for name in file.files}
        return known[kind]

    return of


@pytest.fixture
def judged(learned, tmp_path):
    """Reads a model file with these arrays: a line, if it is refused; None, if its posteriors are distributions."""
    recording = learned[0].recordings[0]

    def judge(arrays):
        path = tmp_path / "damaged.model"
        with path.open("wb") as file:
            np.savez(file, **arrays)
        try:
            model = read_model(path)
        except BadInput as error:
            line = str(error)
            assert "\n" not in line and len(line) < 500 and str(path) in line
            return line
        observer = Observer(ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS), model, Onset())
        for frame in list(frames_of(recording))[::8]:
            posterior = observer.step(frame)
            p = np.append(posterior.p, [posterior.rest, posterior.unlearned or 0.0])
            assert (p >= 0).all() and (p <= 1).all() and posterior.p.sum() == pytest.approx(1, abs=1e-9)
        return None

    return judge


DAMAGE = [
    ("phase", "movement_of", lambda a: a + 1000),
    ("phase", "facing_of", lambda a: a * 0 - 5),
    ("frame-table", "log_table", lambda a: a * 0 + 1e308),
    ("frame-table", "mean_frames", lambda a: a * 0 + 1e-320),
    ("stacked", "rocket_length", lambda a: a * 0 + 2**62),
    ("stacked", "rocket_channels", lambda a: a[:-1]),
    ("stacked", "rocket_biases", lambda a: a[:84]),
    ("stacked", "running_weights", lambda a: a * np.inf),
    ("stacked", "take_scales", lambda a: a * 0),
    ("stacked", "example_movements", lambda a: a * 0),
    ("stacked", "extents", lambda a: a * -1),
    ("stacked", "example_traces", lambda a: a * np.nan),
    ("stacked", "example_lengths", lambda a: np.full_like(a, 2**31 - 1)),
    ("stacked", "chains", lambda a: np.array([{}], dtype=object)),
]


@pytest.mark.parametrize(("kind", "name", "change"), DAMAGE, ids=[f"{kind}-{name}" for kind, name, _ in DAMAGE])
def test_arrays_that_are_no_model_are_refused(kind, name, change, arrays, judged):
    with np.errstate(all="ignore"):
        assert judged({**arrays(kind), name: change(arrays(kind)[name])})


def places(value, place=()):
    if isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else list(enumerate(value))[:2]:
            yield (*place, key)
            yield from places(each, (*place, key))


def test_a_header_with_anything_in_any_place_is_refused_or_harmless(arrays, judged):
    whole = arrays("phase")
    header = json.loads(str(whole["header"]))
    for n, (*above, last) in enumerate(places(header)):
        # Each place gets some of the numbers, all together each number often.
        for value in NUMBERS[n % 4 :: 4]:
            changed = copy.deepcopy(header)
            table = changed
            for key in above:
                table = table[key]
            table[last] = value
            judged({**whole, "header": np.array(json.dumps(changed))})
    for text in ("[" * 100_000, "null", "{}", '{"format": 1}'):
        assert judged({**whole, "header": np.array(text)})
    older = {**header, "certainty": {"temperature": 2.0, "doubt": 0.1}}
    assert judged({**whole, "header": np.array(json.dumps(older))}) is None
    for rate in (0, 1e-320, 1e300):
        assert "rate_hz" in judged({**whole, "header": np.array(json.dumps({**header, "rate_hz": rate}))})


@pytest.mark.parametrize("read", [read_model, read_archive])
def test_a_small_file_that_unpacks_to_gigabytes_is_refused_unread(read, tmp_path, monkeypatch):
    monkeypatch.setattr("observer.files.UNPACKED_BYTES", 2**20)
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("header.npy", bytes(8_000_000), compresslevel=1)
    monkeypatch.setattr(np, "load", lambda *_, **__: pytest.fail("was read"))
    with pytest.raises(BadInput, match="KB that unpack to 8 MB"):
        read(path)


@pytest.mark.parametrize("read", [read_model, read_archive])
@pytest.mark.parametrize(
    "path", [Path("/dev/zero"), Path("/"), Path("x" * 300)], ids=["endless", "folder", "long name"]
)
def test_what_is_no_file_is_one_line_and_ends(read, path):
    with pytest.raises(BadInput) as refused:
        read(path)
    assert "\n" not in str(refused.value)


TRACKS = {
    "tracks": np.zeros((4, 3, 2), np.float32), "lengths": np.array([4]), "rate_hz": np.array(15.0),
    "body_parts": np.array(BODY_PARTS), "labels": np.array(["wave"]), "subjects": np.array(["a"]),
    "trials": np.array(["1"]), "camera": np.array("sofa"), "times_s": np.arange(4) / 15,
}  # fmt: skip


@pytest.mark.parametrize(
    "changes",
    [{"tracks": np.full((4, 3, 2), np.nan, np.float32)}, {"tracks": np.full((4, 3, 2), 1e38, np.float32)},
     {"tracks": np.full((4, 3, 2), np.inf, np.float32)}, {"times_s": np.arange(4)[::-1] / 15},
     {"times_s": np.full(4, np.nan)}, {"times_s": np.arange(4) * 1e300}, {"lengths": np.array([2**62])},
     {"lengths": np.array([-4])}, {"rate_hz": np.array(np.nan)}, {"rate_hz": np.array(1e300)},
     {"rate_hz": np.array(1e-320)}, {"labels": np.array([{}], dtype=object)}, {"tracks": np.array([None] * 4)}],
    ids=str,
)  # fmt: skip
def test_tracks_that_nobody_recorded_are_refused(changes, tmp_path):
    path = tmp_path / "sofa.npz"
    np.savez(path, **TRACKS)
    assert isinstance(read_archive(path), MotionArchive)
    np.savez(path, **{**TRACKS, **changes})
    with pytest.raises(BadInput) as refused:
        read_archive(path)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 400
