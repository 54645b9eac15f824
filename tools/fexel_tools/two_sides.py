"""Two sides for the regions of a picture, so that the strongest boundaries lie between them: weighted maximum cut.

Few region graphs can be coloured with two colours: three regions that meet in a point need three. What can be had is
the labelling whose cut boundaries weigh most. Regions with one or two neighbours are eliminated without loss (their
best side follows from their neighbours'; of a region between two others there remains an edge of weight
``max(a, b) - max(a + b, 0)``), which leaves nothing of most drawings. What is left is solved part by part: exactly by
enumeration up to `EXACT_REGIONS`, else by tabu search (Kochenberger et al., Solving large scale max cut problems via
tabu search, 2013) from the signs of the least eigenvector and from random starts.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["EXACT_REGIONS", "cut_weight", "two_sides"]

EXACT_REGIONS = 17  # 2^16 labellings at most are enumerated
_STARTS = 8
_STEPS_PER_REGION = 30

_Graph = dict[int, dict[int, float]]


def two_sides(
    count: int, edges: NDArray[np.integer], weights: NDArray[np.floating], seed: int = 0
) -> NDArray[np.bool_]:
    """The labelling of a graph's nodes whose edges between different labels weigh most.

    Parameters
    ----------
    count : int
        Nodes.
    edges : (E, 2) int
        Pairs of nodes; pairs that occur several times add up, loops do not count.
    weights : (E,) float
        Any sign, finite.
    seed : int
        Of the random starts.

    Returns
    -------
    (count,) bool
        Of the first node of each connected part: False.
    """
    graph = _adjacency(count, edges, weights)
    original = {node: dict(neighbours) for node, neighbours in graph.items()}
    order = _eliminate(graph)
    side = np.zeros(count, np.int8)  # -1, +1; 0 as long as it is open
    rng = np.random.default_rng(seed)
    for part in _parts(graph):
        side[part] = _solve(graph, part, rng)
    for node, neighbours in reversed(order):
        pull = sum(weight * side[other] for other, weight in neighbours.items())
        side[node] = -1 if pull > 0 else 1
    for part in _parts(original):
        if side[part[0]] > 0:
            side[part] *= -1
    return side > 0


def cut_weight(side: NDArray[np.bool_], edges: NDArray[np.integer], weights: NDArray[np.floating]) -> float:
    """Sum of the weights of the edges between different sides."""
    return float(weights[side[edges[:, 0]] != side[edges[:, 1]]].sum())


def _adjacency(count: int, edges: NDArray[np.integer], weights: NDArray[np.floating]) -> _Graph:
    graph: _Graph = {node: {} for node in range(count)}
    for (a, b), weight in zip(edges.tolist(), weights.tolist(), strict=True):
        if a != b:
            _add(graph, a, b, weight)
    return graph


def _add(graph: _Graph, a: int, b: int, weight: float) -> None:
    graph[a][b] = graph[a].get(b, 0.0) + weight
    graph[b][a] = graph[b].get(a, 0.0) + weight


def _eliminate(graph: _Graph) -> list[tuple[int, dict[int, float]]]:
    """Take nodes with at most two neighbours out of the graph, again and again; in the order in which they went."""
    order = []
    waiting = sorted(graph, reverse=True)
    while waiting:
        node = waiting.pop()
        if node not in graph or len(graph[node]) > 2:
            continue
        neighbours = graph.pop(node)
        for other in neighbours:
            del graph[other][node]
        if len(neighbours) == 2:
            (a, weight_a), (b, weight_b) = neighbours.items()
            _add(graph, a, b, max(weight_a, weight_b) - max(weight_a + weight_b, 0.0))
        order.append((node, neighbours))
        waiting.extend(neighbours)
    return order


def _parts(graph: _Graph) -> list[list[int]]:
    """Nodes of the connected parts, each in ascending order."""
    parts, seen = [], set()
    for start in graph:
        if start in seen:
            continue
        part, waiting = {start}, [start]
        while waiting:
            fresh = graph[waiting.pop()].keys() - part
            part |= fresh
            waiting.extend(fresh)
        seen |= part
        parts.append(sorted(part))
    return parts


def _solve(graph: _Graph, part: list[int], rng: np.random.Generator) -> NDArray[np.int8]:
    position = {node: i for i, node in enumerate(part)}
    matrix = np.zeros((len(part), len(part)))
    for node in part:
        for other, weight in graph[node].items():
            matrix[position[node], position[other]] = weight
    return _enumerate(matrix) if len(part) <= EXACT_REGIONS else _search(matrix, rng)


def _enumerate(matrix: NDArray[np.float64]) -> NDArray[np.int8]:
    """The best of all labellings; the first node's is fixed."""
    count = len(matrix)
    codes = np.arange(1 << max(count - 1, 0))
    same = np.zeros(len(codes))  # sum over edges of weight, + where the ends agree and - where they do not
    signs = np.ones((count, len(codes)), np.int8)
    for node in range(1, count):
        signs[node] = 1 - 2 * ((codes >> (node - 1)) & 1)
        for other in np.flatnonzero(matrix[node, :node]):
            same += matrix[node, other] * (signs[node] * signs[other])
    return signs[:, np.argmin(same)]


def _search(matrix: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.int8]:
    count = len(matrix)
    starts = [np.where(np.linalg.eigh(matrix)[1][:, 0] > 0, 1.0, -1.0)]
    starts += [rng.choice([-1.0, 1.0], count) for _ in range(_STARTS - 1)]
    walks = [_tabu(matrix, start, rng.integers(1, 11, _STEPS_PER_REGION * count)) for start in starts]
    return min(walks, key=lambda side: side @ matrix @ side).astype(np.int8)


@numba.njit(cache=True, nogil=True)
def _tabu(matrix: NDArray[np.float64], side: NDArray[np.float64], rest: NDArray[np.int64]) -> NDArray[np.float64]:
    """The best labelling met on a walk that always takes the best flip not forbidden for having been recent.

    `rest`: for each step, how long its node then rests, beside a tenth of the nodes.
    """
    count = len(side)
    side = side.copy()
    pull = matrix @ side
    free_at = np.zeros(count, np.int64)
    energy = least = (side * pull).sum() / 2  # less is better: the weight within sides minus that between them
    best = side.copy()
    for step in range(len(rest)):
        node, most = -1, -np.inf
        for other in range(count):
            gain = 2 * side[other] * pull[other]  # what its flip takes off the energy
            if gain > most and (
                free_at[other] <= step or energy - gain < least - 1e-9 * abs(least)
            ):  # not for rounding
                node, most = other, gain
        if node < 0:
            continue
        energy -= most
        for other in range(count):
            pull[other] -= 2 * side[node] * matrix[node, other]
        side[node] = -side[node]
        free_at[node] = step + 1 + count // 10 + rest[step]
        if energy < least:
            least = energy
            best[:] = side
    return best
