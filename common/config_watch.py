"""The section [watch] of a scene file: what is watched for besides the movements that were learned. Pure."""

from collections.abc import Collection, Mapping
from typing import Annotated

from pydantic import AfterValidator, Field

from common.config_sections import Section
from common.errors import BadInput


def _area(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    left, top, right, bottom = value
    if not (left < right and top < bottom):
        raise ValueError("an area is left, top, right, bottom, with left < right and top < bottom")
    return value


Area = Annotated[tuple[float, float, float, float], Field(strict=False), AfterValidator(_area)]
"""left, top, right, bottom: shares of the picture; of an observer that reads tracks, in their unit."""


Areas = Annotated[tuple[Area, ...], Field(strict=False)]


class FallenConfig(Section):
    """[watch.fallen]: an alarm when somebody lies who was up before (docs/guide/fall.md).

    after_s: how long they must lie. leave_out: for each observer the areas where people usually lie, such as a bed:
    whoever has the hips there does not lie for this observer.
    """

    after_s: Annotated[float, Field(ge=0.5, le=600)] = 1.5
    leave_out: Mapping[str, Areas] = Field(default_factory=dict, examples=[{"cam1": [[0.1, 0.5, 0.4, 0.9]]}])


class WatchConfig(Section):
    """[watch]: fallen: off unless the section [watch.fallen] stands in the scene file, also if it is empty."""

    fallen: FallenConfig | None = None

    def require_observers(self, observers: Collection[str]) -> None:
        """Raises BadInput for areas of an observer that the scene does not have."""
        for name in self.fallen.leave_out if self.fallen else ():
            if name not in observers:
                raise BadInput(
                    f"watch.fallen.leave_out.{name}: not an observer of the scene; known: {', '.join(observers)}"
                )
