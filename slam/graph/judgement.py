"""The solution of a whole pose graph that has loops in doubt, worked out a piece at a time while the graph grows."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.resumable import CountedSteps
from waychair.slam.graph.edges import Edge
from waychair.slam.graph.robust_optimisation import Solution, solving
from waychair.types import FloatArray, Json


class Judgement:
    """A solution under way of the graph that was known when it began.

    `numbers` are those of its `edges` in the list of the graph, which had `known` edges then.
    A stored judgement holds what was asked and how far it has come, and does as much again before it goes on.
    """

    def __init__(self, poses: FloatArray, edges: Sequence[Edge], numbers: Sequence[int], known: int) -> None:
        self.numbers, self.known = list(numbers), known
        self._poses, self._edges = poses, list(edges)
        self._spent = 0
        self._work: CountedSteps[Solution] | None = None

    @property
    def is_of_all(self) -> bool:
        """Whether the loops that were rejected before are heard again."""
        return len(self.numbers) == self.known

    def go_on(self, most: float) -> tuple[Solution | None, int]:
        """Work until at least `most` nodes are solved; return the solution once it is found, and how many nodes were solved.

        Raises:
            GraphError: as `solving`; the judgement is then over.
        """
        behind = self._spent if self._work is None else 0
        if self._work is None:
            self._work = solving(self._poses, self._edges, solved_before=True)
        spent, found = -behind, None
        while found is None and spent < most:
            try:
                spent += next(self._work)
            except StopIteration as end:
                found = end.value
        self._spent += spent
        return found, spent

    def __getstate__(self) -> Json:
        """Return what is stored: all but the work itself."""
        return {name: value for name, value in vars(self).items() if name != "_work"}

    def __setstate__(self, state: Json) -> None:
        """Take over what was stored."""
        vars(self).update(state, _work=None)
