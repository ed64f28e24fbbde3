"""Direct factorisation of sparse symmetric matrices, by interchangeable backends, every solve checked.

`splu` (SuperLU, of SciPy) is always there. The others are optional and used only when named; one that is
asked for and not installed is an error that says how to get it.
"""

from dynid.structure.factorisation.backends import BACKENDS, available
from dynid.structure.factorisation.factor import Factor, factorise

__all__ = ["BACKENDS", "Factor", "available", "factorise"]
