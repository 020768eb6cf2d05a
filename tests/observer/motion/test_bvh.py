"""BVH: forward kinematics by hand, and the archive's axes, units and names."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from common.errors import BadInput
from observer.motion.importers.bvh import import_files
from observer.motion.importers.bvh_file import BvhMotion, Joint, joint_positions, read_bvh

ARM = """HIERARCHY
ROOT Hips
{
  OFFSET 0 1 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Arm
  {
    OFFSET 2 0 0
    CHANNELS 3 Zrotation Yrotation Xrotation
    End Site
    {
      OFFSET 0 3 0
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.04
0 0 0 0 0 0 0 0 0
10 0 0 90 0 0 0 0 0
0 0 0 0 0 90 90 0 90
"""

BODY = {
    "Hips": (0, 1, 0),
    "LeftUpLeg": (-0.1, 1, 0),
    "LeftFoot": (-0.1, 0.1, 0),
    "LeftToeBase": (-0.1, 0.1, -0.2),
    "RightUpLeg": (0.1, 1, 0),
    "RightFoot": (0.1, 0.1, 0),
    "RightToeBase": (0.1, 0.1, -0.2),
    "LeftHand": (-0.4, 0.9, 0),
    "RightHand": (0.3, 1.4, -0.6),
    "Head": (0, 1.7, 0),
}
"""A standing person in the archive's axes, the right hand stretched out to the front."""
PARTS = {"left_hand": "LeftHand", "right_hand": "RightHand", "head": "Head", "pelvis": "Hips", "left_hip": "LeftUpLeg",
         "right_hip": "RightUpLeg", "left_foot": "LeftFoot", "right_foot": "RightFoot"}  # fmt: skip
TRUTH = np.array([BODY[joint] for joint in PARTS.values()])
AHEAD = np.array([0, 0, -1])


def body_text(to_file=None, scale=1.0, rename=lambda name: name):
    """A two-frame BVH file of BODY, in axes `to_file` (3, 3) and units of 1/scale metres; in frame 1 a step ahead."""
    to_file = np.eye(3) if to_file is None else to_file

    def row(place):
        return " ".join(f"{number:.9f}" for number in scale * (to_file @ np.asarray(place, float)))

    hips = np.array(BODY["Hips"])
    lines = ["HIERARCHY", f"ROOT {rename('Hips')}", "{", f"OFFSET {row(hips)}"]
    lines.append("CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation")
    for name, place in list(BODY.items())[1:]:
        lines += [f"JOINT {rename(name)}", "{", f"OFFSET {row(place - hips)}", "CHANNELS 0", "}"]
    lines += ["}", "MOTION", "Frames: 2", "Frame Time: 0.0333333", f"{row((0, 0, 0))} 0 0 0", f"{row(AHEAD)} 0 0 0"]
    return "\n".join(lines) + "\n"


def imported(tmp_path, text, name="Walk Home.bvh"):
    (tmp_path / name).write_text(text)
    result = import_files(tmp_path)
    (recording,) = result.archive.recordings
    assert result.archive.body_parts == tuple(PARTS)
    return recording, result.notes


def test_forward_kinematics_by_hand(tmp_path):
    path = tmp_path / "arm.bvh"
    path.write_text(ARM)
    motion = read_bvh(path)
    assert [joint.name for joint in motion.joints] == ["Hips", "Arm", ""]
    assert [joint.parent for joint in motion.joints] == [-1, 0, 1]
    assert motion.frame_time == 0.04
    places = joint_positions(motion)
    np.testing.assert_allclose(places[0], [[0, 1, 0], [2, 1, 0], [2, 4, 0]], atol=1e-12)
    # A quarter about z turns x to y and y to -x.
    np.testing.assert_allclose(places[1], [[10, 1, 0], [10, 3, 0], [7, 3, 0]], atol=1e-12)
    # The hips' quarter about y turns x to -z and z to x; in the arm Rz Rx takes y first to z, which Rz leaves.
    np.testing.assert_allclose(places[2], [[0, 1, 0], [0, 1, -2], [3, 1, -2]], atol=1e-12)


angles = st.floats(-360, 360)


@settings(max_examples=30)
@given(order=st.permutations("xyz"), turns=st.lists(st.tuples(angles, angles, angles), min_size=1, max_size=3))
def test_rotations_agree_with_scipy_in_every_order(order, turns):
    channels = tuple(f"{axis}rotation" for axis in order)
    joints = (Joint("a", -1, np.zeros(3), channels), Joint("b", 0, np.array([1.0, 2.0, 3.0]), ()))
    places = joint_positions(BvhMotion(joints, np.array(turns), 0.1))
    for place, turn in zip(places[:, 1], turns, strict=True):
        expected = Rotation.from_euler("".join(order).upper(), turn, degrees=True).apply([1, 2, 3])
        np.testing.assert_allclose(place, expected, atol=1e-9)


def test_position_channels_replace_the_offset_of_a_joint():
    joints = (Joint("a", -1, np.ones(3), ()), Joint("b", 0, np.array([1.0, 2, 3]), ("zposition",)))
    places = joint_positions(BvhMotion(joints, np.array([[7.0]]), 0.1))
    np.testing.assert_array_equal(places[0], [[1, 1, 1], [2, 3, 8]])


@settings(max_examples=20)
@given(yaw=st.floats(0, 360), up=st.sampled_from(["y", "z", "-y"]))
def test_the_performer_faces_minus_z_whatever_the_axes_of_the_file(yaw, up, tmp_path_factory):
    about_up = Rotation.from_euler("y", yaw, degrees=True)
    lift = {"y": Rotation.identity(), "z": Rotation.from_euler("x", 90, degrees=True),
            "-y": Rotation.from_euler("x", 180, degrees=True)}[up]  # fmt: skip
    recording, notes = imported(tmp_path_factory.mktemp("bvh"), body_text((lift * about_up).as_matrix()))
    np.testing.assert_allclose(recording.positions[0], TRUTH, atol=1e-5)
    np.testing.assert_allclose(recording.positions[1], TRUTH + AHEAD, atol=1e-5)
    assert any("as up" in note for note in notes) == (up != "y")
    assert not any("mirrored" in note for note in notes)


def test_a_mirrored_file_is_corrected(tmp_path):
    recording, notes = imported(tmp_path, body_text(np.diag([1.0, 1.0, -1.0])))
    np.testing.assert_allclose(recording.positions[0], TRUTH, atol=1e-5)
    assert any("mirrored" in note for note in notes)


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "metres"), (100.0, "centimetres"), (1000.0, "millimetres")])
def test_the_unit_comes_from_the_size(scale, unit, tmp_path):
    recording, notes = imported(tmp_path, body_text(scale=scale))
    np.testing.assert_allclose(recording.positions[0], TRUTH, atol=1e-5)
    assert notes == (f"BVH states no unit: took {unit} (1 of 1 files)",)


def test_an_implausible_size_is_noted(tmp_path):
    assert "7.2 m tall" in imported(tmp_path, body_text(scale=4.5))[1][0]


NAMES = {
    "mixamo": lambda name: f"mixamorig:{name}",
    "blender": lambda name: f"{name[4:]}.L" if name[:4] == "Left" else f"{name[5:]}.R" if name[:5] == "Right" else name,
    "max": lambda name: "Bip01 " + name.replace("Left", "L ").replace("Right", "R ").replace("UpLeg", "Thigh"),
    "wrists": lambda name: name.replace("Hand", "Wrist").replace("UpLeg", "Hip").upper(),
    "short": lambda name: name.replace("Left", "l").replace("Right", "r").replace("UpLeg", "Thigh").lower(),
}


@pytest.mark.parametrize("maker", NAMES)
def test_joint_names_of_several_programs(maker, tmp_path):
    recording, _ = imported(tmp_path, body_text(rename=NAMES[maker]))
    np.testing.assert_allclose(recording.positions[0], TRUTH, atol=1e-5)


def test_label_trial_and_rate(tmp_path):
    recording, _ = imported(tmp_path, body_text())
    assert (recording.label, recording.subject, recording.trial, recording.rate_hz) == ("walk_home", "1", "1", 30.0)
    (tmp_path / "Walk Home.bvh").unlink()
    recording, _ = imported(tmp_path, body_text(), "Pointing_-1_0_1_-1.BVH")
    assert (recording.label, recording.trial) == ("pointing", "-1_0_1_-1")
    (tmp_path / "Pointing_-1_0_1_-1.BVH").unlink()
    assert imported(tmp_path, body_text(), "walk_1_2_3_4.bvh")[0].label == "walk_1_2_3_4"


def test_windows_line_endings_and_other_letter_case(tmp_path):
    text = body_text().replace("\n", "\r\n").replace("OFFSET", "offset").replace("Frame Time:", "FRAME TIME :")
    np.testing.assert_allclose(imported(tmp_path, text)[0].positions[0], TRUTH, atol=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("HIERARCHY", "HIRARCHY", "line 1: 'HIRARCHY': HIERARCHY is expected"),
        ("ROOT", "JOINT", "line 2: 'JOINT': ROOT"),
        ("  OFFSET 0 1 0", "  OFFSET 0 one 0", "line 4: 'one': a finite number"),
        ("OFFSET 2 0 0", "SCALE 2 0 0", "line 8: 'SCALE'"),
        ("CHANNELS 6", "CHANNELS six", "line 5: CHANNELS: 'six'"),
        ("CHANNELS 6", "CHANNELS 60", "line 5: 60 channels"),
        ("Yposition", "Wposition", "line 5: 'Wposition'"),
        ("Yposition", "Xposition", "line 5: 'Xposition'"),
        ("}\nMOTION", "MOTION", "ends before its braces are closed"),
        ("}\nMOTION", "}\nROOT Two\n{\n}\nMOTION", "line 16: 'ROOT': MOTION"),
        ("ROOT Hips\n{", "ROOT Hips\n", "line 4: 'OFFSET': {"),
        ("MOTION", "", "no MOTION section"),
        ("Frames: 3", "Frames: three", "line 17: Frames: 'three'"),
        ("Frames: 3", "Frames: 0", "line 17: 0 frames"),
        ("Frames: 3", "Frames: 4", "3 frames; 4 expected, as line 17 says"),
        ("Frames: 3\n", "", "line 17: 'Frames: N'"),
        ("Frame Time: 0.04", "Frame Time: 0", "positive time"),
        ("Frame Time: 0.04", "Frame Time: nan", "line 18: Frame Time: 'nan'"),
        ("10 0 0 90 0 0 0 0 0", "10 0 0 90 0 0 0 0", "line 20: 8 values; 9"),
        ("10 0 0 90 0 0 0 0 0", "10 0 0 90 0 x 0 0 0", "line 20: 'x'"),
        ("90 0 90\n", "90 0", "line 21: 8 values"),
        ("HIERARCHY", "HIERARCHY", "no joint for the left hand.*there are: Hips, Arm"),
    ],
)
def test_a_defect_is_named_with_its_line(old, new, words, tmp_path):
    assert old in ARM
    path = tmp_path / "arm.bvh"
    path.write_text(ARM.replace(old, new, 1))
    with pytest.raises(BadInput, match=words) as caught:
        import_files(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_missing_joints_and_a_file_name_without_letters(tmp_path):
    with pytest.raises(BadInput, match="no pair of hips or shoulders"):
        imported(tmp_path, body_text(rename=lambda name: name.replace("UpLeg", "Thing")))
    with pytest.raises(BadInput, match="no joint for the head"):
        imported(tmp_path, body_text(rename=lambda name: name.replace("Head", "Hat")))
    (tmp_path / "Walk Home.bvh").unlink()
    with pytest.raises(BadInput, match="its name must contain the movement"):
        imported(tmp_path, body_text(), "---.bvh")
