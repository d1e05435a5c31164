"""`eadp plan`: the documented JSON, the canonical text, refusals."""

from __future__ import annotations

import json


def test_the_survey_as_json(eadp):
    answer = eadp("plan", "plans/survey.plan", "--format", "json")
    assert answer.code == 0
    document = json.loads(answer.out)
    assert document["schema"] == "eadp.plan/1"
    assert [stage["kind"] for stage in document["stages"]] == ["circle", "line", "circle", "line"]
    assert [stage["rotation_deg"] for stage in document["stages"]] == [90, 270, 90, 90]
    assert document["repeats"] is True
    assert document["primitive_stages"] == 4
    assert document["shift"] == ["150 - 2*sqrt(4900 + c1)", "15 - sqrt(4900 + c1)/5"]
    assert document["final"] == {"x": 175, "y": 161}
    assert document["stages"][1]["trigger"] == {"x": -115, "y": -11}
    assert document["stages"][0]["sets"] == [
        {"name": "c1", "kind": "path", "min": -1000, "max": 0},
        {"name": "c2", "kind": "computation", "min": 2, "max": 10},
    ]
    assert document["findings"] == []


def test_the_published_plan_without_sets(eadp, reference):
    document = json.loads(eadp("plan", reference / "plans/plan_specification.pln", "--format", "json").out)
    assert len(document["stages"]) == 60
    assert {stage["kind"] for stage in document["stages"]} == {"line", "circle"}
    assert all(stage["sets"] == [] for stage in document["stages"])
    assert document["final"] == {"x": 175, "y": 161}


def test_canonical_text_reads_as_itself(eadp, tmp_path):
    text = eadp("plan", "plans/survey.plan", "--format", "plan").out
    copy = tmp_path / "copy.plan"
    copy.write_text(text)
    assert eadp("plan", copy, "--format", "plan").out == text
    documents = [json.loads(eadp("plan", file, "--format", "json").out) for file in ("plans/survey.plan", copy)]
    for document in documents:
        for stage in document["stages"]:
            stage.pop("line")
    assert documents[0] == documents[1]


def test_every_error_of_a_file_at_once(eadp, tmp_path):
    path = tmp_path / "bad.plan"
    path.write_text("0.05; 270; x+(115\n-115, 1\n[2, 1]\n-1; 45; y\n0, 0\n[1, 2]\n")
    answer = eadp("plan", path)
    assert answer.code == 2
    assert answer.out == ""
    places = [line.split(": error:")[0] for line in answer.err.splitlines() if ": error:" in line]
    assert places == [f"{path}:1:18", f"{path}:3:1", f"{path}:4:1", f"{path}:4:5"]


def test_a_missing_file_a_folder_and_bytes(eadp, tmp_path):
    for name, make in (
        ("missing", lambda path: None),
        ("folder", lambda path: path.mkdir()),
        ("bytes", lambda path: path.write_bytes(b"\xff\xfe")),
    ):
        path = tmp_path / name
        make(path)
        answer = eadp("plan", path)
        assert answer.code == 2
        assert answer.err.startswith(f"{path}:1:1: error: ")


def test_a_file_that_is_too_large_is_refused_by_its_size(eadp, tmp_path, monkeypatch):
    path = tmp_path / "large.plan"
    path.write_text("% " + "x" * 1000 + "\n")
    monkeypatch.setenv("EADP_LIMIT_BYTES", "500")
    assert "EADP_LIMIT_BYTES" in eadp("plan", path).err


def test_an_unknown_header_is_a_warning(eadp, tmp_path):
    path = tmp_path / "warn.plan"
    path.write_text("%: colour blue\n0.1; 90; x\n0, 4\n")
    answer = eadp("plan", path)
    assert answer.code == 0
    assert f"{path}:1:3: warning: unknown header colour" in answer.err
    findings = json.loads(eadp("plan", path, "--format", "json").out)["findings"]
    assert [item["code"] for item in findings] == ["unknown-header"]
