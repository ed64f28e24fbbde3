"""Names of the forms of a synthesis."""

from __future__ import annotations

from typing import Literal, get_args

Form = Literal["cauer", "cauer-2", "foster", "foster-2", "brune"]

#: The forms, in the order of the result.
FORMS: tuple[Form, ...] = get_args(Form)
