"""Formulas in figures: fractions, indices and powers as the reduction writes them."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from dynid.report.notation import typeset


def said(formula):
    return "".join(piece.text for piece in formula.pieces).replace("\u2005", "").replace("\u2009", "")


def test_an_index_is_smaller_and_lower_and_a_power_higher():
    base, index, plus, other, power = typeset("m_{s} + x^{2}").pieces
    assert (index.text, power.text, plus.text.strip()) == ("s", "2", "+")
    assert index.y > base.y == other.y > power.y
    assert index.size < base.size


def test_a_fraction_has_its_parts_on_either_side_of_its_bar():
    formula = typeset(r"\frac{1}{s \, C_{a}}")
    ((left, bar, width),) = formula.bars
    above, below = formula.pieces[0], formula.pieces[1:]
    assert above.y < bar < min(piece.y - 0.75 * piece.size for piece in below)
    for piece in formula.pieces:
        assert left <= piece.x
        assert piece.x + piece.width <= left + width + 1


def test_what_the_isolator_writes_is_said():
    latex = r"Z_{\mathrm{tuning}} = A_{p}^{2} \, \left(s \, I_{f} + \frac{1}{s \, C_{a}}\right)"
    latex += r" - \omega_{0} \cdot 2"
    assert said(typeset(latex)) == "Ztuning=Ap2(sIf+1sCa)−ω0·2"


def test_pieces_follow_each_other_without_overlap():
    formula = typeset(
        r"Y = \frac{Y_{B}}{1 + Y_{B} \, Z_{A}} \, e + \sqrt{x} + \left|a\right| + \ln\left(b\right)"
    )
    rows = {}
    for piece in formula.pieces:
        rows.setdefault(round(piece.y, 3), []).append(piece)
    for row in rows.values():
        for one, other in pairwise(row):
            assert one.x + one.width <= other.x + 1e-9
    assert formula.width >= max(piece.x + piece.width for piece in formula.pieces)


@given(st.text(alphabet="ab1{}^_\\ ,+-frcmth", max_size=40))
def test_nothing_that_is_written_breaks_it(text):
    formula = typeset(text)
    assert formula.width >= 0
    assert formula.height > 0


def test_upright_text_ends_with_its_group_or_with_the_formula():
    def said(text):
        return "".join(piece.text for piece in typeset(text).pieces)

    assert said(r"\mathrm{a{b}c}d") == said(r"\mathrm{abc}d")
    assert said(r"\mathrm{abc") == said(r"\mathrm{abc}")
    assert said(r"\mathrm") == ""
