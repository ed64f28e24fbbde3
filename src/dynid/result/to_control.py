"""State equations as a system of python-control."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynid.errors import UsageError

if TYPE_CHECKING:
    import control

    from dynid.result import Result

_GROUP = "bond_graph/state_space"


def state_space(result: Result) -> control.StateSpace:
    """Return the state equations that a result holds (`Result.to_control`)."""
    import control

    if f"{_GROUP}/A" not in result:
        raise UsageError("the result holds no state equations", remedy="Add state_space to analysis.results.")
    names = {
        axis: [str(name).replace(".", "_") for name in result[f"{_GROUP}/{axis}"].data]
        for axis in ("state", "input", "output")
    }
    _refuse_derivatives(result)
    matrices = (result[f"{_GROUP}/{name}"].data for name in "ABCD")
    return control.StateSpace(
        *matrices, states=names["state"], inputs=names["input"], outputs=names["output"]
    )


def _refuse_derivatives(result: Result) -> None:
    improper = result[f"{_GROUP}/feedthrough"].data[1:].any(axis=0)
    for output, source in np.argwhere(improper):
        raise UsageError(
            f"output '{result[f'{_GROUP}/output'].data[output]}' follows a derivative of input "
            f"'{result[f'{_GROUP}/input'].data[source]}': no state space in python-control can hold that",
            remedy="Ask for other outputs, or put into the graph what limits them.",
        )
