# usd-core ships no type information: everything in it is Any to pyright, in values and in annotations.
from typing import Any

def __getattr__(name: str) -> Any: ...
