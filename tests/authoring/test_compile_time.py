"""What is compiled is told apart from the work itself."""

import time

import numba

from fexel_tools.compile_time import compile_time
from fexel_tools.phases import Phases


def kernel():
    """A function that is compiled when it is first called, and one inside it."""

    @numba.njit
    def inner(x):
        return x * x

    @numba.njit
    def outer(x):
        return inner(x) + inner(x + 1)

    return outer


def test_compilation_is_counted_once_and_told():
    told = []
    square = kernel()
    with compile_time(lambda *step: told.append(step)) as first:
        start = time.perf_counter()
        assert square(2.0) == 13.0
        elapsed = time.perf_counter() - start
    assert 0 < first.seconds <= elapsed
    assert told == [("compiling, once per installation", 0, 1), ("compiling, once per installation", 1, 1)]
    with compile_time() as second:
        square(3.0)
    assert second.seconds == 0.0


def test_phases_do_not_hold_the_time_of_compilation():
    phases = Phases("pinchmap", ("read", "fit", "measure"))
    square = kernel()
    with phases("read"):
        start = time.perf_counter()
        square(2.0)
        elapsed = time.perf_counter() - start
    assert list(phases.seconds) == ["read", "compile"]
    assert phases.seconds["read"] + phases.seconds["compile"] >= elapsed
    assert 0 <= phases.seconds["read"] < phases.seconds["compile"]
    with phases("measure"):
        square(3.0)
    assert phases.authoring == phases.seconds["read"]
