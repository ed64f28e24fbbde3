"""The tester of tests: every wrong is another program, and one that is noticed counts as killed."""

import ast
import sys

import pytest

from tests.mutants.graft import graft
from tests.mutants.operators import mutants, mutated

SOURCE = '''
"""A module."""
LIMIT = 3.0

def larger(a: int, b: int = 1) -> int:
    """Return the larger one."""
    if a < b and b > LIMIT:
        return max(a, -b)
    return a
'''


def test_every_mutant_is_another_program_with_a_name_of_its_own():
    found = mutants("m", SOURCE)
    texts = [ast.unparse(mutated(SOURCE, mutant.number)) for mutant in found]
    assert len(set(texts)) == len(texts) == len({mutant.key for mutant in found})
    assert ast.unparse(ast.parse(SOURCE)) not in texts
    assert all('"""Return the larger one."""' in text and "a: int" in text for text in texts)


@pytest.mark.parametrize(
    "text",
    ["a <= b", "a >= b", "a < b or b", "LIMIT = 6.0", "max(-b, a)", "max(a, b)", "b: int=2", "return None"],
)
def test_it_makes_these(text):
    assert any(text in ast.unparse(mutated(SOURCE, mutant.number)) for mutant in mutants("m", SOURCE))


@pytest.mark.thorough
def test_a_mutant_is_put_in_wherever_the_function_is_known(tmp_path, monkeypatch):
    path = tmp_path / "grafted.py"
    path.write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    import grafted

    larger, found = grafted.larger, mutants("grafted", SOURCE)
    assert larger(1, 5) == 1
    (swapped,) = (mutant for mutant in found if "max(a, -b)" in mutant.key and "max(a, b)" in mutant.key)
    graft(swapped, str(path), SOURCE)
    assert larger(1, 5) == 5
    (constant,) = (mutant for mutant in found if mutant.names)
    graft(constant, str(path), SOURCE)
    assert grafted.LIMIT == 6.0
    del sys.modules["grafted"]
