"""The examples run in the environment that they ask for: without the libraries of the tests, and of other extras."""

import importlib.metadata
import re
import subprocess
import sys
import tomllib

import pytest
from common import ROOT

EXAMPLES = [("detector.py", ()), pytest.param("vehicle.py", ("bench", "mavlink"), marks=pytest.mark.slow)]
REFUSING = """
import importlib.abc, runpy, sys
class Refusing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in REFUSED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Refusing())
"""


def installed(requirements):
    """Names of distributions that requirements bring along, those that are not installed aside."""
    found, waiting = set(), list(requirements)
    while waiting:
        name = re.match(r"[\w.-]+", waiting.pop())[0].lower().replace("_", "-")
        if name in found:
            continue
        try:
            more = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:
            continue
        found.add(name)
        waiting += [each for each in more if "extra ==" not in each]
    return found


@pytest.mark.parametrize(("example", "extras"), EXAMPLES)
def test_an_example_runs_with_what_it_asks_for(example, extras):
    for extra in extras:
        for needed in {"bench": "jsbsim", "mavlink": "pymavlink"}[extra].split():
            pytest.importorskip(needed)
    path = ROOT / "docs/examples" / example
    assert not extras or f"pip install 'eadp[{','.join(extras)}]'" in path.read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(each for name in extras for each in project["optional-dependencies"][name])]
    allowed = installed(wanted) | {"eadp", "pip", "setuptools"}
    refused = {
        module
        for module, owners in importlib.metadata.packages_distributions().items()
        if not {owner.lower().replace("_", "-") for owner in owners} & allowed
    }
    assert {"hypothesis", "pytest"} <= refused
    code = f"REFUSED = {refused!r}\n{REFUSING}\nsys.argv = [{str(path)!r}, '--help']\n"
    code += f"runpy.run_path({str(path)!r}, run_name='__main__')"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("usage: ")
