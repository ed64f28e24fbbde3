"""Plain data to YAML text, so that a scene changed on the way can be stored as it was run."""

from __future__ import annotations

from typing import Any

import yaml

from dynid.scene.yaml.scalars import resolve_plain


class _Dumper(yaml.SafeDumper):
    """Writes plain data so that our own rules read the same data back."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def _represent(dumper: _Dumper, value: Any) -> yaml.ScalarNode:
    # Everything bears the tag of a text, which is never written; the quotes tell texts from the rest.
    style = None
    if isinstance(value, str):
        text = value
        style = None if value != "<<" and value.isprintable() and _reads_as_text(value) else '"'
    elif isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, float):
        text = {"inf": ".inf", "-inf": "-.inf", "nan": ".nan"}.get(repr(value), repr(value))
    else:
        text = "null" if value is None else str(value)
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


def _reads_as_text(text: str) -> bool:
    try:
        return isinstance(resolve_plain(text), str)
    except ValueError:
        return False


for _type in (str, int, float, bool, type(None)):
    _Dumper.add_representer(_type, _represent)
_Dumper.yaml_implicit_resolvers = {}


def dump(data: Any) -> str:
    """Write plain data as YAML that our own rules read back as the same data."""
    text: str = yaml.dump(data, Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=2**31)
    return text


def flow(data: Any) -> str:
    """Write plain data on one line, as a part of a text that may stand anywhere."""
    listed: str = yaml.dump(
        [data], Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=2**31, default_flow_style=True
    )
    return listed.strip()[1:-1]
