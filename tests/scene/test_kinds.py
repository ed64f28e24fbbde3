"""The registry of kinds: every reference resolves, and has what its users call."""

from dataclasses import fields
from importlib import resources

import pytest

from dynid.scene.kind import KINDS
from dynid.scene.schema.base import SceneModel

REFERENCES = [
    (name, one.name)
    for name in KINDS
    for one in fields(KINDS[name])
    if one.name not in ("name", "template") and getattr(KINDS[name], one.name)
]
MEMBERS = {"content": ("sections", "method")}


@pytest.mark.parametrize(("name", "part"), REFERENCES)
def test_a_reference_resolves_to_what_its_users_call(name, part):
    found = KINDS[name].load(part)
    if part == "model":
        assert issubclass(found, SceneModel)
    elif part in MEMBERS:
        assert all(callable(getattr(found, member)) for member in MEMBERS[part])
    elif part == "alternatives":
        assert all(callable(one) for one in found.values())
    else:
        assert callable(found)


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_has_a_template_of_its_own_kind(name):
    text = resources.files("dynid.templates").joinpath(KINDS[name].template).read_text(encoding="utf-8")
    assert f"\nkind: {name}\n" in text


def test_what_a_kind_does_not_have_is_none():
    assert KINDS["study"].load("samples") is None
