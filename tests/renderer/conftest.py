"""A renderer that is shared by the tests of this folder."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # for `scenes`


@pytest.fixture(scope="session")
def renderer(_gl_session):
    from fexel.renderer import Renderer

    with Renderer() as shared:
        yield shared
