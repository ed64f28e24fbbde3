"""Scenes: one YAML file, read, checked as a whole, and run.

`yaml` reads text into data with the place of every key. `schema` has the models of keys and of what they say
together, `kinds` runs and explains each kind. `load` joins text and model, `run` runs a scene.
"""
