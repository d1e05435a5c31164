"""Reading the profile of the computations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eadp.api.given import File, Warn, python_warnings
from eadp.errors import Fault
from eadp.io.profile import model_file
from eadp.io.text.streams import read_text
from eadp.models.profile import Profile

if TYPE_CHECKING:
    from eadp.io.scenario import Scenario


def profile_of_scenario(setting: Scenario) -> tuple[Profile | None, list[Fault]]:
    """The profile that a scenario names, None where it names none, and warnings.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    if setting.profile_path is None:
        return None, []
    return model_file.parse_profile(read_text(setting.profile_path))


def read_profile(file: File, *, warn: Warn = python_warnings) -> Profile:
    """Read a computation profile.

    Parameters
    ----------
    file : str or path
        Measurements (CSV) or a model (YAML), `-` for standard input.
    warn : function, optional

    Raises
    ------
    InputError
        With the faults of the file.
    """
    profile, found = model_file.read_profile(str(file))
    warn(found)
    return profile
