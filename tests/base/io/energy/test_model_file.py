"""Energy models in files: written and read back the same, or refused at the place that is wrong."""

import json
from functools import partial

import pytest
from common.answers import faults_by
from hypothesis import given
from hypothesis import strategies as st

from eadp.io.energy import EnergyFile, energy_document, energy_yaml, parse_energy
from eadp.io.text.streams import Text
from eadp.io.text.yaml import schema_of
from eadp.models.energy import EnergyModel, Harmonic

HARMONICS = (Harmonic(2.1, 0.8), Harmonic(1e-9, -3.0))
MODEL = EnergyModel(46.05, 36.4, HARMONICS, 0.5, 0.01, 0.93, 2303, 230.2, 0.03, (0.04, 0.05))
MINIMAL = "schema: eadp.energy/1\nperiod_s: 46\nmean_w: 36.4\nharmonics: []\n"

spreads, powers = st.floats(0, 1e6), st.floats(1e-3, 1e6)
harmonics = st.lists(st.builds(Harmonic, spreads, st.floats(-3.2, 3.2)), max_size=6).map(tuple)
statistics = {
    "noise_std_w": spreads,
    "cv_r2": st.floats(-10, 1),
    "samples": st.integers(0, 10**6),
    "span_s": spreads,
    "mean_std_w": st.none() | spreads,
}
periodic = st.builds(
    EnergyModel, st.floats(1e-3, 1e6), powers, harmonics, period_std_s=st.none() | spreads, **statistics
)
aperiodic = st.builds(EnergyModel, st.none(), powers, **statistics)


def parse(body: str) -> EnergyModel:
    return parse_energy(Text("m.yaml", body))


faults_of = partial(faults_by, parse, name="m.yaml")


@given(periodic | aperiodic)
def test_what_is_written_is_read_back(model: EnergyModel) -> None:
    assert parse(energy_yaml(model)) == model
    assert parse(json.dumps(energy_document(model))) == model, "JSON is YAML"


def test_what_can_be_derived_may_be_left_out() -> None:
    assert parse(MINIMAL) == EnergyModel(46, 36.4)
    with_harmonic = MINIMAL.replace("[]", "[{amplitude_w: 2, phase_rad: 0}]")
    assert parse(with_harmonic).coefficients.a[1] == 46
    # a cosine has no sine: a hand-written 0 agrees with a rounded one
    assert parse(with_harmonic + "coefficients: {a: [1674.4, 46], b: [0]}\n").order == 1


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("mean_w: 36.4", "mean_w: .nan", "3:9: error: .nan is not a finite number; expected a finite number"),
        ("mean_w: 36.4", "mean_w: true", "3:1: error: mean_w cannot be True; expected a number"),
        ("mean_w: 36.4\n", "", "1:1: error: the key mean_w is missing"),
        ("period_s: 46", "period_s: 0", "2:1: error: period_s cannot be 0; expected greater than 0"),
        ("mean_w: 36.4", "mean_w: 1\nmean_w: 2", "4:1: error: the key mean_w stands twice; expected it once"),
        ("period_s: 46", "period_s: null", "4:1: error: harmonics without a period; expected a period_s, or []"),
        ("amplitude_w: 1", "amplitude_w: -1", "4:14: error: harmonics.0.amplitude_w cannot be -1; expected greater"),
        ("}]", "}]\namplitude_std_w: [1, 2]", "5:1: error: 2 standard deviations of amplitudes; expected 1, the num"),
        ("}]", "}]\norder: 2", "5:1: error: order is 2; expected 1, by period_s and harmonics"),
        ("}]", "}]\nperiodic: false", "5:1: error: periodic is false; expected true, by period_s and harmonics"),
        (
            "}]",
            "}]\ncoefficients: {a: [1674, 46], b: [0]}",
            "5:1: error: the coefficients are not of the other keys; exp",
        ),
        ("}]", "}]\ncoefficients: {a: [1674.4], b: []}", "5:1: error: the coefficients are not of the other keys; exp"),
        ("mean_w: 36.4", "mean_w: -36.4", "3:1: error: mean_w cannot be -36.4; expected greater than 0"),
        ("energy/1", "profile/1", "1:1: error: is a file of eadp.profile/1; expected schema: eadp.energy/1"),
    ],
)
def test_faults_and_their_places(old: str, new: str, fault: str) -> None:
    (found,) = faults_of(MINIMAL.replace("[]", "[{amplitude_w: 1, phase_rad: 0}]").replace(old, new))
    assert found.startswith(fault)


@pytest.mark.parametrize("body", ["", "[]", "3", "schema: 1"])
def test_what_is_no_model(body: str) -> None:
    (fault,) = faults_of(body)
    assert fault.endswith("schema: eadp.energy/1")


def test_unknown_keys_are_refused_with_all_other_faults() -> None:
    faults = faults_of(MINIMAL.replace("mean_w: 36.4", "mean: 36.4") + "noise_std_w: -1\n")
    assert [fault.split(":")[0] for fault in faults] == ["1", "3", "5"]
    assert "unknown key mean" in faults[1]


def test_schema_names_every_key_of_the_document() -> None:
    schema = schema_of(EnergyFile)
    assert set(schema["properties"]) > set(energy_document(MODEL))  # those of a fit, too
    assert set(schema["required"]) <= set(energy_document(MODEL))
