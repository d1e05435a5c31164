"""Configurations of the computations on each stage, and the concave envelope of their value over their power.

Each stage is a class of a multiple-choice knapsack: its configurations have a power and a value, and a mix of two of
them lies between. The best mixes lie on the upper concave envelope, from the configuration of minimum power on.

Source: Sinha and Zoltners 1979.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray, upper_envelope
from eadp.errors import Infeasible
from eadp.models.plan.cursor import Vector
from eadp.models.plan.ground import QualityShares
from eadp.models.plan.route import LegTable
from eadp.models.plan.stage import Box, Stage
from eadp.models.world import Mission
from eadp.planning.base import PlannerSettings, TradeOff, allowed_levels, thinned

MAX_CONFIGURATIONS = 50_000


class Configurations(NamedTuple):
    """Configurations in ascending order of power: all of a kind of stage, or those on the envelope.

    Attributes
    ----------
    powers_w, values : array, shape (n,)
        Power [W] and value of each.
    configurations : array, shape (n, computations)
    """

    powers_w: FloatArray
    values: FloatArray
    configurations: FloatArray

    def envelope(self, count: int) -> Configurations:
        """Upper concave envelope of the first `count`: the one of minimum power, and the vertices above it."""
        powers_w, values = self.powers_w[:count], self.values[:count]
        order = np.lexsort((-values, powers_w))
        kept = order[upper_envelope(powers_w[order], values[order])]
        return Configurations(*(column[kept] for column in self))


class EnvelopeTable(NamedTuple):
    """The envelopes known, one a row; rows are filled up with their last vertex.

    Attributes
    ----------
    powers_w, values : array, shape (kinds, vertices)
    """

    powers_w: FloatArray
    values: FloatArray


class Envelopes:
    """Envelopes of a mission, each built once.

    A kind is a group of configurations up to a power: stages with the same sets and weights have one group, and
    the battery may exclude its upper configurations.

    Parameters
    ----------
    mission : Mission
    settings : PlannerSettings
        Weights and levels are used here.
    trade_offs : sequence of TradeOff
        Rows that the configurations keep to.
    """

    def __init__(self, mission: Mission, settings: PlannerSettings, trade_offs: Sequence[TradeOff]) -> None:
        self._mission, self._settings, self._trade_offs = mission, settings, trade_offs
        self._rho = mission.plan.path_count
        self.shares = QualityShares(mission.plan, settings.weights)
        self._groups: list[Configurations] = []
        self._numbers: dict[object, int] = {}
        """Number of each group, by what determines it."""
        self._kinds: dict[tuple[int, int], int] = {}
        """Number of each envelope, by its group and by how many of its configurations count."""
        self._envelopes: list[Configurations] = []
        self._table = EnvelopeTable(np.zeros((0, 1)), np.zeros((0, 1)))
        # a leg table, and the group of each of its rows
        self._of_rows: tuple[LegTable | None, IntArray] = (None, np.zeros(0, dtype=np.intp))

    def __getitem__(self, kind: int) -> Configurations:
        return self._envelopes[kind]

    @property
    def table(self) -> EnvelopeTable:
        """The envelopes built so far, as arrays."""
        if len(self._table.powers_w) < len(self._envelopes):
            width = max(len(envelope.powers_w) for envelope in self._envelopes)
            powers_w, values = (
                np.array([np.pad(row, (0, width - len(row)), mode="edge") for row in rows])
                for rows in zip(*((envelope.powers_w, envelope.values) for envelope in self._envelopes), strict=True)
            )
            self._table = EnvelopeTable(powers_w, values)
        return self._table

    def groups(self, table: LegTable, order: IntArray) -> IntArray:
        """Group of the configurations of each leg, shape (legs,); `order` are the legs' rows in a table.

        A table only grows: the groups of rows that were looked up before are kept.
        """
        of_table, of_rows = self._of_rows
        # new rows get a group; all of them where the table is another one
        if of_table is not table:
            of_rows = of_rows[:0]
        if len(of_rows) < len(table.stages):
            rest = slice(len(of_rows), None)
            rows = zip(table.stages[rest], table.parameters[rest], strict=True)
            of_rows = np.concatenate((of_rows, [self._group(stage, parameters) for stage, parameters in rows]))
            self._of_rows = table, of_rows
        groups: IntArray = of_rows[order]
        return groups

    def extremes_w(self) -> FloatArray:
        """Least and greatest power of each group [W], shape (groups, 2)."""
        return np.array([(group.powers_w[0], group.powers_w[-1]) for group in self._groups])

    def kinds(self, groups: IntArray, room_w: FloatArray, truncated: BoolArray) -> IntArray:
        """Number of the envelope of each leg: of all configurations of its group, or where truncated of those that fit.

        `groups`, `room_w`, the power that the battery leaves for the computations [W], and `truncated` have the shape
        (legs,).
        """
        whole = [self._kind(i, len(group.powers_w)) for i, group in enumerate(self._groups)]
        kinds: IntArray = np.array(whole, dtype=np.intp)[groups]
        for leg in np.flatnonzero(truncated).tolist():
            count = int(self._groups[groups[leg]].powers_w.searchsorted(room_w[leg], side="right"))
            kinds[leg] = self._kind(int(groups[leg]), max(count, 1))
        return kinds

    def _kind(self, group: int, count: int) -> int:
        """The number of the envelope of a group's first `count` configurations, built when it is first asked for."""
        number = self._kinds.setdefault((group, count), len(self._envelopes))
        if number == len(self._envelopes):
            self._envelopes.append(self._groups[group].envelope(count))
        return number

    def _group(self, stage: Stage, own: Vector) -> int:
        """The number of the group of a stage with parameters `own`; built when it is first asked for.

        What determines a group is its key: sets, weights and trade-offs, and with these the path parameters.
        """
        trade_offs = [row for row in self._trade_offs if row.holds_in(stage.index)]
        path = own[: self._rho] if trade_offs else ()
        weights = self.shares.scaled(stage.index)
        sets = tuple((box.lo, box.hi) for box in stage.sets[self._rho :])
        key = (sets, path, tuple(weights[self._rho :].tolist()), tuple(map(id, trade_offs)))
        number = self._numbers.setdefault(key, len(self._groups))
        if number == len(self._groups):
            configurations, powers_w = self._by_power(stage.sets, own, trade_offs)
            values = self._values(configurations, stage.sets, weights)
            self._groups.append(Configurations(powers_w, values, configurations))
        return number

    def _values(self, configurations: FloatArray, sets: Sequence[Box], weights: FloatArray) -> FloatArray:
        """Value of configurations: Σ ω c̃."""
        values = np.zeros(len(configurations))
        for k, box in enumerate(sets[self._rho :]):
            if not box.fixed:
                values += weights[self._rho + k] * (configurations[:, k] - box.lo) / (box.hi - box.lo)
        return values

    def _by_power(
        self, sets: Sequence[Box], own: Vector, trade_offs: Sequence[TradeOff]
    ) -> tuple[FloatArray, FloatArray]:
        """Configurations of a stage within the trade-offs, and their powers [W], in ascending order of power.

        Of levels of each computation, with at most `MAX_CONFIGURATIONS` combinations; the lowest levels alone where no
        configuration is within the trade-offs, as where nothing is feasible.
        """
        path, computing = own[: self._rho], self._mission.computing
        levels = [
            allowed_levels(self._settings, self._mission, i, box, measured=True)
            for i, box in enumerate(sets[self._rho :], self._rho)
        ]
        levels = thinned(levels, MAX_CONFIGURATIONS)
        configurations, powers_w = [], []
        for configuration in itertools.islice(itertools.product(*levels), MAX_CONFIGURATIONS):
            parameters = (*path, *configuration)
            if not self._within(trade_offs, parameters):
                continue
            with suppress(Infeasible):
                powers_w.append(computing.power_w(parameters, sets))
                configurations.append(configuration)
        if not configurations:
            configurations = [tuple(low for low, *_ in levels)]
            powers_w = [computing.power_w((*path, *configurations[0]), sets)]
        order = np.argsort(powers_w, kind="stable")
        shape = len(configurations), len(levels)  # where there are no computations, too
        return np.array(configurations, dtype=float).reshape(shape)[order], np.array(powers_w)[order]

    def _within(self, trade_offs: Sequence[TradeOff], parameters: Vector) -> bool:
        """Whether parameters keep to the trade-offs: R c ≥ r."""
        named = list(zip(self._mission.plan.names, parameters, strict=True))
        return all(
            sum(row.coefficients.get(name, 0.0) * value for name, value in named) >= row.at_least - 1e-9
            for row in trade_offs
        )
