"""Meshes that refer to other files: refused, or named in the scene and watched."""

import pytest

from dynid.cli.watch import files_of
from tests.files.mesh_files import referring


@pytest.mark.parametrize("form", ["abaqus", "abaqus nodes", "nastran", "xdmf"])
def test_other_files_of_a_mesh_are_named_in_the_scene_and_watched(tmp_path, form, dynid):
    pytest.importorskip("meshio")
    name, other = referring(tmp_path, form)
    scene = (
        "dynid: 1\nkind: identification\nstructure:\n  solid:\n"
        f"    mesh: {name}\n    materials: {{E: 1, nu: 0.3, rho: 1}}\nanalysis: {{modes: {{count: 2}}}}\n"
    )
    (tmp_path / "s.yaml").write_text(scene)
    code, _, said = dynid("check", tmp_path / "s.yaml")
    assert code == 4
    assert f"{tmp_path / 's.yaml'}:5:5: {tmp_path / name} refers to another file, '{other}'" in said
    assert f"includes: [{other}]" in said
    (tmp_path / "s.yaml").write_text(
        scene.replace("    materials", f"    includes: [{other}]\n    materials")
    )
    assert dynid("check", tmp_path / "s.yaml")[0] == 0
    assert tmp_path / other in files_of(str(tmp_path / "s.yaml"))
