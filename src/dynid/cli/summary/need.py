"""Parts that were left out of a model, and the reasons."""

from __future__ import annotations

from textwrap import wrap

from dynid.result import Result

#: Most names of one sort that are written out; what is merely not asked for is counted.
_MOST = 6


def need_lines(result: Result) -> list[str]:
    """Return one sentence on what was left out; nothing where that is not said."""
    group = next((path.rpartition("/")[0] for path in result if path.endswith("/need/part")), None)
    if group is None:
        return []
    columns = ("part", "kept", "left_out", "left_out_names", "why")
    rows = zip(*(result[f"{group}/{column}"].data for column in columns), strict=True)
    said = [
        _said(str(part), int(kept), int(left), str(names), str(why))
        for part, kept, left, names, why in rows
        if left
    ]
    return wrap(
        f"left out: {'; '.join(said) or 'nothing'}", 108, initial_indent="  ", subsequent_indent="    "
    )


def _said(part: str, kept: int, left: int, names: str, why: str) -> str:
    each = names.split(", ") if names else []
    shown = f": {names}" if each and len(each) <= _MOST and part != "results" else ""
    return f"{left:,} of {kept + left:,} {part}{shown} ({why})"
