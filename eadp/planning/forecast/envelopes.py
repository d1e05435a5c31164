"""Configurations of the computations on each stage, and the concave envelope of their value over their power.

Each stage is a class of a multiple-choice knapsack: its configurations have a power and a value, and a mix of two of
them lies between. The best mixes lie on the upper concave envelope, from the configuration of minimum power on.

Source: Sinha and Zoltners 1979.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.envelope import upper_envelope
from eadp.errors import Infeasible
from eadp.models.plan.cursor import Vector
from eadp.models.plan.ground import QualityShares
from eadp.models.plan.leg_table import LegTable
from eadp.models.plan.stage import Box, Stage
from eadp.planning.base import Mission, PlannerSettings, TradeOff, allowed_levels, thinned

MAX_CONFIGURATIONS = 50_000


class ConcaveEnvelope(NamedTuple):
    """Upper concave envelope of value over power, in ascending order of power.

    Attributes
    ----------
    powers_w, values : array, shape (k,)
        Power [W] and value of each configuration, both rising.
    configurations : array, shape (k, computations)
    """

    powers_w: FloatArray
    values: FloatArray
    configurations: FloatArray


def concave_envelope(powers_w: FloatArray, values: FloatArray, configurations: FloatArray) -> ConcaveEnvelope:
    """Upper concave envelope of configurations: the one of minimum power, and the vertices above it.

    Parameters
    ----------
    powers_w, values : array, shape (n,)
    configurations : array, shape (n, computations)
    """
    order = np.lexsort((-values, powers_w))
    kept = order[upper_envelope(powers_w[order], values[order])]
    return ConcaveEnvelope(powers_w[kept], values[kept], configurations[kept])


class _Group(NamedTuple):
    """All configurations of a kind of stage, in ascending order of power [W], and their values."""

    configurations: FloatArray
    powers_w: FloatArray
    values: FloatArray


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
    total : bool
        Whether the value is the weighted sum of the computations, in place of U.
    """

    def __init__(
        self, mission: Mission, settings: PlannerSettings, trade_offs: Sequence[TradeOff], *, total: bool
    ) -> None:
        self._mission, self._settings, self._trade_offs, self._total = mission, settings, trade_offs, total
        self._rho = mission.plan.path_count
        self.shares = QualityShares(mission.plan, settings.weights)
        self._groups: list[_Group] = []
        self._numbers: dict[object, int] = {}
        """Of a group, by what determines it."""
        self._kinds: dict[tuple[int, int], int] = {}
        """Number of an envelope, by its group and by how many of its configurations count."""
        self._envelopes: list[ConcaveEnvelope] = []
        self._table = EnvelopeTable(np.zeros((0, 1)), np.zeros((0, 1)))
        # a leg table, and the group of each of its rows
        self._of_rows: tuple[LegTable | None, IntArray] = (None, np.zeros(0, dtype=np.intp))
        self._extremes_w = np.zeros((0, 2))

    def __getitem__(self, kind: int) -> ConcaveEnvelope:
        return self._envelopes[kind]

    @property
    def table(self) -> EnvelopeTable:
        """The envelopes as arrays."""
        if len(self._table.powers_w) < len(self._envelopes):
            width = max(len(envelope.powers_w) for envelope in self._envelopes)
            rows = [
                [np.pad(each, (0, width - len(each)), mode="edge") for each in envelope[:2]]
                for envelope in self._envelopes
            ]
            self._table = EnvelopeTable(np.array([row[0] for row in rows]), np.array([row[1] for row in rows]))
        return self._table

    def groups(self, table: LegTable, order: IntArray) -> IntArray:
        """Group of each leg, by its row in a table, shape (legs,). A table only grows: rows that are known stay."""
        of_table, known = self._of_rows
        # rows that are new get a group; all, where the table is another one
        if of_table is not table:
            known = known[:0]
        if len(known) < len(table.stages):
            rest = slice(len(known), None)
            new = [
                self._group(stage, own) for stage, own in zip(table.stages[rest], table.parameters[rest], strict=True)
            ]
            known = np.concatenate((known, new))
            self._of_rows = table, known
        groups: IntArray = known[order]
        return groups

    def extremes_w(self) -> FloatArray:
        """Least and greatest power of each group [W], shape (groups, 2)."""
        if len(self._extremes_w) < len(self._groups):
            self._extremes_w = np.array([(group.powers_w[0], group.powers_w[-1]) for group in self._groups])
        return self._extremes_w

    def kinds(self, groups: IntArray, room_w: FloatArray, truncated: BoolArray) -> IntArray:
        """The envelope of each leg: of all configurations of its group, or where truncated of those that fit."""
        whole = [self._kind(i, len(group.powers_w)) for i, group in enumerate(self._groups)]
        kinds: IntArray = np.array(whole, dtype=np.intp)[groups]
        for leg in np.flatnonzero(truncated).tolist():
            count = int(self._groups[groups[leg]].powers_w.searchsorted(room_w[leg], side="right"))
            kinds[leg] = self._kind(int(groups[leg]), max(count, 1))
        return kinds

    def _kind(self, group: int, count: int) -> int:
        """The number of the envelope of a group's first configurations, which is built at first."""
        number = self._kinds.setdefault((group, count), len(self._envelopes))
        if number == len(self._envelopes):
            configurations, powers_w, values = self._groups[group]
            self._envelopes.append(concave_envelope(powers_w[:count], values[:count], configurations[:count]))
        return number

    def _group(self, stage: Stage, own: Vector) -> int:
        """The number of the group of a stage with parameters `own`, which is built at first."""
        trade_offs = [row for row in self._trade_offs if row.holds_in(stage.index)]
        path = own[: self._rho] if trade_offs else ()
        weights = self.shares.weights if self._total else self.shares.scaled(stage.index)
        sets = tuple((box.lo, box.hi) for box in stage.sets[self._rho :])
        key = (sets, path, tuple(weights[self._rho :].tolist()), tuple(map(id, trade_offs)))
        number = self._numbers.setdefault(key, len(self._groups))
        if number == len(self._groups):
            configurations, powers_w = self._listed(stage.sets, own, trade_offs)
            values = self._values(configurations, stage.sets, weights)
            self._groups.append(_Group(configurations, powers_w, values))
        return number

    def _values(self, configurations: FloatArray, sets: Sequence[Box], weights: FloatArray) -> FloatArray:
        """Value of configurations: Σ ω c̃, or Σ ω c for the total."""
        values = np.zeros(len(configurations))
        for k, box in enumerate(sets[self._rho :]):
            column, weight = configurations[:, k], weights[self._rho + k]
            if self._total:
                values += weight * column
            elif not box.fixed:
                values += weight * (column - box.lo) / (box.hi - box.lo)
        return values

    def _listed(
        self, sets: Sequence[Box], own: Vector, trade_offs: Sequence[TradeOff]
    ) -> tuple[FloatArray, FloatArray]:
        """Configurations of a stage within the trade-offs, and their powers [W], in ascending order of power."""
        rho, names, computing = self._rho, self._mission.plan.names, self._mission.computing
        levels = thinned(
            [
                allowed_levels(self._settings, self._mission, rho + k, box, measured=True)
                for k, box in enumerate(sets[rho:])
            ],
            MAX_CONFIGURATIONS,
        )
        rows, powers = [], []
        for choice in itertools.islice(itertools.product(*levels), MAX_CONFIGURATIONS):
            values = (*own[:rho], *choice)
            named = list(zip(names, values, strict=True))
            if any(
                sum(row.coefficients.get(name, 0.0) * value for name, value in named) < row.at_least - 1e-9
                for row in trade_offs
            ):
                continue
            try:
                powers.append(computing.power_w(values, sets))
            except Infeasible:
                continue
            rows.append(choice)
        if not rows:  # no configuration satisfies the trade-offs: the lowest levels, as where nothing is feasible
            rows = [tuple(values[0] for values in levels)]
            powers = [computing.power_w((*own[:rho], *rows[0]), sets)]
        order = np.argsort(powers, kind="stable")
        return np.array(rows, dtype=float).reshape(len(rows), len(levels))[order], np.array(powers)[order]
