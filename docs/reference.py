"""Write the generated parts of docs/reference: `python docs/reference.py`; with `--check` compare only.

A page marks what is generated, `<!-- commands -->`, `<!-- python: dynid.run … -->`, `<!-- scene parts: … -->`
or `<!-- layout of: … -->`, up to `<!-- end -->`. The topics of `dynid help` are pages as a whole.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterator
from importlib import import_module, resources
from pathlib import Path
from typing import Any

import click

from dynid.cli import GROUPS, cli

HERE = Path(__file__).parent
_MARK = re.compile(
    r"(?P<begin><!-- (?P<kind>commands|python|scene parts|layout of):? ?(?P<what>[^>]*?) ?-->\n)"
    r".*?(?P<end><!-- end -->)",
    re.DOTALL,
)
_WIDTH = 100
#: The head of a section of a docstring.
_SECTION = re.compile(r"^(\w+)\n-+$", re.MULTILINE)


def commands() -> str:
    """Return what `--help` prints of every command."""
    parts = []
    whole = click.Context(cli, info_name="dynid", **cli.context_settings)
    for title, names in GROUPS.items():
        parts.append(f"## {title}\n")
        for name in names:
            command = cli.get_command(whole, name)
            assert command is not None
            command._help_option = None  # click keeps that of the first context that asked
            context = click.Context(
                command, info_name=name, parent=whole, terminal_width=_WIDTH, max_content_width=_WIDTH
            )
            parts.append(f"### dynid {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def python(names: str) -> str:
    """Return the documentation of objects, given by dotted names; `module.Class(a b)` has methods a and b.

    A module stands for the classes and functions in it.
    """
    parts: list[str] = []
    for match in re.finditer(r"([\w.]+)(?:\(([^)]*)\))?", names):
        dotted, members = match[1], match[2]
        thing = _object(dotted)
        if inspect.ismodule(thing):
            chosen = members.split() if members else [n for n, o in vars(thing).items() if _own(o, thing)]
            for name in chosen:
                parts += _entry(f"{dotted}.{name}", getattr(thing, name), None)
        else:
            parts += _entry(dotted, thing, members.split() if members is not None else None)
    return "\n\n".join(parts) + "\n"


def _object(dotted: str) -> Any:
    """Return a module, or an object in one."""
    try:
        return import_module(dotted)
    except ModuleNotFoundError:
        holder, _, name = dotted.rpartition(".")
        return getattr(import_module(holder), name)


def _own(thing: Any, module: Any) -> bool:
    return inspect.isclass(thing) and thing.__module__ == module.__name__


def _entry(dotted: str, thing: Any, members: list[str] | None) -> Iterator[str]:
    """Yield heading, signature and text of an object, then of its methods: those named, else all."""
    name = dotted.rpartition(".")[2]
    yield f"### `{dotted}`"
    if not (inspect.isclass(thing) and issubclass(thing, Exception)):
        yield f"`{name}{_signature(thing)}`"
    yield _text(thing)
    if not inspect.isclass(thing) or issubclass(thing, Exception):
        return
    every = [key for one in thing.__mro__[-2::-1] for key in vars(one) if one.__module__.startswith("dynid")]
    for key in dict.fromkeys(members if members is not None else every):
        member = inspect.getattr_static(thing, key)
        function = getattr(member, "fget", None) or getattr(thing, key)
        if not key.startswith("_") and callable(function) and inspect.getdoc(function):
            call = f".{key}" if isinstance(member, property) else f".{key}{_signature(function)}"
            yield f"#### `{name}.{key}`"
            yield f"`{call}`"
            yield _text(function)


def _signature(thing: Any) -> str:
    parts, star = [], False
    for parameter in inspect.signature(thing).parameters.values():
        if parameter.name == "self":
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not star:
            parts.append("*")
        star |= parameter.kind in (parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL)
        marks = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}
        text = f"{marks.get(parameter.kind, '')}{parameter.name}"
        if parameter.default is not parameter.empty:
            default = "…" if repr(parameter.default).startswith("<") else repr(parameter.default)
            text += f"={default}"
        parts.append(text)
    return f"({', '.join(parts)})"


def _text(thing: Any) -> str:
    """Return a docstring as Markdown: its sections in bold, their entries as lists."""
    head, *sections = _SECTION.split(inspect.getdoc(thing) or "")
    parts = [head.strip()]
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        parts.append(f"**{title}**")
        if title == "Examples":
            parts.append(f"```text\n{body.strip()}\n```")
        else:
            parts.append(body.strip() if title == "Notes" else _entries(body))
    return "\n\n".join(parts).replace("``", "`")


def _entries(body: str) -> str:
    """Return the entries of a section as a list."""
    lines: list[str] = []
    for line in body.strip("\n").splitlines():
        if line and not line.startswith(" "):
            lines.append(f"- `{line}`:")
        elif line.strip():
            lines[-1] += f" {line.strip()}"
    return "\n".join(lines)


def marked_parts() -> dict[str, list[str]]:
    """Return for each page the parts of scenes that it is about."""
    return {
        path.relative_to(HERE).as_posix(): mark["what"].split()
        for path in sorted(HERE.glob("reference/**/*.md"))
        for mark in _MARK.finditer(path.read_text())
        if mark["kind"] == "scene parts"
    }


def pages(kinds: tuple[str, ...] = ("commands", "python", "scene parts", "layout of")) -> dict[Path, str]:
    """Return the pages as they should be; marks of other kinds are left as they are."""
    from reference_results import layout
    from reference_scenes import Reference

    found = {path: path.read_text() for path in sorted(HERE.glob("reference/**/*.md"))}
    found = {path: text for path, text in found.items() if path.parent.name != "topics"}
    scenes = Reference(marked_parts())
    for path, text in found.items():
        page = path.relative_to(HERE).as_posix()
        write: dict[str, Callable[[str], str]] = {
            "commands": lambda _: commands(),
            "python": python,
            "scene parts": lambda _, page=page: scenes.text(page),  # type: ignore[misc]
            "layout of": lambda runs: layout(runs, HERE.parent),
        }

        def filled(mark: re.Match[str], write: dict[str, Callable[[str], str]] = write) -> str:
            if mark["kind"] not in kinds:
                return mark[0]
            return f"{mark['begin']}\n{write[mark['kind']](mark['what']).strip()}\n\n{mark['end']}"

        found[path] = _MARK.sub(filled, text)
    for topic in resources.files("dynid.topics").iterdir():
        if topic.name.endswith(".md"):
            found[HERE / "reference/topics" / topic.name] = topic.read_text(encoding="utf-8")
    return found


def outdated(found: dict[Path, str]) -> list[str]:
    """Return the names of the pages that differ from what they should be."""
    differing = [path for path, text in found.items() if not path.exists() or path.read_text() != text]
    every = HERE.glob("reference/**/*.md")
    return [path.relative_to(HERE).as_posix() for path in [*differing, *(set(every) - found.keys())]]


def main(words: list[str]) -> int:
    """Write the pages, or tell which are not current."""
    found = pages()
    differing = outdated(found)
    if "--check" in words:
        for name in differing:
            print(f"docs/{name} is not current; run python docs/reference.py", file=sys.stderr)
        return bool(differing)
    for path, text in found.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    print("\n".join(differing))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
