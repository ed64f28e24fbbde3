"""Fits that do not explain their records: a file with the fit and its tests, and no answers."""

import h5py
import numpy as np
import pytest
import yaml

import dynid as package
from dynid.errors import Diverged, UsageError
from tests.identification.test_delays import Rig

pytestmark = pytest.mark.thorough

PATH = "identification/parameters/estimate"
WRONG = ("--set", "structure.lumped.masses.2=9")


def scene(folder, **more):
    """Write a record and its scene; with `WRONG` no joint explains it."""
    rig = Rig(4, 400)
    kinds = {"y1": (1, "velocity"), "y3": (3, "velocity")}
    columns = {"F": rig.force()}
    columns |= {name: rig.noisy(rig.recorded(*kind, 0.0), 0.02) for name, kind in kinds.items()}
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "run.csv", table, delimiter=",", header=",".join(columns), comments="")
    (k1, c1), (k2, c2), (k3, c3) = [tuple(map(float, link)) for link in rig.links]
    links = [{"dofs": [1], "k": k1, "c": c1}, {"dofs": [2, 3], "k": k3, "c": c3}]
    data = {
        "dynid": 1,
        "kind": "identification",
        "structure": {"lumped": {"masses": rig.masses.tolist(), "links": links}},
        "joints": {"bolt": {"dofs": [1, 2], "k": {"start": 1.2 * k2}, "c": {"start": c2}}},
        "excitation": [{"dof": 3, "kind": "file", "path": "run.csv", "column": "F"}],
        "measurement": {
            "step": float(rig.step),
            "samples": 400,
            "channels": [{"dof": dof, "quantity": quantity} for dof, quantity in kinds.values()],
            "file": {"path": "run.csv", "columns": list(kinds)},
        },
        "estimator": {"method": "output-error"},
        "derived": [],
        **more,
    }
    (folder / "joint.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    return rig


def checked(file):
    """Check that a file has a rejected fit and no answers; return its result."""
    with h5py.File(file) as stored:
        assert stored.attrs["status"] == "rejected"
        assert "parameters" not in stored["identification"]
        assert "considered" not in stored["identification"]
    result = package.open_result(file)
    assert result.rejected
    assert not result.value("identification/diagnostics/converged")
    assert np.all(result["identification/rejected/estimate"].data > 0)
    measured, predicted, residual = (
        result[f"identification/measurement/{name}"].data for name in ("measured", "predicted", "residual")
    )
    np.testing.assert_array_equal(residual, measured - predicted)
    answers = [path for path in result if path.endswith("/estimate")]
    assert answers == ["identification/rejected/estimate"]
    return result


def test_a_rejected_fit_replaces_an_earlier_good_file(dynid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene(tmp_path)
    assert dynid("run", "joint.yaml", "-q")[0] == 0
    assert PATH in package.open_result("joint.h5")
    (tmp_path / "joint.h5").rename(tmp_path / "good.h5")
    assert dynid("run", "joint.yaml", "-q")[0] == 0
    code, out, err = dynid("run", "joint.yaml", *WRONG, "--report", "joint.html", "--junit", "j.xml")
    assert code == 3
    assert "rejected: the estimates of bolt.k, bolt.c are invalid" in out
    assert "joint.yaml:" in err
    assert "is unexplained" in err
    assert "is unexplained" in (tmp_path / "j.xml").read_text()
    result = checked("joint.h5")
    assert "masses" in result.attrs["scene"]
    assert "rejected estimate" in out
    page = (tmp_path / "joint.html").read_text()
    assert "rejected estimate" in page
    assert '<p class="note bad">Rejected: ' in page
    assert '<p class="note">RMS residual: ' in page  # a fact, no warning
    assert "prediction" in page
    # What reads results.
    code, out, _ = dynid("show", "joint.h5")
    assert code == 0
    assert "identification/rejected alone" in " ".join(out.split())
    assert '"status": "rejected"' in dynid("show", "joint.h5", "--json")[1]
    assert dynid("report", "joint.h5", "-o", "again.html")[0] == 0
    assert dynid("plot", "joint.h5", "-o", "figures")[0] == 0
    assert (tmp_path / "figures/prediction.svg").exists()
    code, out, _ = dynid("compare", "good.h5", "joint.h5")
    assert code == 1
    assert "status: the second is rejected" in out
    assert dynid("compare", "joint.h5", "joint.h5")[0] == 0
    assert dynid("export", "joint.h5", "--csv", "-o", "tables")[0] == 0
    code, _, err = dynid("export", "joint.h5", "--scene")
    assert code == 2
    assert "joint.h5 is rejected" in err
    assert "Result of identification" in repr(result)
    assert "rejected" in result._repr_html_()
    assert "estimate" in result.to_pandas("identification/rejected")


def test_expectations_and_studies_take_no_rejected_estimate_for_an_answer(dynid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene(tmp_path, expect=[{"path": PATH, "min": 0}])
    assert dynid("run", "joint.yaml", "-q")[0] == 0
    assert dynid("run", "joint.yaml", *WRONG, "-q")[0] == 3
    checked("joint.h5")
    study = {
        "dynid": 1,
        "kind": "study",
        "scene": "joint.yaml",
        "vary": {"structure.lumped.masses.2": {"values": [float(Rig(4).masses[2]), 9.0]}},
        "sampling": {"method": "grid"},
        "collect": [PATH],
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    assert dynid("study", "study.yaml", "--executor", "serial", "-q")[0] == 0
    found = package.open_result("study.h5")
    assert list(found["study/status"].data) == ["done", "failed"]
    values = found[f"study/results/{PATH}"].data
    assert np.isfinite(values[0]).all()
    shown = dynid("show", "study.h5")[1]
    assert "share of the completed samples that meet them\n" in shown
    assert np.isnan(values[1]).all()


def test_python_has_the_rejected_result_of_an_error(tmp_path):
    scene(tmp_path)
    loaded = package.load_scene(tmp_path / "joint.yaml", ["structure.lumped.masses.2=9"])
    with pytest.raises(Diverged, match="unexplained") as error:
        package.run(loaded)
    result = error.value.result
    package.write_result(result, tmp_path / "own.h5")
    checked(tmp_path / "own.h5")
    with pytest.raises(UsageError):
        result[PATH]


def test_rejected_modal_surveys_leave_their_modes(dynid, tmp_path, monkeypatch):
    """Frequencies in kHz taken for rad/s, which no stiffness of the joint explains."""
    monkeypatch.chdir(tmp_path)
    links = [{"dofs": [1], "k": 7.0e4}, {"dofs": [2, 3], "k": 5.0e4}]
    omega = np.array([0.017, 0.041])
    shapes = [{1: 0.4, 2: 0.8, 3: 1.0}, {1: 1.0, 2: 0.4, 3: -0.8}]
    values = [{"frequency": float(w), "shape": shape} for w, shape in zip(omega, shapes, strict=True)]
    data = {
        "dynid": 1,
        "kind": "identification",
        "structure": {"lumped": {"masses": [2.0, 1.2, 1.0], "links": links}},
        "joints": {"bolt": {"dofs": [1, 2], "k": {"start": 4.0e4, "min": 1e3}}},
        "measurement": {"modes": {"values": values}},
    }
    (tmp_path / "survey.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    assert dynid("run", "survey.yaml", "-q", "--report", "page.html")[0] == 3
    result = package.open_result("survey.h5")
    assert result.rejected
    assert "identification/parameters" not in " ".join(result)
    np.testing.assert_array_equal(result["identification/modes/frequency_measured"].data, omega)
    predicted = result["identification/modes/frequency"].data
    np.testing.assert_allclose(result["identification/modes/frequency_error"].data, predicted / omega - 1)
    assert np.all(predicted > 3 * omega)
    assert "identification/modes/mac" in result
    assert "0.017" in dynid("show", "survey.h5")[1]
    assert "0.017" in (tmp_path / "page.html").read_text()


def test_rejected_frequency_responses_leave_a_file_too(dynid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rig = scene(tmp_path)
    lines = np.linspace(0.2, 1.0, 80) * rig.omega[-1]
    text = yaml.safe_load((tmp_path / "joint.yaml").read_text())
    del text["excitation"]
    frf = [
        np.linalg.solve(rig.stiffness - np.diag(rig.masses) * w * w + 1j * w * rig.damping, [0.0, 0.0, 1.0])
        for w in lines
    ]
    table = np.column_stack([lines, np.real(frf)[:, 0], np.imag(frf)[:, 0]])
    np.savetxt(tmp_path / "h.csv", table, delimiter=",", header="omega,re,im", comments="")
    text["measurement"] = {
        "channels": [{"dof": 1, "quantity": "displacement", "reference": {"dof": 3}}],
        "frf": {"file": {"path": "h.csv"}},
    }
    (tmp_path / "joint.yaml").write_text(yaml.safe_dump(text))
    assert dynid("run", "joint.yaml", *WRONG, "-q", "--report", "page.html")[0] == 3
    result = checked("joint.h5")
    said = " ".join(result.value("identification/diagnostics/warnings"))
    assert "the model does not explain the record there; correct it first" in said
    assert "leave" not in said  # the lines are right
