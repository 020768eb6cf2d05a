"""Models of camera files are learned with the person where they stand in the camera's room, and face as they do."""

import math
from dataclasses import replace

import numpy as np
import pytest
from observer_stage import rejected

from common.config import read_scene
from common.vocabulary import Vocabulary
from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.placement import PersonPlacement, facing_of, parse_place, placement_of
from observer.geometry.projection import pinhole_matrix, project
from observer.geometry.views import View, parse_view
from observer.learning.editing import add_movements
from observer.learning.learn import learn_view
from observer.model.model_file import doubt_of_view, read_model
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.motion.projected import mean_place, placed
from observer.runtime.preflight import check_observer
from observer.runtime.scene_inputs import open_inputs, person_in
from studies.performer import perform

AWAY_M, FOCAL_PX, MIDDLE_PX = 2.5, 600.0, (320.0, 240.0)
STANDING = PersonPlacement(0.4, 1.3, 1.5, 30.0)
PARTS = ("left_hand", "right_hand", "head")


def camera(yaw_deg, person=STANDING, head_m=None):
    """(3, 4) a camera in the direction yaw_deg of the room, AWAY_M from the person's head, 0.5 m below it."""
    target = (person.x_m, (person.head_m if head_m is None else head_m) - 0.5, person.z_m)
    return pinhole_matrix(math.radians(yaw_deg), 0.1, AWAY_M, FOCAL_PX, MIDDLE_PX, target)


@pytest.fixture(scope="module")
def people():
    """Recordings in a Kinect's axes: 2 to 3 m from the origin, heads at its height."""
    rng, recordings = np.random.default_rng(0), []
    for n in range(3):
        body = np.array([[-0.2, -0.6, -0.1], [0.3, -0.5, -0.2], [0.0, 0.1, 0.0]])
        body += 0.1 * n, 0.0, 2.0 + 0.3 * n
        positions = (body + rng.normal(0, 0.05, (9, 3, 3))).astype(np.float32)
        recordings.append(Recording(positions, 15.0, "wave", "a", str(n)))
    return MotionArchive(PARTS, tuple(recordings))


@pytest.mark.parametrize("facing_deg", [0.0, 30.0, 90.0, -120.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 45.0, 135.0])
def test_a_camera_at_a_yaw_sees_who_faces_an_angle_as_one_at_their_sum_sees_who_faces_it(people, yaw_deg, facing_deg):
    one = MotionArchive(PARTS, people.recordings[:1])
    person = replace(STANDING, facing_deg=facing_deg)
    heads = one.recordings[0].positions[:, 2].astype(float)
    x, _, z = heads.mean(axis=0)
    own = PersonPlacement(x, z, float(np.percentile(heads[:, 1], 90)))
    np.testing.assert_allclose(
        project(camera(yaw_deg, person), placed(one, person).recordings[0].positions),
        project(camera(yaw_deg + facing_deg, own), one.recordings[0].positions),
        atol=0.01,
    )


def test_everybody_stands_at_the_place_with_the_head_at_its_height(people):
    moved = placed(people, STANDING)
    heads = np.array([recording.positions[:, 2] for recording in moved.recordings])
    np.testing.assert_allclose(heads.mean(axis=1)[:, ::2], [(0.4, 1.3)] * 3, atol=1e-5)
    assert np.median(np.percentile(heads[..., 1], 90, axis=1)) == pytest.approx(1.5, abs=1e-5)
    assert mean_place(moved) == pytest.approx((0.4, 1.3), abs=1e-5)
    right = (moved.recordings[0].positions[:, 1] - moved.recordings[0].positions[:, 0]).mean(axis=0)
    before = (people.recordings[0].positions[:, 1] - people.recordings[0].positions[:, 0]).mean(axis=0)
    assert facing_of(right) - facing_of(before) == pytest.approx(30.0, abs=0.1)


def test_parts_that_were_not_seen_stay_so(people):
    blind = people.recordings[0].positions.copy()
    blind[:, 2] = np.nan
    blind[3, 0] = np.nan
    moved = placed(MotionArchive(PARTS, (replace(people.recordings[0], positions=blind),)), STANDING)
    assert (np.isnan(moved.recordings[0].positions) == np.isnan(blind)).all()


def test_a_place_is_two_or_three_numbers():
    assert placement_of(None, None) is None
    assert placement_of(None, 20.0) == PersonPlacement(0.0, 0.0, 1.6, 20.0)
    assert placement_of(parse_place("0.2,1.5"), None) == PersonPlacement(0.2, 1.5)
    assert placement_of(parse_place("0.2,1.7,1.5"), -30.0) == PersonPlacement(0.2, 1.5, 1.7, -30.0)
    for text in ("1", "1,2,3,4", "1,x", "nan,1"):
        with rejected("--place", "X,Z or X,Y,Z"):
            parse_place(text)


@pytest.fixture
def scene(tmp_path):
    """A scene of two cameras and an angle, with the person's place."""
    for yaw in (0, 90):
        write_camera(tmp_path / f"c{yaw}.toml", CameraModel(f"c{yaw}", camera(yaw)))
    write_archive(tmp_path / "people.npz", perform(("1", "2"), ("ok", "shake"), trials=1))
    (tmp_path / "scene.toml").write_text(
        'scene = "dojo"\n[person]\nplace = [0.4, 1.5, 1.3]\nfacing = 30\n'
        + "".join(f'[observers.c{yaw}]\nsource = "people.npz"\nview = "c{yaw}.toml"\n' for yaw in (0, 90))
        + '[observers.side]\nsource = "people.npz"\nview = "yaw:45"\n'
    )
    return tmp_path / "scene.toml"


def test_learn_takes_views_and_the_person_from_the_scene_file(run, scene):
    folder = scene.parent
    words = ("--model", "phase", "--jobs", "1", "-o", folder)
    status, out, _ = run("learn", folder / "people.npz", "--scene", scene, *words)
    assert status == 0 and out.count("for a person at [0.40, 1.50, 1.30] m, facing 30 degrees") == 2
    assert read_model(folder / "c90.model").header.placement == STANDING
    assert read_model(folder / "side.model").header.placement is None
    config = read_scene(scene, {})
    header, view = read_model(folder / "c90.model").header, parse_view("c90.toml", folder)
    assert doubt_of_view(folder / "c90.model", header, view, "c90.toml", person_in(config, "c90", view)) == ""
    for person, what in (
        (replace(STANDING, z_m=0.0), "[0.40, 1.50, 0.00]"),
        (replace(STANDING, facing_deg=80.0), "80"),
    ):
        doubt = doubt_of_view(folder / "c90.model", header, view, "c90.toml", person)
        assert what in doubt and "learn it again" in doubt
    own = config.observer("side").model_copy(update={"facing": 10.0})
    odd = config.model_copy(update={"observers": {**config.observers, "side": own}})
    assert any("only for camera files" in doubt for doubt in check_observer(odd, "side").doubts)
    moved = open_inputs(config, "c90", environment={}).source.recordings
    assert mean_place(MotionArchive(PARTS, tuple(moved))) == pytest.approx((0.4, 1.3), abs=0.01)


def test_learn_says_where_a_camera_file_expects_the_person(run, scene):
    words = ("--model", "phase", "-o", scene.parent / "c.model")
    status, out, _ = run("learn", scene.parent / "people.npz", "--view", scene.parent / "c0.toml", *words)
    assert status == 0 and "where the recordings have theirs" in out and "--place" in out
    status, out, _ = run("learn", scene.parent / "people.npz", "--view", "door", "--place", "0,1", *words)
    assert status == 2


def test_a_model_of_several_facings_has_a_place_only_and_grows_where_it_is(people, scene):
    archive, view = perform(("1", "2"), ("ok", "shake", "lunging"), trials=1), View("room", camera(0.0))
    few = MotionArchive(PARTS, tuple(r for r in archive.recordings if r.label != "lunging"))
    parameters = {"facings": 4.0, "kernels": 84.0}
    model = learn_view(
        few, view, Vocabulary(("ok", "shake")), parameters=parameters, calibrate=False, placement=STANDING
    )
    assert model.header.placement == replace(STANDING, facing_deg=0.0)
    assert add_movements(model, archive, view).model.header.placement == model.header.placement
    with rejected("--place", "[0.00, 1.60, 0.00]", "[0.40, 1.50, 1.30]"):
        add_movements(model, archive, view, placement=PersonPlacement())


def test_evaluate_puts_everybody_at_the_place(run, scene):
    folder, words = scene.parent, ("--model", "phase", "--uncalibrated", "--jobs", "1")
    views = ("--views", f"{folder}/c0.toml,{folder}/c90.toml", "--place", "0.4,1.5,1.3")
    status, out, _ = run("evaluate", folder / "people.npz", *views, "--facing", "30", *words)
    assert status == 0 and "c90" in out
    status, _, err = run("evaluate", folder / "people.npz", "--views", "door", "--place", "0.4,1.3", *words)
    assert status == 2 and "door" in err and "camera files" in err
