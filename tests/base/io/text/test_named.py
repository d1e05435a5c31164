"""Files that another file names: quoted where they are ours, and else only named."""

from __future__ import annotations

import pytest

from eadp.errors import Fault, InputError
from eadp.io.plan.reader import read_plan
from eadp.io.profile.model_file import parse_profile
from eadp.io.scenario import scenario_document
from eadp.io.text.options import parse_named
from eadp.io.text.streams import Text

SECRETS = (
    "root:x:0:0:root:/root:/bin/bash\nsecret:x:1:1::/home:/bin/sh\n",
    "# a comment\nPASSWORD=secret\n",
    "[client]\npassword = secret, indeed\n",
    "-----BEGIN PRIVATE KEY-----\nsecret\n",
    "secret: {token: secret}\n",
)


@pytest.mark.parametrize("body", SECRETS)
@pytest.mark.parametrize("parse", [read_plan, parse_profile, scenario_document])
def test_what_is_not_ours_is_not_quoted(body, parse):
    with pytest.raises(InputError) as caught:
        parse_named(Text("other", body), parse, Fault("given.yaml", 3, 10, ""))
    assert str(caught.value).startswith("given.yaml:3:10: error: other is none of eadp's files, by its line ")
    for word in ("secret", "root", "PRIVATE", "client"):
        assert word not in str(caught.value)
    with pytest.raises(InputError) as caught:
        parse_named(Text("other", body), parse, None)
    assert str(caught.value).startswith("other:")


@pytest.mark.parametrize(
    ("body", "parse"),
    [
        ("% survey\n\n0.05; 90; y +\n1, 0\n", read_plan),
        ("path:\n1; 90; z\n1, 0\n", read_plan),
        ("# measured\nfps,power_w\n2,many\n", parse_profile),
        ("1,2\n2\n", parse_profile),
        ("schema: eadp.scenario/1\nwind: [\n", scenario_document),
    ],
)
def test_what_is_ours_is_quoted(body, parse):
    with pytest.raises(InputError) as caught:
        parse_named(Text("other", body), parse, Fault("given.yaml", 3, 10, ""))
    assert str(caught.value).startswith("other:")


@pytest.mark.parametrize("key", ["profile", "vehicle"])
def test_a_scenario_that_names_another_file(eadp, tmp_path, root, key):
    (tmp_path / "secrets").write_text(SECRETS[0])
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(f"schema: eadp.scenario/1\n{key}: secrets\n")
    answer = eadp("simulate", "plans/survey.plan", "--scenario", scenario)
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith(f"{scenario}:2:1: error: {tmp_path}/secrets is none of eadp's files")
    assert "bash" not in answer.err
