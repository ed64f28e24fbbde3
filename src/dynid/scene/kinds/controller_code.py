"""The sampled controllers of a scene as functions in C, with the arithmetic of the simulation."""

from __future__ import annotations

import re
from collections.abc import Iterator

from dynid.bondgraph.reduction.junctions import unique
from dynid.errors import UsageError
from dynid.lti.sampled_system import SampledController
from dynid.scene.kinds.bond_graph import question
from dynid.scene.load import Scene
from dynid.scene.schema.bond_graph import BondGraphScene

_HEADER = """\
/* Sampled controllers of the scene "{title}", written by dynid.

   Call each function once in every period, with what is measured then and the setpoint. It returns what the
   source holds from `computation` after the sample on, to which a reference is added. States start at
   zero. Outputs are those of dynid's simulation, bit for bit, where doubles are IEEE 754 and products are not
   fused with sums: compile with -ffp-contract=off. */

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif
"""


#: Numbers of what is measured, and of what is beyond limits, in the sums of a controller.
_MEASURED, _EXCESS = -1, -2


def controller_code(scene: Scene[BondGraphScene]) -> str:
    """Return the C code of the sampled controllers of a scene, a function for each.

    Raises `UsageError` where no loop is sampled.
    """
    model = scene.model
    if model.design is not None:
        raise UsageError(
            "the scene has a 'design', whose values its controllers await",
            remedy="Run it and export the designed scene: dynid export RESULT --scene.",
        )
    _, analysis = question(scene)
    loops = analysis.sampled_loops
    if loops is None:
        remedy = "State the 'sample' of a controller, its period in s."
        if model.control is not None and model.control.states is not None:
            remedy = (
                "Gains of states need no function: bond_graph/state_feedback/gain of the result has them."
            )
        raise UsageError(
            "no controller of the scene is sampled, and C functions are of those",
            remedy=remedy,
        )
    names = set[str]()
    text = [_HEADER.format(title=scene.title.replace("*/", "* /"))]
    for loop, controller in zip(loops.loops, loops.float_controllers(limited=True), strict=True):
        stem = re.sub(r"\W", "_", loop.source, flags=re.ASCII)
        stem = f"_{stem}"[stem[0].isalpha() :]
        name = unique(stem, names)
        names.add(name)
        when = f"every {float(controller.period)!r} s; computation {float(controller.computation)!r} s"
        text += ["", f"/* {loop.measured} -> {loop.source}: {when} */", *_function(name, controller)]
    return "\n".join(text) + "\n"


def _function(name: str, controller: SampledController) -> Iterator[str]:
    """Yield the lines of the state and the function of a controller."""
    order = len(controller.h)
    yield f"typedef struct {{ double x[{order or 1}]; }} {name}_state;{'' if order else ' /* unused */'}"
    yield ""
    yield f"double {name}_step({name}_state *state, double measured, double setpoint)"
    yield "{"
    if order:
        yield "    double *x = state->x;"
    else:
        yield "    (void)state;"
    yield "    const double y = measured - setpoint;"
    answer, rates = controller.terms
    yield f"    const double answer = {_sum(answer)};"
    if controller.limited:
        low, high = f"{controller.low!r}", f"{controller.high!r}"
        yield f"    const double u = answer < {low} ? {low} : answer > {high} ? {high} : answer;"
        if any(k == _EXCESS for terms in rates for _, k in terms):
            yield "    const double excess = answer - u;"
    for k, terms in enumerate(rates):
        yield f"    const double next_{k} = {_sum(terms)};"
    for k in range(order):
        yield f"    x[{k}] = next_{k};"
    yield f"    return {'u' if controller.limited else 'answer'};"
    yield "}"


def _sum(terms: list[tuple[float, int]]) -> str:
    """Return a sum of products in their order."""
    names = {_MEASURED: "y", _EXCESS: "excess"}
    variables = [f"{factor!r} * {names.get(k, f'x[{k}]')}" for factor, k in terms]
    return " + ".join(variables).replace("+ -", "- ") or "0.0"
