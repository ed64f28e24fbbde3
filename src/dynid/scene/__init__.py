"""Scenes: one YAML file, read, checked as a whole, and run.

`yaml` reads text into data with positions, `arithmetic` the expressions in it, `schema` says what is valid,
`kinds` runs each kind; `load` and `dispatch` join them.
"""
