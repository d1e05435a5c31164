"""Documents that commands write: each is labelled; those that eadp reads again are as their schemas."""

import json
import math
import re

import pytest
from jsonschema import Draft202012Validator

from eadp.plug_ins import OWN

PROFILE, PLAN = "profiles/pednet-letter.yaml", "plans/survey.plan"
FIELD = "cover plans/meadow.geojson --min-radius 30"
WING = "--vehicle vehicles/foam-wing.yaml"
LABELS = {"summary": "eadp.flight/1"}
"""Labels that are not eadp.KIND/1."""

PRINTED = {
    "performance": "vehicle vehicles/mapper.yaml --format json",
    "power": f"profile {PROFILE} --at fps=5 --format json",
    "profile": f"profile {PROFILE} --format json",
    "energy": "fit scenarios/example-power-log.csv --to 110 --format json",
    "plan": f"plan {PLAN} --check --format json",
    "vehicle": "fit LOG --vehicle --battery --capacity 5 --soc 1 --format json",
    "battery": "fit LOG --battery --capacity 5 --soc 1 --format json",
    "cover": f"{FIELD} {WING} --camera sony-rx1r2 --altitude 80 --pattern zamboni --format json",
    "summary": f"simulate {PLAN} --profile {PROFILE} --set time_limit_s=1 --format json",
}


def log_text():
    """A log of a wing with its airspeed, and of its battery under two loads."""
    rows = ["time_s,voltage_v,current_a,airspeed_mps"]
    for i in range(600):
        speed, current = 12 + 4 * math.sin(i / 40), 5 + 3 * math.sin(i / 40) ** 2
        rows.append(f"{i},{16.5 - i / 600 - 0.05 * current:.4f},{current:.4f},{speed:.4f}")
    return "\n".join(rows)


READ = ("profile", "energy", "vehicle", "items")
"""Kinds that eadp reads again."""

VALIDATORS, FITTED = {}, []
"""By kind, those asked for before; what `eadp fit` has printed."""


@pytest.fixture
def validate(eadp):
    """A check that a document is labelled and, where eadp reads it again, as `eadp schema KIND` says."""

    def check(kind, document):
        assert document["schema"] == LABELS.get(kind, f"eadp.{kind}/1")
        if kind not in READ:
            return
        if kind not in VALIDATORS:
            schema = json.loads(eadp("schema", kind).out)
            Draft202012Validator.check_schema(schema)
            VALIDATORS[kind] = Draft202012Validator(schema)
        VALIDATORS[kind].validate(document)
        assert not VALIDATORS[kind].is_valid({**document, "nosuch": 1})

    return check


@pytest.mark.parametrize(("kind", "words"), PRINTED.items())
def test_a_printed_document_has_its_label(eadp, validate, tmp_path, kind, words):
    log = tmp_path / "log.csv"
    log.write_text(log_text())
    answer = eadp(*words.replace("LOG", str(log)).split())
    document = json.loads(answer.out or answer.err)
    validate(kind, document)
    FITTED.extend([answer.out] * (kind == "energy"))
    if kind == "plan":
        assert document["parameters"][0]["stands_for"] == "150 - 2*sqrt(4900 + c1)"
        assert document["valid"]
        validate(kind, json.loads(eadp("plan", "plans/valley.waypoints", "--laps", "2", "--format", "json").out))


def test_every_command_that_prints_json_is_tried(eadp):
    """Another one has its document, and a schema of it."""
    printing = {name for name in OWN["commands"] if re.search(r"--format <[^>]*\bjson\b", eadp(name, "--help").out)}
    assert printing == {words.split()[0] for words in PRINTED.values()}


def files(validate, folder):
    """The kinds of the JSON files of a folder, each of which is checked."""
    kinds = set()
    for path in folder.rglob("*.json*"):
        if "inputs" in path.relative_to(folder).parts:
            continue
        if path.suffix == ".jsonl":
            continue
        document = json.loads(path.read_text())
        kind = {label: kind for kind, label in LABELS.items()}.get(
            document["schema"], document["schema"].removeprefix("eadp.").removesuffix("/1")
        )
        validate(kind, document)
        kinds.add(kind)
    return kinds


@pytest.mark.slow
def test_files_of_results_have_their_labels(eadp, validate, tmp_path):
    job, flown, flight = tmp_path / "job", tmp_path / "flown", tmp_path / "flight"
    scenario = tmp_path / "given.yaml"
    scenario.write_text("{schema: eadp.scenario/1, battery: {capacity_ah: 0.7}, step_s: 0.05}")
    words = f"{FIELD} --swath 60 {WING} --pattern dubins --scenario {scenario} --home 55.4715,10.333 --sorties auto"
    planned = eadp(*words.split(), "-o", job, "--format", "json")
    validate("sorties", json.loads(planned.out))
    assert eadp("export", job / "sortie-01.plan", "--to", "qgc", "-o", job / "m.plan").code == 0
    answer = eadp("simulate", job, "-o", flown, "--format", "json")
    validate("job", json.loads(answer.out))
    eadp("simulate", PLAN, "--scenario", "scenarios/survey.yaml", "--set", "time_limit_s=20", "-o", flight)
    found = files(validate, job) | files(validate, flown) | files(validate, flight)
    assert found == {"sorties", "items", "files", "job", "summary", "timings"}
    assert (flight / "decisions.jsonl").exists()


def test_what_fit_prints_is_flown_by(eadp, tmp_path):
    file = tmp_path / "model.json"
    file.write_text(FITTED[0] if FITTED else eadp(*PRINTED["energy"].split()).out)
    answer = eadp("simulate", PLAN, "--profile", PROFILE, "--energy", file, "--set", "time_limit_s=1")
    assert answer.code == 1
    assert "error" not in answer.err


def test_the_aircraft_that_fit_prints_is_flown(eadp, tmp_path):
    log, file, plan = tmp_path / "log.csv", tmp_path / "wing.json", tmp_path / "line.plan"
    log.write_text(log_text())
    file.write_text(eadp("fit", log, "--vehicle", "--battery", "--capacity", "5", "--soc", "1", "--format", "json").out)
    plan.write_text("0.01; 90; y\n100, 0\n")
    answer = eadp("simulate", plan, "--set", f"vehicle={file}")
    assert (answer.code, "error" in answer.err) == (0, False)
