"""Writes python/fluorspar/sections.py from the JSON schema of experiment files and the catalogue.

Run it with the package installed, after either has changed: python generate_sections.py. A test compares.
"""

from __future__ import annotations

import json
import keyword
import re
import sys
from pathlib import Path
from typing import Any

import fluorspar as fs

HEADER = '''"""Sections of an experiment as nested dictionaries, for editors and type checkers, and the names of the catalogue.

``e: fs.sections.Experiment = {"format": 1, "base": "oraleye-2021", "render": {"samples_per_pixel": 4}}``; :func:`fluorspar.experiment`
takes it. Which fields are needed, and which go together, depends on the base and is checked there. Written by generate_sections.py.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, TypedDict
'''

WIDTH = 132


def words_of(name: str) -> str:
    """A name in camel case."""
    return "".join(word[:1].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", name))


def doc(text: str, indent: str) -> str:
    """A docstring in lines of limited length."""
    text = " ".join(text.split()).replace("\\", "\\\\").replace('"""', "'''")
    text = text + " " if text.endswith('"') else text
    lines, line = [], f'{indent}"""'
    for word in text.split():
        if len(line) + len(word) + 5 > WIDTH and line.strip() != '"""':
            lines.append(line.rstrip())
            line = indent
        line += word + " "
    closing = ' """' if text.endswith('" ') else '"""'
    return "\n".join([*lines, line.rstrip() + closing])


class Types:
    """The types that a schema describes, as lines of Python."""

    def __init__(self, schema: dict[str, Any]) -> None:
        self.definitions = schema["$defs"]
        self.classes: dict[str, str] = {}
        self.aliases: dict[str, str] = {}

    def type_of(self, value: Any, inside: str) -> str:
        """The type of a value; classes that it needs are made, named after where they stand."""
        if "$ref" in value:
            return self.definition(value["$ref"].rsplit("/", 1)[1])
        if "const" in value:
            return f"Literal[{value['const']!r}]"
        if "enum" in value:
            return f"Literal[{', '.join(map(repr, value['enum']))}]"
        kind = value.get("type")
        if kind == "object" or "properties" in value:
            return self.table(value, inside)
        choices = value.get("anyOf") or value.get("oneOf")
        if choices:
            return self.union([self.type_of(choice, inside + self.suffix(choice)) for choice in choices])
        if isinstance(kind, list):
            return self.union([self.type_of({**value, "type": one}, inside) for one in kind if one != "null"])
        if kind == "array":
            return f"list[{self.type_of(value.get('items', {}), inside + 'Item')}]"
        plain = {"string": "str", "number": "float", "integer": "int", "boolean": "bool", "null": "None"}
        return plain[kind] if kind else "object"

    @staticmethod
    def union(types: list[str]) -> str:
        """One of some types, each named once."""
        kinds = [kind for kind in dict.fromkeys(types) if kind != "None"]
        literals = [kind[8:-1] for kind in kinds if kind.startswith("Literal[")]
        others = [kind for kind in kinds if not kind.startswith("Literal[")]
        return " | ".join([*others, *([f"Literal[{', '.join(literals)}]"] if literals else [])])

    @staticmethod
    def suffix(value: dict[str, Any]) -> str:
        """What tells one table of a choice from the others: its tag, or its required fields."""
        fields = value.get("properties", {})
        tags = [str(field["const"]) for field in fields.values() if "const" in field]
        return "".join(words_of(name) for name in (tags or value.get("required", []) or list(fields))[:2])

    def definition(self, name: str) -> str:
        """The type of a definition by its name."""
        if name in self.classes or name in self.aliases:
            return name
        value = self.definitions[name]
        if value.get("type") == "object" and any("properties" in part for part in [value, *value.get("oneOf", [])]):
            return self.table(value, name)
        self.aliases[name] = ""
        self.aliases[name] = self.type_of(value, name)
        return name

    def table(self, value: dict[str, Any], name: str) -> str:
        """A table: a class, or a dictionary where the keys are names of the user."""
        variants = [choice for choice in value.get("oneOf", []) if "properties" in choice]
        if "properties" not in value and not variants:
            inner = value.get("additionalProperties", {})
            return f"dict[str, {self.type_of(inner if isinstance(inner, dict) else {}, name + 'Value')}]"
        if name in self.classes:
            return name
        self.classes[name] = ""
        fields: dict[str, list[Any]] = {}
        for part in [value, *variants]:
            for field, inner in part.get("properties", {}).items():
                fields.setdefault(field, []).append(inner)
        if any(keyword.iskeyword(field) for field in fields):
            # The class syntax has no such fields
            pairs = [
                f"        {field!r}: \"{self.union([self.type_of(inner, name + words_of(field)) for inner in values])}\","
                for field, values in fields.items()
            ]
            self.classes[name] = "\n".join([f'{name} = TypedDict(', f'    "{name}",', "    {", *pairs, "    },", "    total=False,", ")"])
            return name
        lines = []
        for field, values in fields.items():
            kind = self.union([self.type_of(inner, name + words_of(field)) for inner in values])
            lines.append(f"    {field}: {kind}")
            if text := values[0].get("description", ""):
                lines.append(doc(text, "    "))
        text = doc(value.get("description", "A table."), "    ")
        self.classes[name] = "\n".join([f"class {name}(TypedDict, total=False):", text, "", *(lines or ["    pass"])])
        return name


def experiment_of(schema: dict[str, Any], types: Types) -> None:
    """The whole experiment; lists of named entries may be dictionaries by name."""
    lines = []
    for field, value in schema["properties"].items():
        kind = types.type_of(value, words_of(field))
        if value.get("type") == "array" and kind.startswith("list["):
            kind += f" | dict[str, {kind[5:-1]}]"
        lines += [f"    {field}: {kind}", doc(value.get("description", ""), "    ")]
    text = doc(schema["description"] + " Lists of what has names may be dictionaries by name.", "    ")
    types.classes["Experiment"] = "\n".join(["class Experiment(TypedDict, total=False):", text, "", *lines])


def names() -> list[str]:
    """Names of the catalogue by kind."""
    by_kind: dict[str, list[str]] = {}
    for entry in fs.catalog():
        by_kind.setdefault(words_of(entry["kind"]) + "Name", []).append(entry["name"])
    by_kind["TissueName"] = [entry["name"] for entry in fs.command("catalog", "list", "tissue")]
    by_kind["LensName"] = [entry["name"] for entry in fs.command("catalog", "list", "lens")]
    lines = []
    for kind, known in sorted(by_kind.items()):
        lines += [f"{kind}: TypeAlias = Literal[", *(f"    {name!r}," for name in sorted(known)), "]", ""]
    return lines


def text() -> str:
    """The module."""
    schema = json.loads(fs.schema())
    types = Types(schema)
    experiment_of(schema, types)
    body = [HEADER, *names()]
    for name, kind in types.aliases.items():
        body += [f"{name}: TypeAlias = \"{kind}\"", doc(types.definitions[name].get("description", ""), ""), ""]
    for lines in types.classes.values():
        body += ["", lines, ""]
    return "\n".join(body).rstrip() + "\n"


if __name__ == "__main__":
    place = Path(__file__).parent / "python/fluorspar/sections.py"
    if "--check" in sys.argv:
        sys.exit(0 if place.read_text() == text() else f"{place} is not what generate_sections.py writes")
    place.write_text(text())
