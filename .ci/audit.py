"""Advisories of dependencies: `.ci/audit.py [PYTHON]`, of those beside a Python, and of the lower bounds.

Installed versions are audited by pip-audit, where it can reach its database, and otherwise by the stored list
advisories.json, which has the first release without each advisory; lower bounds always by the stored list.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Seconds after which the database cannot be reached.
PATIENCE = 120
_BOUND = re.compile(r"(?P<name>[A-Za-z0-9][\w.-]*)\s*(?:\[[^]]*\])?\s*>=\s*(?P<version>[\w.]+)")


def parsed(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, for comparison; trailing zeros say nothing."""
    numbers = [int(number) for number in re.findall(r"\d+", version.partition("+")[0])]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)


def normalised(name: str) -> str:
    """Return a package's name as indices compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def bounds(root: Path = ROOT) -> Iterator[tuple[str, str, str]]:
    """Yield file, package and version of every lower bound."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lists = [project["dependencies"], *project.get("optional-dependencies", {}).values()]
    for requirement in (text for texts in lists for text in texts):
        if found := _BOUND.match(requirement):
            yield "pyproject.toml", normalised(found["name"]), found["version"]
    for line in (root / "recipe" / "recipe.yaml").read_text(encoding="utf-8").splitlines():
        if found := _BOUND.match(line.strip().removeprefix("- ")):
            yield "recipe/recipe.yaml", normalised(found["name"]), found["version"]


def stored(root: Path = ROOT) -> list[dict[str, str]]:
    """Return the stored advisories."""
    entries: list[dict[str, str]] = json.loads((root / ".ci" / "advisories.json").read_text(encoding="utf-8"))
    return entries


def findings(versions: list[tuple[str, str, str]], advisories: list[dict[str, str]]) -> Iterator[str]:
    """Yield a sentence for every version (place, package, version) that an advisory concerns."""
    for place, package, version in versions:
        for advisory in advisories:
            if normalised(advisory["package"]) == package and parsed(version) < parsed(advisory["fixed"]):
                name = f" ({advisory['id']})" if advisory["id"] else ""
                yield f"{place}: {package} {version} has a known advisory{name}; use {advisory['fixed']}"


def installed(python: str) -> list[tuple[str, str, str]]:
    """Return the packages installed beside a Python."""
    code = (
        "import importlib.metadata, json; "
        "print(json.dumps([[one.name, one.version] for one in importlib.metadata.distributions()]))"
    )
    listed = subprocess.run([python, "-c", code], capture_output=True, check=True, text=True).stdout
    return [("installed", normalised(name), version) for name, version in json.loads(listed)]


def from_database(packages: list[tuple[str, str, str]]) -> list[str] | None:
    """Return what pip-audit finds in its database; None where it is not there or cannot reach it."""
    with tempfile.TemporaryDirectory() as folder:
        listed, report = Path(folder) / "requirements.txt", Path(folder) / "report.json"
        known = [(name, version) for _, name, version in packages if name != "dynid"]
        listed.write_text("".join(f"{name}=={version}\n" for name, version in known), encoding="utf-8")
        command = [str(ROOT / ".ci-venv" / "bin" / "uv"), "tool", "run", "pip-audit", "--no-deps"]
        command += ["--disable-pip", "--progress-spinner", "off", "-f", "json"]
        command += ["-o", str(report), "-r", str(listed)]
        try:
            subprocess.run(command, capture_output=True, check=False, timeout=PATIENCE)
            found = json.loads(report.read_text(encoding="utf-8"))["dependencies"]
        except (OSError, ValueError, KeyError, subprocess.TimeoutExpired):
            return None
    return [
        f"installed: {one['name']} {one['version']} has a known advisory ({vulnerability['id']}); "
        f"use {', '.join(vulnerability['fix_versions']) or 'another package'}"
        for one in found
        for vulnerability in one.get("vulns", ())
    ]


def main(python: str = str(ROOT / ".venv" / "bin" / "python")) -> int:
    """Print what is found; return 1 where anything is."""
    advisories, packages = stored(), installed(python)
    answer = from_database(packages)
    source = "the database" if answer is not None else f"the stored list of {len(advisories)} advisories"
    found = [
        *findings([*bounds()], advisories),
        *(findings(packages, advisories) if answer is None else answer),
    ]
    print("\n".join([*found, f"{len(packages)} packages audited by {source}: {len(found)} with advisories"]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
