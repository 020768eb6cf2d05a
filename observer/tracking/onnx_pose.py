"""A pose model in an ONNX file of the user's as a tracker: RTMPose, MoveNet and YOLO-pose, told by their shapes.

OpenCV runs it, or onnxruntime where that is installed. All three find the 17 keypoints of COCO (Lin et al., Microsoft
COCO, 2014), which take their places among the landmarks of BlazePose. Nothing is downloaded.
"""

import importlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracking.cropped_pose import CroppedPeople
from observer.tracking.onnx_file import EXPECTED, Signature, read_signature
from observer.tracking.people import FollowRule
from observer.tracking.person_follower import PersonFollower
from observer.tracking.pose import LANDMARKS, Hand, PoseTracker, require_hand, stderr_silenced
from observer.tracks import BODY_PARTS, Floats

log = logging.getLogger("labanmesh.observer")

Array = NDArray[Any]
Run = Callable[[Array], list[Array]]
"""From the input, a picture as the model wants it, to the outputs in the order of the file."""
LAYOUTS = (
    "known are RTMPose (1x3xHxW to 1x17xX and 1x17xY), MoveNet (1xHxWx3 to 1x1x17x3) and YOLO-pose (1x3xHxW to 1x56xN)"
)
KEYPOINTS = 17
COCO = {
    0: (0, 9, 10), 1: (1, 2, 3), 2: (4, 5, 6), 3: (7,), 4: (8,), 5: (11,), 6: (12,), 7: (13,), 8: (14,), 9: (15,),
    10: (16,), 11: (23,), 12: (24,), 13: (25,), 14: (26,), 15: (27, 29, 31), 16: (28, 30, 32),
}  # fmt: skip
"""Keypoint of COCO -> the landmarks of BlazePose that it stands for: mouth by the nose, heel and toes by the ankle."""
KNUCKLES = {7: (9, (17, 19, 21)), 8: (10, (18, 20, 22))}
"""Elbow -> wrist, and the landmarks of the hand, which lie beyond it."""
BEYOND = 0.3
"""Of the forearm: knuckles beyond the wrist, as MediaPipe finds them (wave_webcam, pose2sim_single: .27 to .32)."""
LEAST_KEYPOINTS, LEAST_SCORE = 4, 0.5
"""There is a person where so many keypoints have this visibility."""
LEAST_BOX, OVERLAP = 0.25, 0.6
"""Confidence of a box from which there may be a person; boxes that overlap more show the same one."""
FREE = {"channels first": (640, 640), "two outputs": (192, 256), "channels last": (256, 256)}
"""Width and height of the input where the file leaves them open."""


@dataclass(frozen=True, slots=True)
class SimCC:
    """RTMPose (Jiang et al. 2023): for each keypoint a curve over x and one over y, `split` values a pixel."""

    split: tuple[float, float]
    usual: float = 0.3

    def picture(self, rgb: NDArray[np.uint8]) -> Array:
        """Standardised with ImageNet's mean and deviation, channels first."""
        mean, deviation = np.array([123.675, 116.28, 103.53]), np.array([58.395, 57.12, 57.375])
        scaled = ((rgb - mean) / deviation).astype(np.float32)
        return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])

    def people(self, outputs: Sequence[Array]) -> list[Floats]:
        """The highest values; the confidence is the lower one."""
        x, y = (output[0, :KEYPOINTS] for output in outputs)
        sure = np.minimum(x.max(axis=1), y.max(axis=1))
        return [np.stack([x.argmax(axis=1) / self.split[0], y.argmax(axis=1) / self.split[1], sure], axis=1)]


@dataclass(frozen=True, slots=True)
class MoveNet:
    """MoveNet of one person: rows of y, x as shares of the input, and a confidence."""

    size: tuple[int, int]
    kind: str
    usual: float = 0.3

    def picture(self, rgb: NDArray[np.uint8]) -> Array:
        """Bytes 0 to 255, channels last, in the type that the file wants."""
        return rgb[None].astype(self.kind or "float32")

    def people(self, outputs: Sequence[Array]) -> list[Floats]:
        """The person found: (17, 3) x, y in pixels, and confidence."""
        rows: Floats = outputs[0].reshape(KEYPOINTS, 3).astype(np.float64)
        return [rows[:, [1, 0, 2]] * (*self.size, 1.0)]


@dataclass(frozen=True, slots=True)
class YoloPose:
    """YOLO-pose (Ultralytics): for each of N boxes x, y, width, height, confidence, and 17 times x, y, confidence."""

    usual: float = 0.5

    def picture(self, rgb: NDArray[np.uint8]) -> Array:
        """0 to 1, channels first."""
        return np.ascontiguousarray(rgb.transpose(2, 0, 1)[None].astype(np.float32) / 255)

    def people(self, outputs: Sequence[Array]) -> list[Floats]:
        """Of the boxes that are sure and do not overlap, by confidence times height."""
        boxes = outputs[0][0].T.astype(np.float64)
        boxes = boxes[boxes[:, 4] >= LEAST_BOX]
        corners = np.concatenate([boxes[:, :2] - boxes[:, 2:4] / 2, boxes[:, 2:4]], axis=1)
        prominence = boxes[:, 4] * boxes[:, 3]
        apart = cv2.dnn.NMSBoxes(corners.tolist(), prominence.tolist(), 0.0, OVERLAP) if len(boxes) else []
        return [boxes[n, 5:].reshape(KEYPOINTS, 3).copy() for n in apart]


Layout = SimCC | MoveNet | YoloPose
"""How a family of models reads pictures and tells keypoints. picture: (H, W, 3) RGB of the input's size -> the input.
people: the outputs -> for each person, the most prominent first, (17, 3): x and y in px of the input, confidence.
usual: the confidence from which such a model's keypoint usually counts as seen."""


class OnnxPose:
    """A `PoseModel` in an ONNX file. Raises BadInput, one line, for a file that is none or is not understood."""

    def __init__(self, model_path: str) -> None:
        path = Path(model_path)
        self._setting = f"pose_model = {model_path!r}"
        signature = read_signature(path)
        self._size, last = _input_size(signature, self._setting)
        self._run = _runner(path, signature, self._setting)
        width, height = self._size
        empty = np.zeros(
            (1, height, width, 3) if last else (1, 3, height, width), signature.inputs[0].kind or "float32"
        )
        try:
            with stderr_silenced():
                outputs = self._run(empty)
        except Exception as error:  # noqa: BLE001 - of OpenCV or onnxruntime, each of its own class
            reason = " ".join(str(error).split())[:160]
            raise BadInput(f"{self._setting}: {_engine()} cannot run it: {reason}; {_way_out()}") from None
        self._layout = _layout(signature, outputs, self._size, self._setting)

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """As `PoseModel.landmarks`; `ms` is ignored, because each picture is read by itself."""
        return next(iter(self.everybody(rgb)), None)

    def everybody(self, rgb: NDArray[np.uint8]) -> list[Floats]:
        """(H, W, 3) RGB -> the landmarks (33, 3) of each person; only YOLO-pose finds several."""
        fitted, scale, shift = _fitted(rgb, self._size)
        people = []
        for keypoints in self._layout.people(self._run(self._layout.picture(fitted))):
            keypoints[:, 2] = _visibility(keypoints[:, 2], self._layout.usual)
            if (keypoints[:, 2] >= LEAST_SCORE).sum() >= LEAST_KEYPOINTS:
                keypoints[:, :2] = (keypoints[:, :2] - shift) / (scale * np.array(rgb.shape[1::-1]))
                people.append(as_landmarks(keypoints))
        return people

    def close(self) -> None:
        """Nothing is to be released."""


class OnnxTracker(PoseTracker):
    """`PoseTracker` with a model in an ONNX file. rule: who is followed. Raises BadInput as `OnnxPose` does."""

    def __init__(
        self,
        model_path: str,
        hand: Hand = "palm",
        body_parts: Sequence[str] = BODY_PARTS,
        rule: FollowRule | None = None,
    ) -> None:
        require_hand(hand)
        people = CroppedPeople(OnnxPose(model_path))
        super().__init__(PersonFollower(people, rule, log.info), "onnx", hand, body_parts)


def as_landmarks(keypoints: Floats) -> Floats:
    """(17, 3) keypoints of COCO -> (33, 3) landmarks of BlazePose."""
    landmarks = np.zeros((LANDMARKS, 3))
    for keypoint, rows in COCO.items():
        landmarks[list(rows)] = keypoints[keypoint]
    for elbow, (wrist, rows) in KNUCKLES.items():
        landmarks[list(rows)] = keypoints[wrist]
        landmarks[list(rows), :2] += BEYOND * (keypoints[wrist, :2] - keypoints[elbow, :2])
    return landmarks


def _visibility(confidence: Floats, usual: float) -> Floats:
    """Confidences 0 to 1 -> visibilities, of which the half is what usually counts as seen."""
    sure = np.clip(confidence, 0.0, 1.0)
    return np.where(sure < usual, 0.5 * sure / usual, 0.5 + 0.5 * (sure - usual) / (1 - usual))


def _fitted(rgb: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.uint8], float, Floats]:
    """The picture in the middle of one of `size`, with its aspect ratio; the scale, and the place of its corner, px."""
    (width, height), (rows, columns) = size, rgb.shape[:2]
    scale = min(width / columns, height / rows)
    wide, high = max(round(columns * scale), 1), max(round(rows * scale), 1)
    left, top = (width - wide) // 2, (height - high) // 2
    fitted = np.zeros((height, width, 3), np.uint8)
    fitted[top : top + high, left : left + wide] = cv2.resize(rgb, (wide, high), interpolation=cv2.INTER_AREA)
    return fitted, scale, np.array([left, top], dtype=np.float64)


def _input_size(signature: Signature, setting: str) -> tuple[tuple[int, int], bool]:
    """Width and height of the input, and whether its channels are last."""
    shape = signature.inputs[0].shape
    if len(signature.inputs) != 1 or len(shape) != 4 or 3 not in (shape[1], shape[3]):
        raise BadInput(f"{setting}: {signature}: not a layout of keypoints; {LAYOUTS}")
    last = shape[1] != 3
    height, width = shape[1:3] if last else shape[2:]
    free = "channels last" if last else "two outputs" if len(signature.outputs) == 2 else "channels first"
    return (width or FREE[free][0], height or FREE[free][1]), last


def _layout(signature: Signature, outputs: Sequence[Array], size: tuple[int, int], setting: str) -> Layout:
    """By the shapes of the outputs; raises BadInput for others."""
    shapes, last = [output.shape for output in outputs], signature.inputs[0].shape[1] != 3
    if last and len(shapes) == 1 and shapes[0][-2:] == (KEYPOINTS, 3) and np.prod(shapes[0]) == 3 * KEYPOINTS:
        return MoveNet(size, signature.inputs[0].kind)
    if not last and len(shapes) == 2 and all(len(s) == 3 and s[1] >= KEYPOINTS for s in shapes):
        return SimCC((shapes[0][2] / size[0], shapes[1][2] / size[1]))
    if not last and len(shapes) == 1 and len(shapes[0]) == 3 and shapes[0][1] == 5 + 3 * KEYPOINTS:
        return YoloPose()
    layout = " and ".join("x".join(map(str, shape)) for shape in shapes)
    raise BadInput(f"{setting}: {signature}, which gives {layout}: not a layout of keypoints; {LAYOUTS}")


def _with_onnxruntime() -> bool:
    return find_spec("onnxruntime") is not None


def _engine() -> str:
    return "onnxruntime" if _with_onnxruntime() else f"OpenCV {cv2.__version__}"


def _way_out() -> str:
    return EXPECTED if _with_onnxruntime() else "onnxruntime may: pip install onnxruntime"


def _runner(path: Path, signature: Signature, setting: str) -> Run:
    try:
        with stderr_silenced():
            return _by_onnxruntime(path) if _with_onnxruntime() else _by_opencv(path, signature)
    except Exception as error:  # noqa: BLE001 - of OpenCV or onnxruntime, each of its own class
        reason = " ".join(str(error).split())[:160]
        raise BadInput(f"{setting}: {_engine()} cannot read it: {reason}; {_way_out()}") from None


def _by_onnxruntime(path: Path) -> Run:
    runtime = importlib.import_module("onnxruntime")
    options = runtime.SessionOptions()
    # An observer is one process of several on its machine.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name

    def run(picture: Array) -> list[Array]:
        outputs: list[Array] = session.run(None, {name: picture})
        return outputs

    return run


def _by_opencv(path: Path, signature: Signature) -> Run:
    net = cv2.dnn.readNetFromONNX(str(path))
    known = list(net.getUnconnectedOutLayersNames())
    # OpenCV names an output by the node that makes it, or by this and the output.
    names = [next((k for k in known if k == t.name or k.endswith(f"!{t.name}")), "") for t in signature.outputs]
    names = names if all(names) else known

    def run(picture: Array) -> list[Array]:
        net.setInput(picture.astype(np.float32))
        return [np.asarray(output) for output in net.forward(names)]

    return run
