"""[people] of a scene file: how many people are judged apart, and their names. Pure."""

from typing import Annotated

from pydantic import Field, model_validator

from common.config_sections import Section
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
