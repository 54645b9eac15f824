"""Cells that pieces of a view may show."""

from functools import partial

import numpy as np
import pytest

from fexel.filters import fipmap, ripmap
from fexel.filters.chain_wants import cells_wanted

ANY = [np.full((2, 2), value) for value in (np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e-300, 1e-320, 9.99e8)]
ANY += [np.array([[np.nan, 1.0], [0.0, np.inf]]), np.diag([1e9, 1e-9]), np.diag([1e-200, 3.0])]


@pytest.mark.parametrize(
    "choose",
    [ripmap.choose, fipmap.choose, partial(fipmap.choose, probes=16)],
    ids=["ripmap", "fipmap", "fipmap of 16 accesses"],
)
def test_any_derivatives_want_cells_without_a_floating_point_error(choose):
    with np.errstate(all="raise"):
        wants = cells_wanted(np.array(ANY)[:, None], [choose])
    assert set(wants.piece) == set(range(len(ANY)))
    assert (wants.finest <= wants.coarsest).all()
    assert (wants.finest >= 0).all() and (wants.coarsest < 64).all()
    lost = [wants.coarsest[wants.piece == piece].max() for piece in (0, 1, 2, 4, 5)]
    assert min(lost) >= 28  # the whole image, however large: 1e9 texels in a pixel


def test_pieces_next_to_one_that_is_lost_want_what_they_would_alone():
    seen = np.diag([9.0, 1.5])[None, None]
    alone = cells_wanted(seen, [fipmap.choose])
    beside = cells_wanted(np.concatenate([seen, np.full((1, 1, 2, 2), np.nan)]), [fipmap.choose])
    own = beside.piece == 0
    for name in ("direction", "octaves", "finest", "coarsest"):
        assert (getattr(beside, name)[own] == getattr(alone, name)).all()
