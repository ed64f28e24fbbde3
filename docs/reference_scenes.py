"""Reference pages of scenes, generated from their JSON Schema, for docs/reference.py.

A page names the parts that it is about, `<!-- scene parts: SceneModel Expectation -->`, by the classes of the
schema; each becomes a table of its keys, followed by the parts that it leads to and no other page is about.
"""

from __future__ import annotations

from collections.abc import Iterator
from posixpath import dirname, relpath
from typing import Any

from dynid.scene.kind import KINDS
from dynid.scene.schema.base import SceneModel
from dynid.scene.schema.json_schema import scene_schema

Schema = dict[str, Any]

_QUANTITY = {"number", "string"}
_WORDS = {"string": "text", "integer": "integer", "number": "number", "boolean": "true or false"}


class Reference:
    """All parts of scenes, and where each is shown.

    Parameters
    ----------
    pages
        For each page the parts that it is about.
    """

    def __init__(self, pages: dict[str, list[str]]) -> None:
        self.parts = _all_parts()
        unknown = [name for names in pages.values() for name in names if name not in self.parts]
        if unknown:
            raise ValueError(f"no part of a scene is called {', '.join(unknown)}")
        self.shown = {name: page for page, names in pages.items() for name in names}
        self.headings = {name: self._root_heading(name) for name in self.shown}
        self.order = {page: list(self._spread(page, names)) for page, names in pages.items()}
        missing = self.parts.keys() - self.shown.keys()
        if missing:
            raise ValueError(f"no page shows the parts {', '.join(sorted(missing))}")

    def _root_heading(self, name: str) -> str:
        kind = next((kind for kind in KINDS if KINDS[kind].load("model").__name__ == name), "")
        if kind:
            return f"kind: {kind}"
        uses = [key for part in self.parts.values() for key, wanted in _keys(part) if name in _links(wanted)]
        return self._told_apart(name, uses[0]) if uses else "any scene"

    def _told_apart(self, name: str, path: str) -> str:
        """Return a path with what tells a part from others that may stand there."""
        told = [
            f"{key}: {w['const']}" for key, w in _keys(self.parts[name]) if isinstance(w.get("const"), str)
        ]
        return f"{path} · {told[0]}" if told else path

    def _spread(self, page: str, names: list[str]) -> Iterator[str]:
        """Yield the parts of a page, each before those that it leads to."""
        for name in names:
            yield name
            for key, wanted in _keys(self.parts[name]):
                found = [link for link in _links(wanted) if link not in self.shown]
                for link in dict.fromkeys(found):
                    self.shown[link] = page
                    above = self.headings[name].partition(" · ")[0]
                    path = key if above.startswith(("kind:", "any")) else f"{above}.{key}"
                    self.headings[link] = self._told_apart(link, path)
                yield from self._spread(page, list(dict.fromkeys(found)))

    def text(self, page: str) -> str:
        """Return the parts of a page as Markdown."""
        return "\n\n".join(self._section(name, page) for name in self.order[page])

    def _section(self, name: str, page: str) -> str:
        part = self.parts[name]
        about = part.get("description", "").replace("``", "`")
        lines = [f'<a id="{name}"></a>', "", f"## `{self.headings[name]}`", "", about, ""]
        every = {key for key, _ in _keys(self.parts["SceneModel"])} if name.endswith("Scene") else set()
        lines += ["| key | value | default | meaning |", "| --- | --- | --- | --- |"]
        for key, wanted in _keys(part):
            if key not in every:
                needed = key in part.get("required", ())
                lines.append(
                    f"| `{key}` | {self._takes(wanted, page)} | {_absent(wanted, needed)} | {_said(wanted)} |"
                )
        if every:
            there = relpath(self.shown["SceneModel"], dirname(page))
            lines += ["", f"And the keys of [any scene]({there}#SceneModel)."]
        return "\n".join(lines)

    def _takes(self, wanted: Schema, page: str) -> str:
        """Return the allowed values of a key in words."""
        if "$ref" in wanted:
            name = wanted["$ref"].rpartition("/")[2]
            there = relpath(self.shown[name], dirname(page)) if self.shown[name] != page else ""
            told = self.headings[name].rpartition(" · ")
            return f"[{told[2] if told[1] else 'mapping'}]({there}#{name})"
        for many in ("allOf", "anyOf", "oneOf"):
            if many in wanted:
                each = [self._takes(one, page) for one in wanted[many] if one.get("type") != "null"]
                return " or ".join(dict.fromkeys(each))
        if "const" in wanted:
            return f"`{wanted['const']}`"
        if "enum" in wanted:
            return ", ".join(dict.fromkeys(f"`{value}`" for value in wanted["enum"]))
        if wanted.get("type") == "array":
            counts = _counts(wanted.get("minItems", 0), wanted.get("maxItems"))
            return f"list of {counts}{self._takes(wanted.get('items', {}), page)}"
        if wanted.get("type") == "object":
            inner = wanted.get("additionalProperties")
            return f"mapping of names to {self._takes(inner if isinstance(inner, dict) else {}, page)}"
        if wanted.get("type") in ("string", "boolean"):
            return _WORDS[wanted["type"]]
        if isinstance(wanted.get("type"), list):
            exact = set(wanted["type"]) == _QUANTITY
            return f"quantity{_range(wanted)}" if exact else "number, text, true or false, or a list of these"
        return f"{_WORDS[wanted['type']]}{_range(wanted)}" if "type" in wanted else "any value"


def _all_parts() -> dict[str, Schema]:
    found: dict[str, Schema] = {}
    for model in (SceneModel, *(KINDS[kind].load("model") for kind in KINDS)):
        schema = scene_schema(model)
        for name, part in {**schema.get("$defs", {}), model.__name__: schema}.items():
            found[name] = next(one for one in (part, *part.get("anyOf", ())) if "properties" in one)
    return found


def _keys(part: Schema) -> Iterator[tuple[str, Schema]]:
    yield from part["properties"].items()


def _links(wanted: Any) -> Iterator[str]:
    """Yield the parts that a key leads to."""
    if isinstance(wanted, dict):
        for key, value in wanted.items():
            if key == "$ref":
                yield value.rpartition("/")[2]
            elif key != "discriminator":
                yield from _links(value)
    elif isinstance(wanted, list):
        for value in wanted:
            yield from _links(value)


def _counts(least: int, most: int | None) -> str:
    if least == most:
        return f"{least} × "
    return f"at least {least} × " if least > 1 else ""


def _range(wanted: Schema) -> str:
    low, high = wanted.get("minimum"), wanted.get("maximum")
    if low is not None and high is not None:
        return f", {low:,} … {high:,}"
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    return "".join(f", {sign} {wanted[key]:,}" for key, sign in signs.items() if key in wanted)


def _absent(wanted: Schema, needed: bool) -> str:
    if needed:
        return "**needed**"
    default = wanted.get("default")
    if default is None or isinstance(default, dict | list) or default == "":
        return ""
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


def _said(wanted: Schema) -> str:
    return (
        str(wanted["description"])
        .replace(" (a number, a parameter or an expression)", "")
        .replace("|", r"\|")
    )
