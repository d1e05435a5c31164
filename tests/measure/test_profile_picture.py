"""Pictures of profiles, for each kind of model."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from eadp.errors import InputError
from eadp.measure.figures import CURVES, MARKS, _draw_profile, write_profile_figure
from eadp.models.profile import Profile

FPS = np.array([[2.0], [4.0], [10.0]])
LINE = Profile(
    ("fps",), ("1/s",), FPS, np.array([5.0, 7, 9]), np.array([0.5, 0.5, 0.5]), np.array([90, 90, 90]), "pchip", "",
    np.array([0.1, 0.1, 0.1]),
)  # fmt: skip
GRID = Profile(
    ("fps", "keysize", "mode"),
    ("", "bit", ""),
    np.array([[a, b, 1] for a in (2, 4, 10) for b in range(9)]),
    np.arange(27.0),
)
SCATTER = Profile(("a", "b"), ("", ""), np.array([[0, 0], [1, 0.1], [0.2, 1], [1, 1], [0.5, 0.4]]), np.arange(5.0))


def drawn(profile: Profile) -> Figure:
    figure = Figure()
    _draw_profile(figure.add_subplot(), profile)
    return figure


def labels(profile: Profile) -> list[str]:
    axes = drawn(profile).axes[0]
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_a_curve_goes_through_what_was_measured() -> None:
    assert labels(LINE) == ["model", "measured", "± 1 standard deviation", "± 2 standard errors"]
    axes = drawn(LINE).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("fps [1/s]", "power [W]")
    curve = next(line for line in axes.lines if line.get_label() == "model")
    at = dict(zip(*curve.get_data(), strict=True))
    assert [at[fps] for fps in (2, 4, 10)] == [5, 7, 9]


def test_a_grid_is_a_family_of_few_curves() -> None:
    named = [label for label in labels(GRID) if label not in MARKS]
    assert len(named) == 3, "along the parameter of the most levels, a curve for each level of the other"
    assert named == ["fps = 2", "fps = 4", "fps = 10"]
    wide = Profile(("a", "b"), ("", ""), np.array([[a, b] for a in range(9) for b in range(9)]), np.arange(81.0))
    named = [label for label in labels(wide) if label not in MARKS]
    assert (len(named), named[0], named[-1]) == (CURVES, "b = 0", "b = 8")


def test_scattered_points_of_several_parameters_have_no_picture() -> None:
    with pytest.raises(InputError, match="of 2 parameters have no picture"):
        drawn(SCATTER)


def test_files_are_the_same_each_time(tmp_path: Path) -> None:
    files = [tmp_path / f"{i}.svg" for i in (1, 2)]
    for file in files:
        write_profile_figure(str(file), LINE)
    assert files[0].read_bytes() == files[1].read_bytes()
    with pytest.raises(InputError, match=r"expected a name that ends in \.svg or \.png"):
        write_profile_figure(str(tmp_path / "x.pdf"), LINE)
