"""The sections [people] and [watch] of a scene file: who is judged apart, and what is watched for. Pure."""

from collections.abc import Collection, Mapping
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from common.config_sections import Section
from common.errors import BadInput
from common.keys import IDENTIFIER
from common.text import plural

MOST_PEOPLE = 4
NAME_LIMIT = 32
"""Characters of a name: the id of a movement, at most 128, has it beside the scene's and a time."""


class PeopleConfig(Section):
    """[people]: most: how many people of a scene have votes and verdicts of their own; 1: one person is followed.

    names: of the people in the order in which they come; those without a name are called by their number, from "1".
    """

    most: Annotated[int, Field(ge=1, le=MOST_PEOPLE)] = 1
    names: Annotated[tuple[str, ...], Field(strict=False, examples=[["left", "right"]])] = ()

    @model_validator(mode="after")
    def _names_fit(self) -> "PeopleConfig":
        for name in self.names:
            if not IDENTIFIER.match(name) or len(name) > NAME_LIMIT:
                raise ValueError(f"names = {name!r}: 1 to {NAME_LIMIT} characters of a-z, 0-9, _ and - are allowed")
        if len(self.names) > self.most:
            raise ValueError(
                f"names = {list(self.names)}: the scene judges {plural(self.most, 'person', 'people')} "
                f"(people.most); name no more, or set people.most = {len(self.names)}"
            )
        if len(set(self.ids)) != len(self.ids):
            raise ValueError(f"names = {list(self.names)}: give each person a name of their own")
        return self

    @property
    def judged(self) -> tuple[str | None, ...]:
        """The names of the people who are judged apart; None stands for the only one."""
        return self.ids if self.most > 1 else (None,)

    @property
    def ids(self) -> tuple[str, ...]:
        """The names of all `most` people, as messages have them."""
        return tuple(self.names[n] if n < len(self.names) else str(n + 1) for n in range(self.most))


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
