"""The sweep file: what it means, what it refuses and where, and what a run's key depends on."""

import pickle
import shutil
from pathlib import Path

import pytest

from eadp import plug_ins
from eadp.api.inputs import Files, load_flight
from eadp.errors import EadpError, InputError
from eadp.io.text.streams import read_text
from eadp.sweep.run import FlyRun
from eadp.sweep.sweep_file import load_run, read_sweep

LINE = "0.1; 90; x\n0, 400\n"
PARAMETERS = "0.1; 90; x - c1\n0, 400\n[-10, 10]\n"
SCENARIO = "schema: eadp.scenario/1\nseed: 5\nstep_s: 0.1\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "line.plan").write_text(LINE)
    (tmp_path / "other.plan").write_text(PARAMETERS)
    (tmp_path / "calm.yaml").write_text(SCENARIO)
    return tmp_path


def written(folder, body, name="sweep.yaml"):
    path = folder / name
    path.write_text(f"schema: eadp.sweep/1\n{body}")
    return str(path)


def sweep_of(path, overrides=None):
    return read_sweep(read_text(path), overrides)


def runs(sweep):
    return [sweep.run(i) for i in range(len(sweep.design))]


def test_all_parts_together(folder):
    body = """plan: line.plan
scenario: calm.yaml
grid:
  wind.speed_mps: [0, 1.5]
  planner: [static, paper]
zip: {battery.capacity_ah: [1, 2, 3], battery.soc: [1, 0.9, 0.8]}
sample: {runs: 4, seed: 3, method: latin, keys: {wind.towards_deg: {uniform: [0, 360]}, step_s: {choice: [0.1, 0.2]}}}
seeds: 2
"""
    sweep = sweep_of(written(folder, body))
    assert len(sweep.design) == 2 * 2 * 3 * 4 * 2
    last = runs(sweep)[-1]
    assert last.files == {"plan": str(folder / "line.plan"), "scenario": str(folder / "calm.yaml")}
    fixed = {"wind.speed_mps": 1.5, "planner.name": "paper", "battery.capacity_ah": 3, "battery.soc": 0.8, "seed": 1}
    assert last.overrides.keys() - fixed == {"wind.towards_deg", "step_s"}
    assert last.overrides.items() > fixed.items()
    assert 0 < last.overrides["wind.towards_deg"] < 360
    assert len({run.key for run in runs(sweep)}) == 96


def test_the_seed_is_the_designs_else_the_keys_else_the_scenarios(folder):
    head = "plan: line.plan\nscenario: calm.yaml\n"
    assert [run.overrides["seed"] for run in runs(sweep_of(written(folder, head)))] == [5]
    varied = sweep_of(written(folder, f"{head}grid: {{seed: [8, 9]}}\n"))
    assert [run.overrides["seed"] for run in runs(varied)] == [8, 9]
    assert [run.overrides["seed"] for run in runs(sweep_of(written(folder, f"{head}seeds: 3\n")))] == [0, 1, 2]
    assert runs(sweep_of(written(folder, "plan: line.plan\n")))[0].overrides == {"seed": 0}
    fixed = sweep_of(written(folder, head), {"seed": 4})
    assert runs(fixed)[0].overrides == {"seed": 4}


def test_files_may_be_varied(folder):
    (folder / "windy.yaml").write_text(SCENARIO.replace("5", "6") + "wind: {speed_mps: 3}\n")
    body = "grid: {plan: [line.plan, other.plan], scenario: [calm.yaml, windy.yaml]}\n"
    sweep = sweep_of(written(folder, body))
    assert [run.files["plan"].rpartition("/")[2] for run in runs(sweep)] == ["line.plan"] * 2 + ["other.plan"] * 2
    assert [run.overrides["seed"] for run in runs(sweep)] == [5, 6] * 2


def test_a_key_depends_on_contents_and_values_alone(folder):
    body = "plan: {}\nscenario: {}\ngrid: {{wind.speed_mps: [1]}}\n"

    def key(plan="line.plan", scenario="calm.yaml", text=body):
        return runs(sweep_of(written(folder, text.format(plan, scenario))))[0].key

    first = key()
    (folder / "deep").mkdir()
    (folder / "deep/copy.plan").write_bytes(LINE.replace("\n", "\r\n").encode())
    assert key("deep/copy.plan") == first
    assert key(text=body + "seeds: 6\n") != first
    assert key(text=body.replace("[1]", "[2]")) != first
    (folder / "calm.yaml").write_text(SCENARIO + "time_limit_s: 60\n")
    changed = key()
    assert changed != first
    (folder / "line.plan").write_text(LINE.replace("400", "401"))
    assert key() not in (changed, first)


def test_the_key_depends_on_the_profile_that_the_scenario_names(folder, root):
    profile = (root / "profiles/pednet-letter.csv").read_text()
    (folder / "p.csv").write_text(profile)
    (folder / "calm.yaml").write_text(f"{SCENARIO}profile: p.csv\n")
    path = written(folder, "plan: line.plan\nscenario: calm.yaml\n")
    first = runs(sweep_of(path))[0].key
    (folder / "p.csv").write_text(profile + "\n")
    assert runs(sweep_of(path))[0].key != first
    (folder / "p.csv").unlink()
    with pytest.raises(InputError, match=r"p\.csv:1:1: error: cannot be read"):
        sweep_of(path)


def test_the_key_depends_on_the_code_of_eadp_and_of_plug_ins(folder, monkeypatch, tmp_path):
    path, keys = written(folder, "plan: line.plan\n"), []

    def note():
        plug_ins.code_identity.cache_clear()
        plug_ins.sources_hash.cache_clear()
        keys.append(runs(sweep_of(path))[0].key)

    note()
    about = tmp_path / "meek-0.1.dist-info"
    about.mkdir()
    (about / "entry_points.txt").write_text("[eadp.planners]\nmeek = meek:Meek\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    for version, source in (("0.1", "a = 1"), ("0.2", "a = 1"), ("0.2", "a = 2")):
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: meek\nVersion: {version}\n")
        (tmp_path / "meek.py").write_text(source)
        note()
    changed = tmp_path / "eadp"
    shutil.copytree(Path(plug_ins.__file__).parent, changed)
    (changed / "core/flight.py").write_text("a = 1")
    places = plug_ins._places
    monkeypatch.setattr(plug_ins, "_places", lambda names: (changed,) if names == ["eadp"] else places(names))
    note()
    assert len({*keys}) == 5
    plug_ins.code_identity.cache_clear()


def test_a_run_is_the_flight_of_simulate_and_needs_no_files(folder, root):
    from eadp.api.flight import summarise
    from eadp.simulation.loop import Outcome, fly

    body = f"plan: {root}/plans/survey.plan\nscenario: {root}/scenarios/survey.yaml\ngrid: {{wind.speed_mps: [4]}}\n"
    sweep = sweep_of(written(folder, body), {"time_limit_s": 30, "wind.gust_std_mps": 1})
    run = sweep.run(0)
    make = pickle.loads(pickle.dumps(FlyRun(sweep.kept)))
    summary = make(run).summary
    inputs = load_flight(run.files["plan"], scenario=run.files["scenario"], overrides=run.overrides)
    pilot, outcome = inputs.flight(), Outcome()
    list(fly(inputs.world, pilot, outcome))
    expected = summarise(inputs.world, pilot, outcome, inputs.scenario.planner)
    expected["solver"] = {key: value for key, value in expected["solver"].items() if not key.endswith("_ms")}
    assert summary == expected
    assert make(run).summary == summary, "a second run from what is kept is the same"


def test_what_goes_wrong_is_the_runs_error(folder):
    sweep = sweep_of(written(folder, "plan: other.plan\ngrid: {c1: [0, 11]}\n"))
    make = FlyRun(sweep.kept)
    result = make(sweep.run(1))
    assert result.summary is None
    assert result.error == "c1 = 11 is outside its set; expected a value in [-10, 10]"


# --- what is refused

HEAD = "plan: line.plan\nscenario: calm.yaml\n"
DRAWN = HEAD + "sample: {runs: 2, keys: {battery.soc: "
BAD = {
    "no plan": ("scenario: calm.yaml\n", "1:1", "no plan to fly"),
    "unknown key": ("plan: line.plan\nplam: x\n", "3:1", "unknown key plam"),
    "missing plan": ("plan: none.plan\n", "2:1", "none.plan cannot be read"),
    "no such scenario key": (HEAD + "grid:\n  wind.speed: [1]\n", "5:16", "unknown key wind.speed"),
    "no key": (HEAD + "grid: {wind speed: [1]}\n", "4:8", "wind speed is not a key"),
    "no list": (HEAD + "grid: {wind.speed_mps: 3}\n", "4:8", "a list"),
    "zip lengths": (HEAD + "zip: {battery.soc: [1, 1], wind.speed_mps: [1]}\n", "4:28", "has 1 values"),
    "twice": (HEAD + "grid: {c1: [1]}\nzip: {parameters.c1: [2]}\n", "5:7", "set the same key"),
    "one wind": (HEAD + "grid: {wind.from_deg: [0]}\nzip: {wind.towards_deg: [9]}\n", "5:7", "set the same key"),
    "seeds and seed": (HEAD + "grid: {seed: [1]}\nseeds: 2\n", "5:1", "the key seed too"),
    "drawn twice": (DRAWN + "{uniform: [0.5, 1], choice: [1]}}}\n", "4:26", "has 2 distributions"),
    "drawn out of range": (DRAWN + "{uniform: [0.5, 1.5]}}}\n", "4:55", "battery.soc cannot be 1.5"),
    "deviation": (DRAWN + "{normal: [1, -1]}}}\n", "4:40", "below 0"),
    "file drawn": ("sample: {runs: 2, keys: {plan: {uniform: [1, 2]}}}\n", "2:26", "plan is a file"),
    "too many": (HEAD + "seeds: 1000\nsample: {runs: 1001, keys: {step_s: {uniform: [0.1, 1]}}}\n", "1:1", "1000000"),
    "alias": ("plan: &a line.plan\n", "2:7", "alias"),
}


@pytest.mark.parametrize("name", BAD)
def test_faults_have_their_places(folder, name):
    body, place, words = BAD[name]
    path = written(folder, body)
    with pytest.raises(InputError) as caught:
        sweep_of(path)
    found = [fault for fault in caught.value.faults if f"{fault.line}:{fault.column}" == place]
    assert found, str(caught.value)
    assert any(words in str(fault) for fault in found), str(caught.value)
    assert all(fault.file == path for fault in caught.value.faults)


def test_faults_of_other_files_are_theirs(folder):
    (folder / "bad.plan").write_text("0.1; 45; x\n0, 400\n")
    with pytest.raises(InputError, match=r"bad\.plan:1:6: error: 45 cannot stand here"):
        sweep_of(written(folder, "grid: {plan: [line.plan, bad.plan]}\n"))
    (folder / "calm.yaml").write_text(SCENARIO + "wind: 3\n")
    with pytest.raises(InputError, match=r"calm\.yaml:4:1: error"):
        sweep_of(written(folder, HEAD))


@pytest.mark.parametrize("body", ["", "- 1\n", "schema: eadp.scenario/1\n"])
def test_what_is_no_sweep_file(folder, body):
    (folder / "sweep.yaml").write_text(body)
    with pytest.raises(InputError, match=r"sweep\.yaml:1:1: error"):
        sweep_of(str(folder / "sweep.yaml"))


@pytest.mark.parametrize("key", ["wind.speed_mps", "plan", "seed", "wind"])
def test_what_is_set_in_every_run_is_not_varied(folder, key):
    path = written(folder, HEAD + "grid: {wind.speed_mps: [1]}\nseeds: 2\n")
    with pytest.raises(InputError, match="--set:1:1: error"):
        sweep_of(path, {key: 1})


def test_another_versions_work_is_refused(folder, monkeypatch):
    pickled = pickle.dumps(FlyRun(sweep_of(written(folder, "plan: line.plan\n")).kept))
    monkeypatch.setitem(FlyRun.__setstate__.__globals__, "code_identity", lambda: "eadp 99")
    with pytest.raises(EadpError, match=r"it has eadp 99, and the sender eadp 0"):
        pickle.loads(pickled)


def test_workers_are_sent_texts_and_not_what_was_read_of_them(folder):
    kept = sweep_of(written(folder, "plan: line.plan\n")).kept
    assert len(pickle.dumps(kept)) == len(pickle.dumps(Files({path: read_text(path) for path in kept.texts})))


def test_vehicle_files_are_read_once_and_told_apart(folder):
    """A sweep over the vehicle, and over keys of one; the content of the file is part of a run's key."""
    (folder / "fast.yaml").write_text("schema: eadp.vehicle/1\nairframe: {airspeed_mps: 20}\n")
    (folder / "slow.yaml").write_text("schema: eadp.vehicle/1\nairframe: {airspeed_mps: 12}\n")
    content = f"plan: line.plan\ngrid: {{vehicle: [{folder}/fast.yaml, {folder}/slow.yaml]}}\n"
    sweep = sweep_of(written(folder, content))
    files = pickle.loads(pickle.dumps(sweep.kept))
    keys = [sweep.run(k).key for k in range(2)]
    (folder / "slow.yaml").write_text("schema: eadp.vehicle/1\nairframe: {airspeed_mps: 13}\n")
    assert [load_run(files, sweep.run(k)).world.mission.vehicle.airspeed_mps for k in range(2)] == [20, 12]
    again = sweep_of(written(folder, content))
    assert [again.run(k).key == keys[k] for k in range(2)] == [True, False]
    masses = sweep_of(written(folder, "plan: line.plan\ngrid: {vehicle.airframe.mass_kg: [1, 1.5]}\n"))
    assert load_run(masses.kept, masses.run(1)).world.mission.vehicle.mass_kg == 1.5
    with pytest.raises(InputError, match=r"unknown key vehicle\.mass_kg; expected vehicle\.airframe\.mass_kg"):
        sweep_of(written(folder, "plan: line.plan\ngrid: {vehicle.mass_kg: [1, 1.5]}\n"))
