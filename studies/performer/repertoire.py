"""The paper's eight movements as scores (section III.B, Tables I to III), and the four synthetic people.

Movements are invented from their names and from the paper's text; no recording of a person is in them. Reaches are
(outward, up, forward) from the shoulder in arm lengths, times are seconds of a person of tempo 1.
"""

from dataclasses import dataclass

import numpy as np

from observer.tracks import Floats
from studies.performer.body import Build, Posture, Reach, rest_vector

REST = Posture()
"""Upright, both hands where the person rests them; in a swing: no swing."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """Move to `posture` in `seconds`, beginning `overlap` seconds before the element before it ends."""

    posture: Posture
    seconds: float
    overlap: float = 0.0


@dataclass(frozen=True, slots=True)
class Hold:
    """Stay for `seconds`."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Swing:
    """Swing around the present posture, `cycles` times in `period` seconds each; a hand that is None does not swing.

    Amplitudes: `sine` and `cosine` once a cycle, `double` (a cosine) twice a cycle, which bends the path to an arc.
    """

    cycles: float
    period: float
    sine: Posture
    cosine: Posture = REST
    double: Posture = REST
    overlap: float = 0.12


Score = tuple[Stroke | Hold | Swing, ...]

# fmt: off
SCORES: dict[str, Score] = {
    # On guard, then a step with a thrust of the arm, and back.
    "lunging": (
        Stroke(Posture(right=(0.1, -0.4, 0.35), left=(0.2, -0.8, -0.1), step=-0.02, drop=0.03, lean=0.04), 0.45),
        Stroke(Posture((0.0, -0.02, 0.96), (0.4, -0.6, -0.5), step=0.42, drop=0.12, lean=0.2, twist=0.4, nod=-0.15),
               0.5, overlap=0.12),
        Hold(0.4),
        Stroke(REST, 0.95),
    ),
    # Both hands conduct before the chest, mirrored: wide left and right, and shallow ellipses to the front.
    "maestro": (
        Stroke(Posture(right=(0.06, -0.24, 0.54), left=(0.06, -0.24, 0.54), nod=0.06), 0.6),
        Swing(3.0, 0.56, sine=Posture(right=(0.22, 0.03, 0.0), left=(0.22, 0.03, 0.0), twist=0.02),
              cosine=Posture(right=(0.0, 0.05, 0.12), left=(0.0, 0.05, 0.12), nod=0.02)),
        Stroke(REST, 0.65, overlap=0.12),
    ),
    # Both hands past the chest, high and apart, the back bent a little; down again in wide arcs.
    "stretch": (
        Stroke(Posture(right=(0.02, -0.1, 0.42), left=(0.02, -0.1, 0.42)), 0.55),
        Stroke(Posture((0.38, 0.86, 0.05), (0.38, 0.86, 0.05), drop=-0.02, lean=-0.1, nod=-0.25), 0.65, overlap=0.22),
        Hold(0.4),
        Stroke(Posture((0.9, 0.1, 0.0), (0.9, 0.1, 0.0), lean=-0.04), 0.5),
        Stroke(REST, 0.6, overlap=0.25),
    ),
    # The hand up before the shoulder, shown a little, and down.
    "ok": (
        Stroke(Posture(right=(0.14, 0.1, 0.48)), 0.62),
        Hold(0.15),
        Stroke(Posture(right=(0.15, 0.13, 0.54), nod=0.05), 0.25),
        Hold(0.5),
        Stroke(REST, 0.65),
    ),
    # The arm out, forward and to the side, and down.
    "point": (Stroke(Posture(right=(0.42, 0.0, 0.86), twist=0.15, side=0.02), 0.65), Hold(0.85), Stroke(REST, 0.7)),
    # The hand up beside the head, waving left and right about the elbow.
    "byebye": (
        Stroke(Posture(right=(0.26, 0.22, 0.38)), 0.6),
        Swing(3.0, 0.46, sine=Posture(right=(0.22, 0.0, 0.0), side=0.004), double=Posture(right=(0.0, 0.03, 0.0))),
        Stroke(REST, 0.65, overlap=0.12),
    ),
    # The hand offered low and forward, shaken up and down.
    "shake": (
        Stroke(Posture(right=(-0.02, -0.32, 0.66), step=0.02, lean=0.07, twist=0.12), 0.6),
        Swing(3.0, 0.42, sine=Posture(right=(0.0, 0.13, 0.0), nod=0.015), double=Posture(right=(0.0, 0.0, 0.02))),
        Stroke(REST, 0.7, overlap=0.12),
    ),
    # The hand up as for ok, but waving to the front and back: hardly visible from the front.
    "nthrow": (
        Stroke(Posture(right=(0.16, 0.14, 0.42)), 0.6),
        Swing(3.0, 0.46, sine=Posture(right=(0.0, -0.02, 0.21), lean=0.01), double=Posture(right=(0.0, 0.03, 0.0))),
        Stroke(REST, 0.65, overlap=0.12),
    ),
}
"""The scores by label, in the order of the paper's tables."""

ORDINARY: tuple[Score, ...] = (
    # Scratches the head.
    (Stroke(Posture(right=(0.02, 0.42, 0.12), nod=0.1), 0.7), Hold(0.9), Stroke(REST, 0.7)),
    # Steps aside, and comes back.
    (Stroke(Posture(side=0.3, drop=0.01), 0.9), Hold(1.2), Stroke(REST, 0.9)),
    # Reaches down for a low table, with both hands.
    (Stroke(Posture((0.05, -0.75, 0.5), (0.05, -0.75, 0.5), drop=0.1, lean=0.5), 0.9), Hold(0.4), Stroke(REST, 0.9)),
    # The left hand to the hip.
    (Stroke(Posture(left=(0.1, -0.62, 0.05), lean=-0.03), 0.6), Hold(1.5), Stroke(REST, 0.6)),
    # Shifts the weight, and looks down.
    (Stroke(Posture(side=-0.12, nod=0.3), 0.7), Hold(0.8), Stroke(REST, 0.7)),
)
"""Ordinary life: what is none of the movements, and would be learned as something else."""
# fmt: on


@dataclass(frozen=True, slots=True)
class Person:
    """Size and habits of a synthetic person; 1.0 is average unless stated otherwise.

    height: metres. tempo: speed. amplitude: distance of postures from rest. waving: size of swings.
    sharpness: at least 1; strokes take 1/sharpness of their time, the rest is a pause. attack: above 1 strokes
    accelerate late, below 1 early. curl: share of a stroke by which the hand's height leads the other two directions
    (negative: lags), which bends its path. rest, habit: reach of both hands at rest, and an offset of every other
    reach. left_share: how much the left arm joins in. sway: idle sway. more_cycles: added to swings.
    """

    height: float
    tempo: float
    amplitude: float
    waving: float
    sharpness: float
    attack: float
    curl: float
    rest: Reach
    habit: Reach
    left_share: float
    sway: float
    more_cycles: float

    @property
    def build(self) -> Build:
        """The segment lengths."""
        return Build.of(self.height)

    @property
    def rest_posture(self) -> Floats:
        """(12,) the posture at rest."""
        return rest_vector(self.rest)

    @property
    def habits(self) -> Floats:
        """(12,) the offset of a hand's reach away from rest."""
        return np.array([*self.habit, *self.habit, *np.zeros(6)])


# fmt: off
KNOWN_PEOPLE = {
    "1": Person(height=1.72, tempo=1.0, amplitude=1.0, waving=1.0, sharpness=1.1, attack=1.0, curl=0.1,
                rest=(0.16, -0.92, 0.06), habit=(0.0, 0.0, 0.0), left_share=1.0, sway=1.0, more_cycles=0.0),
    # Small, quick and crisp; keeps the elbows in.
    "2": Person(height=1.56, tempo=1.2, amplitude=0.9, waving=0.8, sharpness=1.25, attack=0.9, curl=0.3,
                rest=(0.08, -0.88, 0.16), habit=(-0.06, 0.04, -0.03), left_share=0.75, sway=0.7, more_cycles=0.5),
    # Tall, slow and wide.
    "3": Person(height=1.94, tempo=0.83, amplitude=1.07, waving=1.25, sharpness=1.0, attack=1.15, curl=-0.2,
                rest=(0.22, -0.93, 0.0), habit=(0.08, 0.03, 0.02), left_share=1.1, sway=1.4, more_cycles=-0.5),
    # Easy-going: low hands, narrow swings, hardly the left arm.
    "4": Person(height=1.81, tempo=1.07, amplitude=0.93, waving=0.9, sharpness=1.1, attack=1.05, curl=0.0,
                rest=(0.14, -0.9, 0.1), habit=(0.04, -0.07, 0.05), left_share=0.6, sway=1.1, more_cycles=0.0),
}
"""The people by the names that archives use."""
# fmt: on
