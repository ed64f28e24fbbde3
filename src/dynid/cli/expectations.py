"""Expectations of a scene or a study: checked, told, and written for CI."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from dynid.checks import CheckOutcome
    from dynid.result import Result
    from dynid.scene.load import Scene


def check(scene: Scene, result: Result, junit: str | None) -> list[CheckOutcome]:
    """Check a result, in memory or stored, against its scene, and write the JUnit file if one is wanted."""
    outcomes: list[CheckOutcome] = []
    if scene.model.expect:
        from dynid.checks import check_expectations

        outcomes = check_expectations(
            result, [item.model_dump(exclude_none=True) for item in scene.model.expect]
        )
    if junit:
        from dynid.checks import junit_xml
        from dynid.file_access import replace_file

        replace_file(junit, junit_xml(outcomes, Path(scene.source.file).stem).encode())
    return outcomes


def tell(scene: Scene, outcomes: list[CheckOutcome], quiet: bool) -> int:
    """Say how many expectations are met, and which are not, at their places; return the exit code."""
    met = sum(outcome.passed for outcome in outcomes)
    if outcomes and not quiet:
        click.echo(f"  {met} of {len(outcomes)} expectations met")
    for index, outcome in enumerate(outcomes):
        if not outcome.passed:
            message = f"expectation failed: {outcome.path}: {outcome.message}"
            click.echo(str(scene.source.fault(("expect", index), message)), err=True)
    return 1 if met < len(outcomes) else 0
