"""The pose model in mediapipe's wheel as a `PersonModel`: its detector, and its landmarks at a given place.

`mediapipe.solutions` joins the two in one graph that looks for one person and keeps to its own region. Here they are
two graphs, so that the place of the followed person is ours; for one person both give the same landmarks.
"""

import atexit
import math
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from common.tflite import without_outline
from observer.tracking.people import REGION, Body, Pose, Rgb, SearchArea

DETECTOR_GRAPH = """
input_stream: "image"
node {
  calculator: "PoseDetectionCpu"
  input_stream: "IMAGE:image"
  output_stream: "DETECTIONS:detections"
}
"""
LANDMARKS_GRAPH = """
input_stream: "image"
input_stream: "region"
node {
  calculator: "ImagePropertiesCalculator"
  input_stream: "IMAGE_CPU:image"
  output_stream: "SIZE:size"
}
node {
  calculator: "PoseLandmarkByRoiCpu"
  input_stream: "IMAGE:image"
  input_stream: "ROI:region"
  output_stream: "LANDMARKS:raw"
  output_stream: "AUXILIARY_LANDMARKS:raw_auxiliary"
  output_stream: "WORLD_LANDMARKS:raw_world"
}
node {
  calculator: "PoseLandmarkFiltering"
  input_stream: "IMAGE_SIZE:size"
  input_stream: "NORM_LANDMARKS:raw"
  input_stream: "AUX_NORM_LANDMARKS:raw_auxiliary"
  input_stream: "WORLD_LANDMARKS:raw_world"
  output_stream: "FILTERED_NORM_LANDMARKS:landmarks"
  output_stream: "FILTERED_AUX_NORM_LANDMARKS:auxiliary"
  output_stream: "FILTERED_WORLD_LANDMARKS:world"
}
node {
  calculator: "PoseLandmarksToRoi"
  input_stream: "LANDMARKS:auxiliary"
  input_stream: "IMAGE_SIZE:size"
  output_stream: "ROI:next_region"
}
"""
MODEL_FOLDERS = ("mediapipe/modules/pose_detection", "mediapipe/modules/pose_landmark")
"""Folders of the models that the graphs name."""
PERIOD_US = 33_333
"""Time between two pictures for the model's smoothing, as in `mediapipe.solutions`."""


class GraphPeople:
    """A `PersonModel`. Detections: the middle between the hips, and a point on the circle around the body.

    smooth: the landmarks are those that the graph has smoothed over time, by which they lag by about a picture.
    """

    def __init__(self, smooth: bool = True) -> None:
        util = import_module("mediapipe.python._framework_bindings.resource_util")
        util.set_resource_dir(str(_light_models(Path(import_module("mediapipe").__file__ or "").parents[1])))
        self._create = import_module("mediapipe.python.packet_creator")
        self._get = import_module("mediapipe.python.packet_getter")
        self._rgb = import_module("mediapipe.python._framework_bindings.image_frame").ImageFormat.SRGB
        self._rectangle = import_module("mediapipe.framework.formats.rect_pb2").NormalizedRect
        self._detector = _Graph(DETECTOR_GRAPH, ("detections",))
        self._stream = "landmarks" if smooth else "raw"
        self._landmarks = _Graph(LANDMARKS_GRAPH, (self._stream, "next_region"))

    def find(self, rgb: Rgb, area: SearchArea, ms: int) -> Sequence[Body]:
        """As `PersonModel.find`; `ms` is ignored."""
        outputs = self._detector.run(image=self._image(area.cut(rgb)))
        if "detections" not in outputs:
            return []
        detections = self._get.get_proto_list(outputs["detections"])
        return [_body_of(each, area) for each in sorted(detections, key=lambda each: -each.score[0])]

    def pose(self, rgb: Rgb, body: Body, ms: int) -> Pose | None:
        """As `PersonModel.pose`; `ms` is ignored: the smoothing assumes 30 pictures a second."""
        height, width = rgb.shape[:2]
        outputs = self._landmarks.run(image=self._image(rgb), region=self._region(body, width, height))
        if self._stream not in outputs or "next_region" not in outputs:
            return None
        marks = self._get.get_proto(outputs[self._stream]).landmark
        landmarks = np.array([[mark.x, mark.y, mark.visibility] for mark in marks], dtype=np.float64)
        rect = self._get.get_proto(outputs["next_region"])
        tall = rect.height * height / REGION
        return Pose(landmarks, Body(rect.x_center * width, rect.y_center * height, tall, rect.rotation))

    def restart(self) -> None:
        """As `PersonModel.restart`: a picture without a region resets the smoothing."""
        self._landmarks.add(image=self._image(np.zeros((8, 8, 3), np.uint8)))

    def close(self) -> None:
        """As `PersonModel.close`."""
        self._detector.close()
        self._landmarks.close()

    def _image(self, rgb: Rgb) -> Any:  # noqa: ANN401 - mediapipe has no types
        return self._create.create_image_frame(image_format=self._rgb, data=rgb)

    def _region(self, body: Body, width: int, height: int) -> Any:  # noqa: ANN401 - mediapipe has no types
        side = body.height * REGION
        rectangle = self._rectangle(
            x_center=body.u / width,
            y_center=body.v / height,
            width=side / width,
            height=side / height,
            rotation=body.turn,
        )
        return self._create.create_proto(rectangle)


@cache
def _light_models(root: Path) -> Path:
    """A folder for this process with the models in the wheel at `root`, which draw no outline of the person; `root`
    where none can be made. The landmarks are the same, at three fifths of the processor time."""
    try:
        scratch = tempfile.TemporaryDirectory(prefix="labanmesh-")
        atexit.register(scratch.cleanup)
        for file in (file for folder in MODEL_FOLDERS for file in (root / folder).glob("*.tflite")):
            light = Path(scratch.name) / file.relative_to(root)
            light.parent.mkdir(parents=True, exist_ok=True)
            light.write_bytes(without_outline(file.read_bytes()))
    except OSError:
        return root
    return Path(scratch.name)


class _Graph:
    """One running graph of mediapipe's calculators, and its newest outputs."""

    def __init__(self, text: str, outputs: Sequence[str]) -> None:
        config = import_module("mediapipe.framework.calculator_pb2").CalculatorGraphConfig()
        import_module("google.protobuf.text_format").Parse(text, config)
        graphs = import_module("mediapipe.python._framework_bindings.calculator_graph")
        self._graph = graphs.CalculatorGraph(graph_config=config)
        self._outputs: dict[str, Any] = {}
        for name in outputs:
            self._graph.observe_output_stream(name, self._outputs.__setitem__)
        self._graph.start_run({})
        self._us = 0

    def run(self, **packets: Any) -> Mapping[str, Any]:  # noqa: ANN401 - mediapipe has no types
        """Outputs by name, of one packet for each input; an output that the graph does not give is left out."""
        self._graph.wait_until_idle()
        self._outputs.clear()
        self.add(**packets)
        self._graph.wait_until_idle()
        return self._outputs

    def add(self, **packets: Any) -> None:  # noqa: ANN401 - mediapipe has no types
        """Add inputs of one time and do not wait; an input that is left out will be missing at this time."""
        self._us += PERIOD_US
        for name, packet in packets.items():
            self._graph.add_packet_to_input_stream(stream=name, packet=packet.at(self._us))

    def close(self) -> None:
        self._graph.close()


def _body_of(detection: Any, area: SearchArea) -> Body:  # noqa: ANN401 - mediapipe has no types
    """Of a detection in an area; its turn is that of the line from the hips to the point on the circle above."""
    hips, above = detection.location_data.relative_keypoints[:2]
    du, dv = (above.x - hips.x) * area.width, (above.y - hips.y) * area.height
    turn = math.pi / 2 - math.atan2(-dv, du)
    turn -= 2 * math.pi * math.floor((turn + math.pi) / (2 * math.pi))
    return Body(area.left + hips.x * area.width, area.top + hips.y * area.height, 2 * math.hypot(du, dv), turn)
