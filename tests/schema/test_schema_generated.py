"""What is checked in is what `make schema` makes."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd

from fexel_tools import schema_generation

REPOSITORY = Path(__file__).resolve().parents[2]


pytestmark = pytest.mark.skipif(
    Usd.GetVersion() < (0, 26, 11), reason="older usd-core packages lack the schema sources that usdGenSchema reads"
)


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    return schema_generation.generated_files(tmp_path_factory.mktemp("schema"))


@pytest.mark.parametrize(
    "path", ["schemas/generatedSchema.usda", "schemas/plugInfo.json", "plugin/fexel/schema/accessors.py"]
)
def test_generated_file_is_up_to_date(generated, path):
    assert (REPOSITORY / path).read_text() == generated[Path(path)], f"{path} is stale: run `make schema`"


def test_every_generated_file_is_compared(generated):
    assert len(generated) == 3
