"""What is said of results of several kinds: responses, expectations, what was left out, and alternatives."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from dynid.numerals import counted, memory_text, span_text, time_text
from dynid.report.answers.blocks import Block, Grid, Note, Part
from dynid.report.scenes import plain_data
from dynid.result import Result

#: Most channels and outputs that are listed.
_MOST = 30


def doubts(result: Result) -> list[str]:
    """Return what rounding leaves open, each sentence once."""
    said = (str(attrs["doubt"]) for attrs in result.group_attrs.values() if "doubt" in attrs)
    return list(dict.fromkeys(f"beware: {sentence}" for sentence in said))


def doubtful(result: Result) -> Iterator[Part]:
    """Yield what rounding leaves open."""
    if found := doubts(result):
        yield Part("Doubts", tuple(Note(sentence[0].upper() + sentence[1:], "bad") for sentence in found))


def responses(result: Result) -> Iterator[Part]:
    """Yield the peaks of frequency responses and the range of time responses."""
    for group in ("bond_graph", "structure"):
        if f"{group}/frequency_response/omega" in result:
            yield Part("Frequency response", tuple(_frequency(result, f"{group}/frequency_response")))
        if f"{group}/time_response/time" in result:
            yield Part("Time response", tuple(_time(result, f"{group}/time_response")))


def _frequency(result: Result, group: str) -> Iterator[Block]:
    omega, response = result[f"{group}/omega"].data, np.abs(result[f"{group}/response"].data)
    outputs, inputs = (result[f"{group}/{axis}"].data for axis in ("output", "input"))
    channels = [(k, m) for k in range(len(outputs)) for m in range(len(inputs))]
    rows = []
    for k, m in channels[:_MOST]:
        peak = int(np.argmax(response[:, k, m]))
        top = f"{response[peak, k, m]:.4g}".replace("inf", "∞")
        rows.append((f"{outputs[k]} over {inputs[m]}", top, f"{omega[peak]:.4g}"))
    span = f"{counted(len(omega), 'frequency')}, {span_text(omega[0], omega[-1])} rad/s"
    yield Grid(("", "largest magnitude", "at, rad/s"), tuple(rows), caption=span)
    yield from more(len(channels), _MOST, "channel")


def _time(result: Result, group: str) -> Iterator[Block]:
    time, response = result[f"{group}/time"].data, result[f"{group}/response"].data
    rows = [
        (str(output), *(f"{value:.4g}" for value in (column.min(), column.max(), column[-1])))
        for output, column in zip(result[f"{group}/output"].data[:_MOST], response.T, strict=False)
    ]
    span = f"{counted(len(time), 'instant')}, to {time[-1]:.4g} s"
    yield Grid(("", "least", "largest", "at the end"), tuple(rows), caption=span)
    if note := result.group_attrs.get(group, {}).get("note"):
        yield Note(f"{note}.")
    yield from more(response.shape[1], _MOST, "output")


def more(count: int, shown: int, what: str) -> Iterator[Note]:
    """Say how many are not shown."""
    if count > shown:
        yield Note(f"… {counted(count - shown, f'more {what}')} in the file")


def expectations(result: Result) -> Iterator[Part]:
    """Yield what the scene expects of its result, checked again."""
    wanted = _expected(result)
    if not wanted:
        return
    from dynid.checks import check_expectations

    outcomes = check_expectations(result, wanted)
    met = sum(outcome.passed for outcome in outcomes)
    said = Note(
        f"{met} of {counted(len(outcomes), 'expectation')} met", "good" if met == len(outcomes) else "bad"
    )
    rows = tuple(
        (one.path, one.expected, one.found, "met" if one.passed else f"not met: {one.message}")
        for one in outcomes
    )
    failed = frozenset(place for place, one in enumerate(outcomes) if not one.passed)
    yield Part("Expectations", (said, Grid(("array", "expected", "found", ""), rows, failed)))


def _expected(result: Result) -> list[dict[str, Any]]:
    """Return the `expect` of the scene that a result bears; nothing where it bears none that can be read."""
    text = str(result.attrs.get("scene", ""))
    if "expect" not in text or result.attrs.get("status") == "interrupted":
        return []
    items = plain_data(text).get("expect")
    given = items if isinstance(items, list) else []
    return [item for item in given if isinstance(item, dict) and "path" in item]


def need(result: Result) -> Iterator[Part]:
    """Yield what was left out of the model, and why."""
    group = next((path.rpartition("/")[0] for path in result if path.endswith("/need/part")), None)
    if group is None:
        return
    columns = ("part", "kept", "left_out", "left_out_names", "why")
    rows = tuple(
        (str(part), f"{int(kept):,}", f"{int(left):,}", str(names) if len(str(names)) < 200 else "", str(why))
        for part, kept, left, names, why in zip(
            *(result[f"{group}/{column}"].data for column in columns), strict=True
        )
    )
    yield Part("Modelled and left out", (Grid(("", "kept", "left out", "", "why"), rows),))


def accuracy(result: Result) -> Iterator[Part]:
    """Yield what else could have been chosen, a table for every choice."""
    about = result.group_attrs.get("accuracy")
    if about is None:
        return
    aspects = dict.fromkeys(path.split("/")[1] for path in result if path.startswith("accuracy/"))
    for aspect in aspects:
        group = f"accuracy/{aspect}"
        said = result.group_attrs[group]
        reference = f", against {said['reference']}" if said.get("reference") else ""
        rows, marked = _alternatives(result, group)
        blocks: list[Block] = [
            Note(f"{said['title']}: {said['because']}"),
            Grid(("", str(said["size"]), "time", "memory", "error", "error/bound", ""), rows, marked),
            Note(f"Error: {said['measure']}{reference}. Median of {about['repeats']}."),
        ]
        yield Part(f"What else could have been chosen: {aspect.replace('_', ' ')}", tuple(blocks))


def _alternatives(result: Result, group: str) -> tuple[tuple[tuple[str, ...], ...], frozenset[int]]:
    rows: list[tuple[str, ...]] = []
    marked = set()
    names = [str(name) for name in result[f"{group}/alternative"].data]
    for name, status in zip(names, result[f"{group}/status"].data, strict=True):
        own = f"{group}/{name}"
        for k in range(len(result[f"{own}/size"].data) if f"{own}/size" in result else 0):
            get = {
                key: _entry(result, f"{own}/{key}", k) for key in ("size", "time", "memory", "error", "bound")
            }
            ratio = get["error"] / get["bound"] if get["bound"] > 0 else math.nan
            if _entry(result, f"{own}/chosen", k):
                marked.add(len(rows))
            best = "nothing is both faster and more accurate" if _entry(result, f"{own}/pareto", k) else ""
            rows.append(
                (
                    name,
                    f"{int(get['size']):,}",
                    time_text(get["time"]),
                    memory_text(get["memory"]),
                    _number(get["error"], ".1e"),
                    _number(ratio, ".2g"),
                    best,
                )
            )
        if status != "done":
            rows.append((name, "", "", "", "", "", str(status)))
    return tuple(rows), frozenset(marked)


def _entry(result: Result, path: str, k: int) -> float:
    return float(result[path].data[k]) if path in result else math.nan


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "–"


def listed(names: Iterable[Any], most: int) -> str:
    """Write a list of names, cut where it is long."""
    every = [str(name) for name in names]
    return ", ".join(every[:most]) + (f", … ({len(every)} in all)" if len(every) > most else "")
