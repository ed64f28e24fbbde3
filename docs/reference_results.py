"""Layout tables of results, for docs/reference.py: the scenes that a page names are run.

A page names scenes, and what to set in them, `<!-- layout of: SCENE.yaml PATH=VALUE … -->`, several
with `;` between. Names that a scene gives stand as `<output>` and the like; every group has its sentence in
`reference_results.yaml`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import yaml

import dynid
from dynid.cli import cli
from dynid.scene.kinds.planning import run_plan
from dynid.scene.kinds.result_layout import pattern_of

if TYPE_CHECKING:
    from dynid.result import Result, Variable

_SENTENCES: dict[str, str] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))


def _results(runs: str, root: Path) -> Iterator[Result]:
    for run in runs.split(";"):
        words = run.split()
        planned, words = words[0] == "plan", [word for word in words if word != "plan"]
        scene, overrides = root / words[0], words[1:]
        if "/studies/" in words[0]:
            yield _studied(scene, overrides)
        else:
            loaded = dynid.load_scene(scene, overrides)
            yield run_plan(loaded) if planned else dynid.run(loaded)


def _studied(scene: Path, overrides: list[str]) -> Result:
    with TemporaryDirectory() as folder:
        file = f"{folder}/study.h5"
        options = [option for text in overrides for option in ("--set", text)]
        cli.main(
            ["study", str(scene), "-q", "--executor", "serial", "-o", file, *options], standalone_mode=False
        )
        return dynid.open_result(file)


def _general(path: str) -> str:
    """Return a path with the scene's own names replaced by placeholders, those of the layout of results."""
    group, _, name = path.rpartition("/")
    group = "/".join(pattern_of(tuple(group.split("/"))) or (group,))
    group = re.sub(r"/port/(source|load)/[efYZ]_eq(/.*)?$", "/port/<side>/<equivalent>", group)
    group = re.sub(r"^study/(results|statistics)/.*", r"study/\1/<path>", group)
    return f"{re.sub('^[a-z_]+/need$', '<kind>/need', group)}/{name}"


def _type(variable: Variable) -> str:
    if variable.dtype.names:
        return f"table of {', '.join(variable.dtype.names)}"
    return "text" if variable.dtype.kind in "OU" else str(variable.dtype)


def layout(runs: str, root: Path) -> str:
    """Return the tables of all groups of some results."""
    found: dict[str, tuple[str, str, str]] = {}
    for result in _results(runs, root):
        for path, variable in result.items():
            axes = " × ".join(variable.dims)
            found.setdefault(_general(path), (axes, _type(variable), variable.units))
    groups = dict.fromkeys(path.rpartition("/")[0] for path in found)
    unknown = [group for group in groups if group not in _SENTENCES]
    if unknown:
        raise ValueError(f"reference_results.yaml has no sentence for {', '.join(unknown)}")
    lines = []
    for group in groups:
        lines += [f"### `{group}`", "", _SENTENCES[group], ""]
        lines += ["| array | axes | type | unit |", "| --- | --- | --- | --- |"]
        for path, cells in found.items():
            if path.rpartition("/")[0] == group:
                lines.append(f"| `{path.rpartition('/')[2]}` | {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)
