"""The assignment of a few rows to a few columns at the least total cost. Pure."""

from collections.abc import Sequence


def best_matching(costs: Sequence[Sequence[float]], alone: float) -> tuple[float, dict[int, int]]:
    """The least total cost, and row -> column of its matching, where a row without a column costs `alone`.

    costs: (R, C); there are at most four of each, so that all matchings can be tried.
    """

    def best(row: int, free: frozenset[int]) -> tuple[float, tuple[tuple[int, int], ...]]:
        if row == len(costs):
            return 0.0, ()
        total, pairs = best(row + 1, free)
        result = total + alone, pairs
        for column in sorted(free):
            if costs[row][column] < alone:
                total, pairs = best(row + 1, free - {column})
                if total + costs[row][column] < result[0]:
                    result = total + costs[row][column], ((row, column), *pairs)
        return result

    total, pairs = best(0, frozenset(range(len(costs[0]) if costs else 0)))
    return total, dict(pairs)
