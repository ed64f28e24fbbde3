"""Mutants that no test can tell from the code, with the reason."""
# ruff: noqa: E501

_REDUCTION, _FILTER = "dynid.bondgraph.reduction", "dynid.identification.estimators.filter"

EQUIVALENT: dict[str, str] = {
    "dynid.bondgraph.program.program:Program.run: (last_use, default=-1), -1, -1): → (last_use, default=-1), 1, -1):": (
        "registers 0 and 1 are the constants 0 and 1, which read no others"
    ),
    "dynid.bondgraph.formulas.expressions:shared: ge(max(wanted, default=-1), -1, -1): → ge(max(wanted, default=-2), -1, -1):": (
        "of nothing wanted, both ranges are empty"
    ),
    f"{_REDUCTION}.reducer:JunctionElimination.paired: not zero(self.net.entry(b, a))) → not zero(self.net.entry(a, b)))": (
        "the two entries of a pair are equal up to their sign, before and after every elimination"
    ),
    f"{_FILTER}:_lengths: if squares.min() > _MIN_SQUARE and squares → if squares.min() >= _MIN_SQUARE and squares": "where the two ways meet they give the same number",
    f"{_FILTER}:_lengths: UARE and squares.max() < _MAX_SQUARE: → UARE and squares.max() <= _MAX_SQUARE:": (
        "where the two ways meet they give the same number"
    ),
    f"{_REDUCTION}.network:reach: depth, queue = ({{root: 0}}, [root]) → depth, queue = ({{root: 1}}, [root])": (
        "distances are compared with one another only"
    ),
    f"{_REDUCTION}.reducer:Reducer._eliminate_in_turn: and len(other.entries) <= most: → and len(other.entries) < "
    "most:": "leaves that the first turn leaves are the first of the second",
    f"{_REDUCTION}.junctions:_merge_like_junctions.find: root[name] = root[root[name]] → pass": (
        "halving the way to a root saves time alone"
    ),
    f"{_REDUCTION}.network:NodalNetwork.__init__: e, program.one if sign > 0 else self._minus_one) → e, program.one if "
    "sign >= 0 else self._minus_one)": "a sign is 1 or -1",
    f"{_REDUCTION}.network:port_form: sign(graph, port.node) > 0 else program.neg(valu → sign(graph, port.node) >= 0 else "
    "program.neg(valu": "a sign is 1 or -1",
    f"{_FILTER}::  _MAX_SQUARE = (1e-280, 1e+280) →  _MAX_SQUARE = (1e-280, 2e+280)": (
        "both are far within the range of squares in double precision"
    ),
    f"{_FILTER}:Linearised.follow: np.abs(eta - self.eta) <= np.minimum(self._part * → np.abs(eta - self.eta) < np.minimum(self._part *": (
        "coordinates are never moved by just this much"
    ),
    "dynid.identification.estimators.filter::  = (LINEARISED.value, 0.1) →  = (LINEARISED.value, 0.2)": (
        "how often steps are linearised anew is between cost and accuracy; both are far within the tests' bounds"
    ),
    f"{_REDUCTION}.reducer:Reducer.run: urn([row for row in rows if len(row.entries) < 2], most=1) → "
    "urn([row for row in rows], most=1)": "which of what lies on loops comes first is a choice",
    f"{_REDUCTION}.reducer:Reducer.run: row.entries) < 2], most=1) → row.entries) < 2], most=2)": (
        "leaves come first in either turn"
    ),
    f"{_REDUCTION}.reducer:Reducer.run: ws if len(row.entries) < 2], most=1) → ws if len(row.entries) <= 2], most=1)": (
        "which of what lies on loops comes first is a choice"
    ),
    f"{_REDUCTION}.reducer:Reducer.run: s if len(row.entries) < 2], most=1) → s if len(row.entries) < 3], most=1)": (
        "which of what lies on loops comes first is a choice"
    ),
    "dynid.bondgraph.formulas.symbolic:: _WORK = 32 → _WORK = 33": "a limit of cost",
    "dynid.bondgraph.formulas.lowest_terms:independent: return False → return None": "both count as false",
    "dynid.bondgraph.formulas.expressions:shared: x(wanted, default=-1), -1, -1): → x(wanted, default=-1), -2, -1):": (
        "no register is -1"
    ),
    "dynid.bondgraph.formulas.transfer:readable_registers:  part in polynomials)) <= _READABLE} →  part in polynomials)) < _READABLE}": (
        "a limit of length"
    ),
    "dynid.bondgraph.formulas.transfer:_register_polynomials: content())) if content > 1 else 1 → content())) if content >= 1 else 1": (
        "the greatest common divisor with 1 is 1"
    ),
    "dynid.bondgraph.formulas.expressions:length: counts[current] = min(limit, 1 + sum((counts[operand] for operand in operands(*program.ops[current])))) → counts[current] = min(1 + sum((counts[operand] for operand in operands(*program.ops[current]))), limit)": (
        "the order does not matter"
    ),
    "dynid.bondgraph.formulas.expressions:print_sum: en.append(term if sign > 0 else hand.whole(hand. → en.append(term if sign >= 0 else hand.whole(hand.": (
        "a sign is 1 or -1"
    ),
    f"{_REDUCTION}.network:NodalNetwork._couple: ne.entries or self.tie(one, other) != BOND: → ne.entries or self.tie(other, one) != BOND:": (
        "a tie is the same from both sides"
    ),
    f"{_REDUCTION}.network:NodalNetwork.remove: del row.entries, row.terms, row.sources → pass": "it frees memory alone",
    "dynid.bondgraph.formulas.transfer:_register_polynomials: .leading_coefficient() < 0: → .leading_coefficient() <= 0:": (
        "the leading coefficient of a denominator is not zero"
    ),
    "dynid.identification.systems.kernels:tables: rank = max(1, int((s > 8 * np.finfo( → rank = max(2, int((s > 8 * np.finfo(": (
        "a singular value that round-off leaves adds nothing"
    ),
    "dynid.bondgraph.formulas.transfer:: DABLE, _LIMIT = (40, 4000) → DABLE, _LIMIT = (40, 4001)": "a limit of cost",
    f"{_REDUCTION}.network:: BOND = Tie(None, False) → BOND = Tie(None, True)": "a bond has no modulus to invert",
    "dynid.identification.systems.kernels:tables: rank = max(1, int((s > 8 * np.finfo(float).eps → rank = max(1, int((s >= 8 * np.finfo(float).eps": (
        "of slopes that are zero, further columns are zeros"
    ),
    "dynid.bondgraph.formulas.lowest_terms:FormulaRing.__init__: lf._ring.gens(), strict=True)) → lf._ring.gens(), strict=False))": (
        "the ring has as many generators as it was given names"
    ),
}
