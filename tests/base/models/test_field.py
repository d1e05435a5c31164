"""The field of a coverage problem."""

from eadp.models.airspace import Field


def test_holes_are_no_part_of_the_area():
    # a rectangle of 30 × 20 m, less a square of 10 m and a right triangle with legs of 4 and 5 m
    outline = ((0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0))
    square = ((2.0, 2.0), (2.0, 12.0), (12.0, 12.0), (12.0, 2.0))
    triangle = ((20.0, 5.0), (20.0, 10.0), (24.0, 5.0))
    assert Field(outline).area_m2 == 600.0
    assert Field(outline, (square, triangle)).area_m2 == 600.0 - 100.0 - 10.0
