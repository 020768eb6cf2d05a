"""The parameters of movement models: their default values, and the values that they may have."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from common.errors import BadInput


@dataclass(frozen=True, slots=True)
class Parameter:
    """A model's parameter: its default, and the range of its values. Larger ones would overflow float32."""

    default: float
    low: float = 0.0
    high: float = 1e6
    whole: bool = False

    def check(self, name: str, value: float) -> None:
        """Raise BadInput, one line with the name, the value and the range, for a value outside it."""
        # NaN fails every comparison.
        if not self.low <= value <= self.high or (self.whole and value != int(value)):
            raise BadInput(f"parameter {name} = {value:g}: {self.values} is expected")

    @property
    def values(self) -> str:
        """The range, for people."""
        return f"{'a whole number' if self.whole else 'a number'} from {self.low:g} to {self.high:g}"


Positive = partial(Parameter, low=1e-6)
"""Smaller numbers would overflow where they divide."""
Probability = partial(Parameter, high=1.0)
FACINGS = Parameter(1.0, 1, 72, whole=True)
"""In how many directions a person may stand."""


def check_parameters(parameters: Mapping[str, float], known: Mapping[str, Parameter]) -> None:
    """Raise BadInput for the first parameter whose value is outside its range."""
    for name, parameter in known.items():
        parameter.check(name, parameters[name])


def facings_in(parameters: Mapping[str, float]) -> int:
    """The number of facings among the parameters, 1 by default; raises BadInput unless it is whole and from 1 to 72."""
    facings = parameters.get("facings", FACINGS.default)
    FACINGS.check("facings", facings)
    return int(facings)
