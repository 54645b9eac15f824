"""The weighted maximum cut: against enumeration, and by laws where that is out of reach."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from fexel_tools import two_sides as module
from fexel_tools.two_sides import cut_weight, two_sides


def _best(count, edges, weights):
    """By trying all."""
    sides = ((np.arange(1 << count)[:, None] >> np.arange(count)) & 1).astype(bool)
    return (weights * (sides[:, edges[:, 0]] != sides[:, edges[:, 1]])).sum(axis=1).max()


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 11), st.integers(1, 24), st.booleans())
def test_the_cut_of_small_graphs_is_the_best_there_is(seed, count, edge_count, signed):
    rng = np.random.default_rng(seed)
    edges = rng.integers(0, count, (edge_count, 2))
    weights = rng.normal(size=edge_count) if signed else rng.random(edge_count)
    side = two_sides(count, edges, weights)
    assert cut_weight(side, edges, weights) == pytest.approx(_best(count, edges, weights), abs=1e-9)


def test_search_finds_what_enumeration_finds(rng, monkeypatch):
    graphs = []
    for _ in range(10):
        triangles = Delaunay(rng.random((15, 2))).simplices
        edges = np.unique(np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, 1:], triangles[:, ::2]])), axis=0)
        graphs.append((edges, rng.random(len(edges))))
    exact = [cut_weight(two_sides(15, *graph), *graph) for graph in graphs]
    monkeypatch.setattr(module, "EXACT_REGIONS", 2)
    searched = [cut_weight(two_sides(15, *graph), *graph) for graph in graphs]
    assert searched == pytest.approx(exact, abs=1e-9)


def test_a_graph_of_two_colours_loses_nothing(rng):
    for count in (2, 40, 120):
        truth = rng.random(count) < 0.5
        pairs = rng.integers(0, count, (6 * count, 2))
        edges = pairs[truth[pairs[:, 0]] != truth[pairs[:, 1]]]
        weights = rng.random(len(edges)) + 0.1
        assert cut_weight(two_sides(count, edges, weights), edges, weights) == pytest.approx(weights.sum())


def test_large_planar_graphs_are_cut_well_and_the_same_every_time(rng):
    triangles = Delaunay(rng.random((250, 2))).simplices
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, 1:], triangles[:, ::2]])
    weights = rng.random(len(edges))
    side = two_sides(250, edges, weights, seed=3)
    assert np.array_equal(side, two_sides(250, edges, weights, seed=3))
    # Of every triangle at least one edge is lost; greedy cuts keep half of the weight.
    assert 0.7 < cut_weight(side, edges, weights) / weights.sum() < 1
    change = [cut_weight(side ^ (np.arange(250) == node), edges, weights) for node in range(250)]
    assert max(change) <= cut_weight(side, edges, weights) + 1e-9  # no single region would be better on the other side


def test_nothing_to_cut():
    none = np.zeros((0, 2), np.int64)
    assert two_sides(3, none, np.zeros(0)).tolist() == [False] * 3
    assert two_sides(0, none, np.zeros(0)).tolist() == []
    assert two_sides(1, np.array([[0, 0]]), np.ones(1)).tolist() == [False]
