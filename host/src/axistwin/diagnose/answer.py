"""The answer in numbers: parameters with intervals, gains, errors, and the evidence for them.

Which effects there are has been decided on held-out windows, and the errors are those of them. For
the parameters of the answer all windows are then fitted, so that nothing of the record is wasted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.signal
import scipy.stats

from axistwin.core import Array, Axis, Effect
from axistwin.diagnose.effects import Found, LoadChange, Push
from axistwin.diagnose.intake import Intake
from axistwin.diagnose.linear import TwoInertias
from axistwin.diagnose.result import (
    Autocorrelation,
    Considered,
    Contribution,
    Diagnosis,
    ErrorSummary,
    Evidence,
    Finding,
    Resemblance,
    Residual,
    Shown,
    Signals,
    Track,
)
from axistwin.diagnose.search import UNEXPLAINED
from axistwin.diagnose.selection import Search
from axistwin.diagnose.state import State
from axistwin.diagnose.windows import coloured, floor_spread
from axistwin.identify.result import Quantity, quantity, unit
from axistwin.model import SAMPLE_LOSS, Model
from axistwin.record import Record

#: A trial that gained this share of what the one taken did could pass for it.
_ALIKE = 0.8

#: Missing samples that are worth a finding.
_LOST_MIN = 10

#: What is left has to be more than noise by so many standard deviations of what that is known by.
_SURE = 3.0

#: Rounding of an encoder this many times its other noise is what limits it.
_COARSE = 1.0

#: Up to this share of the noise the rounding is as good as white.
_FINE = 0.5

#: Twice the logarithm of the likelihood that a moment may be off by: there are several good ones.
_LIKELY = 16.0

#: Moments that are tried around the best on each side, and the samples between two.
_MOMENTS = 32
_MOMENT_STEP = 2

#: Lags of the autocorrelations, and parts of the record for the course of the parameters.
_LAGS = 100
_PARTS = 8

_PLACES = ("motor", "table")


def of(record: Record, search: Search, intake: Intake) -> Diagnosis:
    """The diagnosis of a record from what was found in it."""
    return _Answer(record, search).diagnosis(intake)


class _Answer:
    def __init__(self, record: Record, search: Search) -> None:
        self._record, self._search = record, search
        self._base, self._last = search.states[0], search.states[-1]
        windows = replace(
            self._last.fit.windows, held_out=np.zeros(self._last.fit.windows.count, np.bool_)
        )
        # The last word on the parameters: fitted to everything.
        last = replace(self._last.fit, windows=windows)
        if self._last.replay is None:
            self._final = State.along(last, self._last.motion).replayed()
        else:
            self._final = State(last, self._last.motion).replayed(self._last.replay)
        for i, found in enumerate(last.found):
            if isinstance(found.kind, LoadChange):
                self._final = _at_best_moment(self._final, i)

    def diagnosis(self, intake: Intake) -> Diagnosis:
        """All of it."""
        fit, record = self._final.fit, self._record
        findings = (*self._findings(), *self._of_the_record())
        axis = self._quantities(self._final)
        return Diagnosis(
            record=record,
            base=self._quantities(self._base),
            base_valid=all(axis[name].determined for name in axis if name not in ("B", "viscous")),
            axis=axis,
            findings=findings,
            considered=self._considered(),
            unexplained=self._unexplained(),
            error=self._error(),
            model=self._model(findings),
            hold=fit.hold,
            window=fit.windows.length * record.time_step,
            evidence=self._evidence(),
            warnings=intake.warnings,
            advice=intake.advice,
            resembles=self._resembles(),
        )

    # ---- Parameters and their intervals

    def _quantities(self, state: State) -> dict[str, Quantity]:
        spread = state.covariance
        errors = np.sqrt(np.diag(spread))
        factor = _factor(state)
        return {
            name: quantity(name, float(value), float(error), factor, self._record.linear)
            for name, value, error in zip(
                state.fit.plant.names, state.fit.plant.values, errors, strict=False
            )
        }

    def _findings(self) -> list[Finding]:
        states, whole = self._search.states, _held_out(self._base)
        findings = []
        for i, found in enumerate(self._final.fit.found):
            gain = (_held_out(states[i]) - _held_out(states[i + 1])) / whole
            ci95 = _intervals(found, self._final.spread(i), _factor(self._final))
            if isinstance(found.kind, LoadChange):
                ci95["time"] = self._moments(i, ci95["time"])
            kind = found.kind
            findings.append(Finding(kind.effect, kind.location, found.params, ci95, gain))
        return findings

    def _moments(self, i: int, near: tuple[float, float]) -> tuple[float, float]:
        """The first and the last moment that is about as likely as the best."""
        state = self._final
        unknown, moments = _around(state, i)
        misfits = np.array([state.misfit_at(unknown, moment) for moment in moments])
        likely = moments[misfits < np.min(misfits) + _LIKELY * state.scale]
        first, _ = state.fit.windows.unseen(float(likely[0]))
        _, last = state.fit.windows.unseen(float(likely[-1]))
        return min(near[0], first), max(near[1], last)

    def _of_the_record(self) -> list[Finding]:
        """What the wire and the encoders do, which no simulation shows."""
        record, found = self._record, []
        lost, n = len(record.missing), len(record)
        if lost >= _LOST_MIN:
            ends = scipy.stats.binomtest(lost, n).proportion_ci(method="wilson")
            fraction = {"fraction": lost / n}
            interval = {"fraction": (float(ends.low), float(ends.high))}
            found.append(Finding(SAMPLE_LOSS, "record", fraction, interval, 0.0))
        for channel, step in enumerate(self._final.fit.windows.steps):
            if step is not None and record.counts_per_turn[channel] is None:
                found += self._coarse(channel, step)
        return found

    def _coarse(self, channel: int, step: float) -> list[Finding]:
        """An encoder whose rounding is most of the noise of its channel."""
        floor = self._final.fit.noise
        if floor is None:
            return []
        rounding = step / np.sqrt(12.0)
        other = np.sqrt(max(float(floor[channel]) ** 2 - rounding**2, 0.0))
        if rounding < _COARSE * other:
            return []
        counts = (1.0 if self._record.linear else 2.0 * np.pi) / step
        half = max(0.5, 1e-6 * counts)
        interval = {"counts": (counts - half, counts + half)}
        params = {"counts": float(round(counts))}
        return [Finding("quantisation", f"encoder{channel + 1}", params, interval, 0.0)]

    def _model(self, findings: tuple[Finding, ...]) -> Model:
        plant = self._final.fit.plant
        if isinstance(plant, TwoInertias):
            effects = [Effect(one.effect, one.location, dict(one.params)) for one in findings]
            return Model(plant.axis, tuple(effects), self._record.linear)
        inertia, viscous = plant.values.tolist()
        effects = [Effect(one.effect, one.location, dict(one.params)) for one in findings]
        effects.insert(0, Effect("friction_viscous", "motor", {"coefficient": viscous}))
        return Model(stiff(inertia, self._record.time_step), tuple(effects), self._record.linear)

    # ---- What else was considered

    def _considered(self) -> tuple[Considered, ...]:
        """Everything that was not named, with the best reason not to."""
        whole = _held_out(self._base)
        named = [one.kind for one in self._last.fit.found]
        entries: dict[str, Considered] = {}
        for trial in self._search.trials[-1]:
            kind = trial.found.kind
            if kind not in named:
                gain = trial.total / whole
                entries[kind.name] = Considered(kind.effect, kind.location, gain, "no")
        for i, winner in enumerate(self._last.fit.found):
            trials = self._search.trials[i]
            most = next((t.gain for t in trials if t.found.kind == winner.kind), 0.0)
            for trial in trials:
                kind = trial.found.kind
                if kind not in named and trial.gain > _ALIKE * most > 0.0:
                    gain = entries[kind.name].gain if kind.name in entries else 0.0
                    verdict = f"look-alike of {winner.kind.effect} at {winner.kind.location}"
                    entries[kind.name] = Considered(kind.effect, kind.location, gain, verdict)
        return tuple(sorted(entries.values(), key=lambda one: -one.gain))

    # ---- Errors

    def _unexplained(self) -> bool:
        """Whether more is left of a channel than noise and the rounding of its encoder, which is
        not white; or what only a form of no name could be."""
        if self._search.form is not None:
            return True
        windows = self._last.fit.windows
        error = self._last.simulation_error[:, windows.held_out]
        left_of_all = self._final.simulation_error
        floor = self._last.fit.noise
        for channel, step in enumerate(windows.steps):
            noise = 0.0 if floor is None else float(floor[channel])
            free = len(self._last.fit.system.free(windows.time_step, 2)) / windows.channels
            left = np.sum(error[channel] ** 2) / (error[channel].size - free * len(error[channel]))
            more = UNEXPLAINED + _SURE * floor_spread(left_of_all[channel])
            if float(left) > more * noise**2:
                return True
            rounding = (step or 0.0) / np.sqrt(12.0)
            if rounding < _FINE * noise and coloured(left_of_all[channel], noise):
                return True
        return False

    def _resembles(self) -> Resemblance | None:
        trial = self._search.form
        if trial is None:
            return None
        noise = self._last.samples * np.count_nonzero(trial.held_out)
        beyond = float(np.sum(trial.before[trial.held_out])) - noise
        kind = trial.found.kind
        return Resemblance(kind.effect, kind.location, trial.total / max(beyond, trial.total))

    def _error(self) -> ErrorSummary:
        floor = self._last.fit.noise
        return ErrorSummary(
            "held-out rms simulation error of theta1",
            unit("angle", self._record.linear),
            _rms(self._base),
            _rms(self._last),
            float("nan") if floor is None else float(floor[0]),
        )

    # ---- Evidence

    def _evidence(self) -> Evidence:
        fit, motion = self._final.fit, self._final.motion
        two = fit.windows.channels == 2
        signals = Signals(
            time=motion.time.ravel(),
            torque=motion.command().ravel(),
            theta1=motion.angle[0].ravel(),
            omega1=motion.speed[0].ravel(),
            theta2=motion.angle[1].ravel() if two else None,
            omega2=motion.speed[1].ravel() if two else None,
            twist=motion.twist.ravel() if two else None,
        )
        pushes = [one.push(motion, fit.plant) for one in fit.found]
        after = self._residuals()
        before = {name: values.copy() for name, values in after.items()}
        contributions = []
        for push in pushes:
            parts = _by_place(push)
            for name, values in parts.items():
                before[name] += values
            place = max(parts, key=lambda name: float(np.sum(parts[name] ** 2)))
            contributions.append(Contribution(place, parts[place].ravel()))
        residuals = {name: Residual(before[name].ravel(), after[name].ravel()) for name in after}
        return Evidence(
            signals,
            residuals,
            tuple(contributions),
            self._shown(),
            self._whiteness(),
            self._tracks(),
        )

    def _residuals(self) -> dict[str, Array]:
        """Torque (w, l) that the model lacks at each place (Eq. 18 of the smoothed error), and the
        angle that it lacks at each encoder."""
        fit = self._final.fit
        error = self._final.simulation_error
        order = [
            scipy.signal.savgol_filter(
                error, fit.smoothing, 3, deriv=k, delta=fit.windows.time_step, axis=2
            )
            for k in range(3)
        ]
        found = {f"encoder{i + 1}": order[0][i] for i in range(fit.windows.channels)}
        plant = fit.plant
        if isinstance(plant, TwoInertias):
            axis = plant.axis
            shaft = axis.B * (order[1][0] - order[1][1]) + axis.K * (order[0][0] - order[0][1])
            found["motor"] = axis.I1 * order[2][0] + shaft
            found["table"] = axis.I2 * order[2][1] - shaft
        else:
            inertia, viscous = plant.values
            found["motor"] = inertia * order[2][0] + viscous * order[1][0]
        return found

    def _shown(self) -> tuple[Shown, ...]:
        windows = self._last.fit.windows
        before = self._base.simulation_error
        after = self._last.simulation_error
        return tuple(
            Shown(
                f"theta{channel + 1}",
                windows.time,
                windows.angles[channel],
                windows.angles[channel] - before[channel],
                windows.angles[channel] - after[channel],
                windows.held_out,
            )
            for channel in range(windows.channels)
        )

    def _whiteness(self) -> tuple[Autocorrelation, ...]:
        windows = self._last.fit.windows
        before = self._base.simulation_error[:, windows.held_out]
        after = self._last.simulation_error[:, windows.held_out]
        count = min(_LAGS, windows.length // 2)
        lag = windows.time_step * np.arange(count, dtype=np.float64)
        band = 1.96 / np.sqrt(before[0].size)
        return tuple(
            Autocorrelation(
                f"theta{i + 1}",
                lag,
                _autocorrelation(before[i], count),
                _autocorrelation(after[i], count),
                float(band),
            )
            for i in range(windows.channels)
        )

    def _tracks(self) -> tuple[Track, ...]:
        """The axis in parts of the record, effects and all else as they are."""
        state = self._final
        fit, k = state.fit, len(state.fit.plant.names)
        columns, residual = state.columns[:, :k], state.residual
        groups = np.array_split(np.arange(fit.windows.count), min(_PARTS, fit.windows.count // 3))
        directions = fit.plant.directions
        values, errors, times = [], [], []
        for group in groups:
            gram = np.einsum("wan,wbn->ab", columns[group], columns[group], optimize=True)
            right = np.einsum("wan,wn->a", columns[group], residual[group], optimize=True)
            inverse = np.linalg.pinv(gram, hermitian=True)
            values.append(fit.plant.values + directions @ inverse @ right)
            spread = directions @ inverse @ directions.T
            errors.append(np.sqrt(np.maximum(np.diag(spread), 0.0) * state.scale))
            times.append(float(np.mean(fit.windows.time[group])))
        return tuple(
            Track(
                name,
                unit(name, self._record.linear),
                np.array(times),
                np.array(values)[:, i],
                np.array(errors)[:, i],
            )
            for i, name in enumerate(fit.plant.names)
        )


def stiff(inertia: float, time_step: float) -> Axis:
    """A rigid axis as two inertias: the second a millionth, on a shaft that is stiff and damped.

    The shaft is as stiff as steps of the record can simulate.
    """
    small = 1e-6 * inertia
    wn = 0.2 / time_step
    return Axis(inertia, small, small * wn, small * wn**2)


def _factor(state: State) -> float:
    """Half a 95 % interval in standard errors."""
    freedom = max(len(state.errors) - len(state.fit.values), 3)
    return float(scipy.stats.t.ppf(0.975, freedom))


def _intervals(found: Found, spread: Array, factor: float) -> dict[str, tuple[float, float]]:
    """95 % intervals of the public parameters, by the delta method."""
    middle = found.params
    intervals: dict[str, tuple[float, float]] = {}
    sizes = np.sqrt(np.maximum(np.diag(spread), 0.0))
    slopes: dict[str, Array] = {name: np.zeros(len(found.values)) for name in middle}
    for i, size in enumerate(sizes):
        step = np.zeros(len(sizes))
        step[i] = 1e-3 * size if size > 0.0 else 1e-9
        moved = found.with_values(found.values + step).params
        for name in middle:
            slopes[name][i] = (moved[name] - middle[name]) / step[i]
    for name, slope in slopes.items():
        half = factor * float(np.sqrt(max(float(slope @ spread @ slope), 0.0)))
        intervals[name] = (middle[name] - half, middle[name] + half)
    return intervals


def _around(state: State, i: int) -> tuple[int, Array]:
    """Which unknown is the moment of the i-th effect, and moments around it."""
    unknown = state.unknowns(i).stop - 1
    samples = np.arange(-_MOMENTS, _MOMENTS + 1) * _MOMENT_STEP
    moments: Array = state.fit.values[unknown] + state.fit.windows.time_step * samples
    return unknown, moments


def _at_best_moment(state: State, i: int) -> State:
    """The same adjusted from a better moment if there is one: where the axis turns back, or hardly
    moves, the best is not the only good one."""
    unknown, moments = _around(state, i)
    values = state.fit.values
    values[unknown] = min(moments, key=lambda moment: state.misfit_at(unknown, moment))
    other = state.beside(state.fit.with_values(values))
    return min(state, other, key=lambda one: one.fitted)


def _held_out(state: State) -> float:
    return float(np.sum(state.errors[state.fit.windows.held_out]))


def _rms(state: State) -> float:
    """Of the held-out error of theta1, corrected for the initial states that were fitted."""
    windows = state.fit.windows
    error = state.simulation_error[0, windows.held_out]
    free = (state.fit.system.free(windows.time_step, 2).shape[0]) / windows.channels
    return float(np.sqrt(np.sum(error**2) / (error.size - free * len(error))))


def _autocorrelation(error: Array, count: int) -> Array:
    """Over windows (w, l), at lags 0 to count - 1."""
    length = error.shape[1]
    spectrum = np.abs(np.fft.rfft(error, 2 * length, axis=1)) ** 2
    summed = np.sum(np.fft.irfft(spectrum, axis=1), axis=0)[:count]
    values: Array = summed / max(float(summed[0]), 1e-300)
    return values


def _by_place(push: Push) -> dict[str, Array]:
    """What a push adds to each residual."""
    parts = {}
    for name in ("motor", "table", "encoder1", "encoder2"):
        values = getattr(push, name)
        if values is not None:
            parts[name] = values
    if push.command is not None:
        parts["motor"] = parts.get("motor", 0.0) + np.mean(push.command, axis=0)
    return parts
