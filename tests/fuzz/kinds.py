"""The kinds of hostile scenes, and how many there are of each among a hundred."""

from __future__ import annotations

import random

from dynid.scene.yaml.writer import dump
from tests.fuzz import hostile
from tests.fuzz.mutation import spoiled_data, spoiled_text, wrong_type


def _changed(chance, base):
    try:
        return dump(spoiled_data(chance, base))
    except RecursionError:  # the writer's, not the reader's
        return "a: " + "[" * 2000 + "]" * 2000


#: Name: what makes a scene out of a valid one, and how many of a hundred.
KINDS = {
    "changed values and keys": (_changed, 20),
    "another type at a key": (wrong_type, 18),
    "damaged text": (spoiled_text, 12),
    "attribute names": (hostile.attribute_names, 7),
    "numbers that are none": (hostile.bad_numbers, 6),
    "numbers over the whole range": (hostile.whole_range, 10),
    "huge counts and sizes": (hostile.huge_sizes, 5),
    "devices, directories, pipes": (hostile.hostile_files, 5),
    "cyclic and long parameters": (hostile.cyclic_parameters, 4),
    "long and deep names": (hostile.deep_names, 3),
    "models within models": (hostile.nested_models, 3),
    "code": (hostile.code, 3),
    "alias bombs": (hostile.alias_bomb, 2),
    "deep nesting": (hostile.deep_nesting, 2),
}
_NAMES = [name for name, (_, share) in KINDS.items() for _ in range(share)]


def hostile_scene(seed, bases):
    """Return the kind and the text of a hostile scene, made of one of the bases by the chance of a seed."""
    chance = random.Random(seed)
    name = chance.choice(_NAMES)
    return name, KINDS[name][0](chance, bases[seed % len(bases)])
