"""Results as dictionaries whose entries are attributes, too."""

from __future__ import annotations

import json
from typing import Any


class Record(dict[str, Any]):
    """A dictionary whose entries are attributes, too: ``record.mixture.region`` is ``record["mixture"]["region"]``."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            known = ", ".join(str(key) for key in self) or "none"
            raise AttributeError(f"there is no {name!r}; there are {known}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(key for key in self if isinstance(key, str) and key.isidentifier())]

    @classmethod
    def of_json(cls, text: str) -> Any:
        """The value of a JSON text, every object a record."""
        return json.loads(text, object_hook=cls)
