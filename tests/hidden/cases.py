"""From one integer a whole case: an axis, how it is moved and measured, what is hidden, the record.

Axes lie around that of the source paper: both inertias over a decade, damping ratio over a decade,
the resonance at 0.1 to 0.8 rad a sample. Records of 10 to 60 s at 1 to 10 kHz hold at most 100 000
samples. The torque is a multisine, a chirp, a random binary signal, each on top of a slow swing of
several turns, open loop or in a soft position loop, or what a P-PI controller makes of a series of
moves with a little of the first three. Encoders have Gaussian noise, 1/300 to 1/3 of the twist's
rms, and counts finer than that.

A hidden effect has a size between 1 and 100 detection thresholds (threshold.py), with equal chance
for each factor. Angles betray a constant torque after half a second even when it is a millionth of
the motor's; where a size drawn is that little, it is drawn anew between 1/500 of what is physically
sensible and all of it: no drive delivers its torque better than that.

A record has nothing hidden (1 in 5), one effect, two, or one of no catalogue (1 in 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from catalogue import DRAWERS, UNKNOWN, Draft, Hidden, Probe
from threshold import size_in_thresholds
from truth import STATES, Array, Encoder, Loop, Run, Truth, simulate

#: Kinds of case and how often each is drawn.
KINDS = {"clean": 0.2, "single": 0.45, "pair": 0.25, "unknown": 0.1}

#: Sizes that are drawn [thresholds].
SIZES = (1.0, 100.0)

_SAMPLES_MAX = 100_000
_TURNS_MIN, _SPEED_MAX, _TRAVEL_MAX = 2.0, 2000.0, 5e4
_TURN = 2.0 * np.pi

# Effects that the size of a change of angle does not measure; see _coarse() and _lossy().
_OF_THE_RECORD = ("quantisation", "sample_loss")


@dataclass(frozen=True)
class Setting:
    """An axis, how it is moved, and how it is measured."""

    truth: Truth
    time_step: float
    feed: Array
    reference: Array
    loop: Loop
    white: Array
    noise: tuple[float, float]
    start: Array
    excitation: str

    def run(self, hidden: Sequence[Hidden]) -> Run:
        """What the axis does with these effects."""
        truth = self.truth
        for effect in hidden:
            truth = effect.into(truth)
        return simulate(
            truth,
            self.time_step,
            self.feed,
            reference=self.reference,
            loop=self.loop,
            noise=self.white,
            start=self.start,
        )


@dataclass(frozen=True)
class Case:
    """A record and what is hidden in it; ``sizes`` in thresholds, ``noise`` in rms [rad]."""

    seed: int
    kind: str
    setting: Setting
    hidden: tuple[Hidden, ...]
    sizes: tuple[float, ...]
    run: Run
    lost: Array

    def write(self, path: Path) -> None:
        """The record as a CSV file, and nothing else of the case."""
        n = len(self.run.command)
        columns = (self.setting.time_step * np.arange(n), self.run.command, *self.run.readings.T)
        kept = np.delete(np.column_stack(columns), self.lost.astype(int), axis=0)
        rows = "\n".join(",".join(map(repr, row)) for row in kept.tolist())
        path.write_text(f"t,torque,theta1,theta2\n{rows}\n", encoding="ascii")


def draw(
    seed: int, *, kind: str | None = None, effect: str | None = None, least: float = SIZES[0]
) -> Case:
    """The case of a seed; its ``kind``, first ``effect`` and ``least`` size can be asked for.

    What turns out not to be possible (an axis that runs away, an effect that cannot be seen at any
    physical size) is drawn again.
    """
    for attempt in range(100):
        rng = np.random.default_rng([seed, attempt])
        what = kind or str(rng.choice(list(KINDS), p=list(KINDS.values())))
        names = _names(rng, what, effect)
        try:
            case = _case(rng, seed, "pair" if len(names) == 2 else what, names, least)
        except RuntimeError:  # cannot be integrated
            continue
        if case is not None:
            return case
    raise RuntimeError(f"no case can be made of seed {seed}")


def _names(rng: np.random.Generator, kind: str, effect: str | None) -> list[str]:
    known = [name for name in (*DRAWERS, *_OF_THE_RECORD) if name not in UNKNOWN]
    count = {"clean": 0, "single": 1, "pair": 2, "unknown": 1}[kind]
    names = [str(name) for name in rng.choice(UNKNOWN if kind == "unknown" else known, count)]
    if effect is not None and names:
        names[0] = effect
    if "friction_drift" in names:  # there has to be a friction that drifts
        names = ["friction_drift", str(rng.choice(["friction_coulomb", "friction_viscous"]))]
    return names


def _case(
    rng: np.random.Generator, seed: int, kind: str, names: list[str], least: float
) -> Case | None:
    setting = _setting(rng)
    run = setting.run([])
    if not _possible(run):
        return None
    setting = _noisy(rng, setting, run)
    probe = _probe(setting, run)
    shares = [float(rng.uniform()) for _ in names]
    setting, lost, drafts = _drafts(rng, setting, probe, names, shares)
    places = [(draft.effect, draft.location) for draft in drafts]
    if len(set(places)) < len(places):
        return None
    found = _sized(setting, drafts, shares, least)
    if found is None:
        return None
    hidden, sizes, run = found
    if not _possible(run):
        return None
    return Case(seed, kind, setting, hidden, sizes, run, lost)


# ---- The axis and how it moves


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.uniform())


def _setting(rng: np.random.Generator) -> Setting:
    rate = round(_log_uniform(rng, 1e3, 1e4), -1)
    duration = min(_log_uniform(rng, 10.0, 60.0), _SAMPLES_MAX / rate)
    step, n = 1.0 / rate, int(duration * rate)
    wn = _log_uniform(rng, 0.1, 0.8) / step
    I1, I2 = 2.7e-5 * _log_uniform(rng, 0.32, 3.2), 8.3e-6 * _log_uniform(rng, 0.32, 3.2)
    reduced = I1 * I2 / (I1 + I2)
    B = 2.0 * _log_uniform(rng, 0.0126, 0.126) * wn * reduced
    zero = Encoder(zero=float(rng.uniform(-1.0, 1.0)))
    truth = Truth(I1, I2, B, wn**2 * reduced, encoder2=zero)
    t = step * np.arange(n)
    inertia = I1 + I2
    signal = str(rng.choice(["multisine", "chirp", "binary"]))
    motion = str(rng.choice(["open loop", "position loop", "moves"], p=[0.3, 0.35, 0.35]))
    start = np.zeros(STATES)
    loop = Loop()
    if motion == "moves":
        bandwidth = min(wn / 8.0, _TURN * 15.0) * rng.uniform(0.5, 1.0)
        loop = _controller(inertia, bandwidth, step)
        reference = _moves(rng, n, step)
        torque_rms = inertia * float(np.std(np.gradient(np.gradient(reference, step), step)))
        feed = torque_rms * _log_uniform(rng, 0.1, 1.0) * _SIGNALS[signal](rng, n, step, wn)
    else:
        swing, slow = _TURN * rng.uniform(1.5, 5.0), _TURN * _log_uniform(rng, 0.3, 1.5)
        reference = swing * np.cos(slow * t)
        torque = inertia * slow**2 * swing
        feed = -torque * np.cos(slow * t)
        feed += torque * _log_uniform(rng, 0.2, 2.0) * _SIGNALS[signal](rng, n, step, wn)
        start[:2] = swing
        if motion == "position loop":
            loop = _controller(inertia, _TURN * rng.uniform(0.5, 2.0), step)
    return Setting(
        truth,
        step,
        feed,
        reference,
        loop,
        np.zeros((n, 2)),
        (0.0, 0.0),
        start,
        f"{motion}, {signal}",
    )


def _noisy(rng: np.random.Generator, setting: Setting, run: Run) -> Setting:
    """With noise and counts at the encoders, in proportion to the twist but for what is sold."""
    twist = float(np.std(run.states[:, 0] - run.states[:, 1]))
    motor = min(max(twist / _log_uniform(rng, 3.0, 300.0), 1e-6), 1e-3)
    sigma = motor * np.array([1.0, _log_uniform(rng, 0.33, 3.0)])
    counts = 2.0 ** np.ceil(np.log2(_TURN / sigma))
    truth = setting.truth
    rms = np.hypot(sigma, _TURN / counts / np.sqrt(12.0))
    return replace(
        setting,
        truth=truth._replace(
            encoder1=truth.encoder1._replace(counts=float(counts[0])),
            encoder2=truth.encoder2._replace(counts=float(counts[1])),
        ),
        white=sigma * rng.standard_normal((len(run.command), 2)),
        noise=(float(rms[0]), float(rms[1])),
    )


def _controller(inertia: float, bandwidth: float, step: float) -> Loop:
    """A speed loop of that bandwidth [rad/s], the position loop a quarter of it."""
    return Loop(
        position=0.25 * bandwidth,
        speed=inertia * bandwidth,
        integral=inertia * bandwidth**2 / 6.0,
        smoothing=float(np.exp(-10.0 * bandwidth * step)),
    )


def _moves(rng: np.random.Generator, n: int, step: float) -> Array:
    """Moves of one to five turns: the speed rises, stays, falls, each for a third of the time."""
    speed: list[Array] = []
    total, at = 0, 0.0
    while total < n:
        third, rest = int(rng.uniform(0.15, 0.6) / step), int(rng.uniform(0.02, 0.4) / step)
        way = _TURN * rng.uniform(1.0, 5.0) * (-1.0 if at > 0.0 else 1.0)
        at += way
        ramp = (np.arange(third) + 0.5) / third
        shape = np.concatenate([ramp, np.ones(third), ramp[::-1], np.zeros(rest)])
        speed.append(shape * way / np.sum(shape))
        total += len(shape)
    return np.cumsum(np.concatenate(speed))[:n]


def _multisine(rng: np.random.Generator, n: int, step: float, wn: float) -> Array:
    """Schroeder's phases, a flat spectrum up to beyond the resonance; rms 1."""
    length = int(rng.uniform(1.0, 4.0) / step)
    lines = min(int(1.8 * wn / _TURN * length * step), length // 2 - 1)
    k = np.arange(1, lines + 1)
    spectrum = np.zeros(length // 2 + 1, complex)
    spectrum[1 : lines + 1] = np.exp(-1j * np.pi * k * (k - 1) / lines)
    period = np.fft.irfft(spectrum, length)
    return np.resize(period / np.std(period), n)


def _chirp(rng: np.random.Generator, n: int, step: float, wn: float) -> Array:
    """Sweeps from 1 Hz to beyond the resonance and again; rms 1."""
    length = int(rng.uniform(1.0, 4.0) / step)
    s = np.arange(length) / length
    low, high = _TURN, min(1.8 * wn, 0.8 * np.pi / step)
    period = np.sqrt(2.0) * np.sin(length * step * (low * s + 0.5 * (high - low) * s**2))
    return np.resize(period, n)


def _binary(rng: np.random.Generator, n: int, step: float, wn: float) -> Array:
    """Plus or minus one at random, held for a part of the resonance's period."""
    held = max(1, int(rng.uniform(0.3, 0.9) * np.pi / (wn * step)))
    return np.repeat(rng.choice([-1.0, 1.0], n // held + 1), held)[:n]


_SIGNALS = {"multisine": _multisine, "chirp": _chirp, "binary": _binary}


def _possible(run: Run) -> bool:
    """Several turns of travel, and no axis that runs away."""
    angle, speed = run.states[:, 0], run.states[:, 2:4]
    if not np.max(np.abs(speed)) < _SPEED_MAX or not np.max(np.abs(angle)) < _TRAVEL_MAX:
        return False
    return bool(np.ptp(angle) > _TURN * _TURNS_MIN)


def _probe(setting: Setting, run: Run) -> Probe:
    twist = run.states[:, 0] - run.states[:, 1]
    return Probe(
        setting.truth,
        setting.time_step,
        setting.time_step * len(run.command),
        float(np.std(run.command)),
        float(np.max(np.abs(run.command))),
        float(np.sqrt(np.mean(run.states[:, 2] ** 2))),
        float(np.max(np.abs(run.states[:, 2:4]))),
        float(np.std(twist)),
        setting.noise,
    )


# ---- Sizes


def _goal(share: float, least: float) -> float:
    return float(least * (SIZES[1] / least) ** share)


def _drafts(
    rng: np.random.Generator, setting: Setting, probe: Probe, names: list[str], shares: list[float]
) -> tuple[Setting, Array, list[Draft | Hidden]]:
    """Draws the effects; those of the encoder's counts and of the file have their size at once."""
    drafts: list[Draft | Hidden] = []
    lost = np.zeros(0)
    for name, share in zip(names, shares, strict=True):
        if name == "quantisation":
            effect, setting = _coarse(rng, setting, _goal(share, SIZES[0]))
            drafts.append(effect)
        elif name == "sample_loss":
            effect, lost = _lossy(rng, len(setting.feed), _goal(share, SIZES[0]))
            drafts.append(effect)
        else:
            drafts.append(DRAWERS[name](rng, probe))
    if names[:1] == ["friction_drift"]:  # of the friction that is drawn with it
        drafts[1] = replace(drafts[1], location=drafts[0].location)
    return setting, lost, drafts


def _coarse(rng: np.random.Generator, setting: Setting, goal: float) -> tuple[Hidden, Setting]:
    """Counts so coarse that their rounding is `goal` times the noise: one threshold is as much."""
    which = int(rng.integers(2))
    sigma = float(np.std(setting.white[:, which]))
    counts = float(max(200, round(_TURN / (goal * sigma * np.sqrt(12.0)))))
    noise = list(setting.noise)
    noise[which] = float(np.hypot(sigma, _TURN / counts / np.sqrt(12.0)))
    effect = Hidden("quantisation", f"encoder{which + 1}", {"counts": counts})
    return effect, replace(setting, noise=(noise[0], noise[1]))


def _lossy(rng: np.random.Generator, n: int, goal: float) -> tuple[Hidden, Array]:
    """Ten samples that are missing are one threshold; first and last are there."""
    count = int(10.0 * goal)
    lost = np.sort(rng.choice(np.arange(1, n - 1), count, replace=False)).astype(float)
    return Hidden("sample_loss", "record", {"fraction": count / n}), lost


@dataclass
class _Size:
    """The size of an effect, on the way from a first guess to the one wanted."""

    draft: Draft
    share: float
    goal: float  # [thresholds]
    value: float
    found: float = 0.0  # [thresholds]

    def improve(self) -> float:
        """Goes nearer to the goal; by what factor."""
        smallest = 0.0 if self.draft.seen_directly else self.draft.most / _SENSIBLE
        wanted = self.value * min(max(self.goal / max(self.found, 1e-9), 1e-6), 1e3)
        if wanted < smallest:
            wanted = float(smallest * _SENSIBLE**self.share)
        before, self.value = self.value, min(wanted, self.draft.most)
        return self.value / before


_SENSIBLE = 500.0
_ROUNDS, _CLOSE = 5, 0.3


def _sized(
    setting: Setting, drafts: list[Draft | Hidden], shares: list[float], least: float
) -> tuple[tuple[Hidden, ...], tuple[float, ...], Run] | None:
    """Effects of the sizes wanted, their sizes in thresholds, and the run.

    None when one cannot reach the least size.
    """
    sizes: dict[int, _Size] = {}
    for i, (draft, share) in enumerate(zip(drafts, shares, strict=True)):
        if isinstance(draft, Draft):
            sizes[i] = _Size(draft, share, _goal(share, least), 0.03 * draft.most)
    thresholds = [_goal(share, SIZES[0]) for share in shares]
    for _ in range(_ROUNDS):
        hidden = [
            d if isinstance(d, Hidden) else d.at(sizes[i].value) for i, d in enumerate(drafts)
        ]
        run = setting.run(hidden)
        inside = [hidden[i] for i in sizes]
        for place, (i, size) in enumerate(sizes.items()):
            size.found = thresholds[i] = size_in_thresholds(
                setting.truth, inside, place, run, setting.time_step, setting.noise
            )
        if all(abs(np.log(size.improve())) < _CLOSE for size in sizes.values()):
            break
    if any(threshold < least for threshold in thresholds):
        return None
    return tuple(hidden), tuple(thresholds), run
