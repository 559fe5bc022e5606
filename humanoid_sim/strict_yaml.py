"""YAML from strangers: PyYAML's safe loader, without the silences and crashes that it has left."""

from __future__ import annotations

from typing import Any

import yaml

__all__ = ["UNREADABLE", "StrictLoader"]

UNREADABLE = (ValueError, OverflowError, TypeError, LookupError, AttributeError, RecursionError)
"""What PyYAML raises beside its own errors: for values that their tags do not fit, and for sizes beyond reason."""


class StrictLoader(yaml.SafeLoader):
    """Refuses a key given twice, of which YAML would silently keep the last, and text that no file or name can hold."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """A mapping whose keys differ."""
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == "tag:yaml.org,2002:merge":
                continue
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"'{key.value}' is given twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> str:
        """A text; the escapes of a quoted one can spell what is none."""
        value = str(super().construct_scalar(node))
        if "\0" in value or any("\ud800" <= character <= "\udfff" for character in value):
            message = "a text holds a null character or half of a surrogate pair"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
        return value
