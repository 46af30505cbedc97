"""The tables of a run, and whether its targets were met."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from benchmarks.fuzz.law import LAWS
from benchmarks.fuzz.robot import DRIVES
from benchmarks.fuzz.trial import Outcome, Trial

__all__ = ["missed_targets", "print_report", "remarks"]

MOST_MISSES, MOST_RATIO, MOST_REFUSED = 0.005, 1.05, 0.001
_WORST = 12
_HEADER = (
    f"{'':16}{'count':>6}{'missed':>7}{'5xx':>5}{'failed':>7}{'between':>8}{'refused':>8}"
    f"{'good / known: median':>21}{'99 %':>7}{'worst':>8}{'planning: median':>18}{'worst':>9}"
)


def print_report(trials: list[Trial]) -> None:
    """Prints rows by drive and by scene, then laws, then faults and the worst seeds."""
    print(_HEADER)
    for drive in DRIVES:
        _row(drive, [t for t in trials if t.drive == drive])
    for scene in sorted({t.scene for t in trials}):
        _row(scene, [t for t in trials if t.scene == scene])
    _row("all", trials)
    print(f"\n{'law':16}{'count':>6}{'broken':>7}{'one refused':>12}{'worst':>8}  worst seeds")
    for law in (*LAWS, "efforts"):
        _law(law, trials)
    _faults(trials)
    slow = sorted((t for t in trials if _ratio(t) > MOST_RATIO), key=_ratio, reverse=True)
    print(f"\n{len(slow)} slower than {MOST_RATIO} × the known motion")
    for t in slow[:_WORST]:
        took = f"{t.outcome.duration:.3f} s, known {t.known:.3f} s"
        print(f"  {t.seed}: {_ratio(t):.3f} ({took}) {t.drive}, {t.scene}")


def missed_targets(trials: list[Trial]) -> list[str]:
    """What a run falls short of, in sentences."""
    said = []
    outcomes = [o for t in trials for o in _all(t)]
    if count := sum(o.status in ("5xx", "invalid") for o in outcomes):
        said.append(f"{count} answers are internal errors or call the request invalid")
    if count := sum(bool(o.faults) for o in outcomes):
        said.append(f"{count} answers fail their check")
    if (misses := sum(map(_missed, trials))) > MOST_MISSES * len(trials):
        said.append(f"{misses} of {len(trials)} known solutions were missed")
    ratios = _ratios(trials)
    if len(ratios) and np.quantile(ratios, 0.99) > MOST_RATIO:
        said.append(f"good / known is {np.quantile(ratios, 0.99):.3f} in 99 %, not {MOST_RATIO}")
    if (refused := sum(o.refused > 0 for o in outcomes)) > MOST_REFUSED * len(outcomes):
        said.append(f"{refused} of {len(outcomes)} plans had motions refused on the way")
    return said


def remarks(trial: Trial) -> list[str]:
    """What is wrong with one trial, in words."""
    about = f"{trial.drive}, {trial.scene}"
    said = [
        f"{law}: {by if isinstance(by, str) else f'{by:.3f}'}, {about}"
        for law, by in trial.laws.items()
        if by
    ]
    if (ratio := _ratio(trial)) > MOST_RATIO:
        said.append(f"{ratio:.3f} × the known motion of {trial.known:.3f} s, {about}")
    for which, outcome in [("as drawn", trial.outcome), *trial.others]:
        said += [f"{fault.detail} ({which}), {about}" for fault in outcome.faults]
        if outcome.status != "planned":
            said.append(f"{outcome.status}: {outcome.error} ({which}), {about}")
        if outcome.refused:
            said.append(f"{outcome.refused} motions were refused ({which}), {about}")
    return said


def _all(trial: Trial) -> list[Outcome]:
    return [trial.outcome, *(outcome for _, outcome in trial.others)]


def _missed(trial: Trial) -> bool:
    return trial.outcome.status not in ("planned", "5xx", "invalid")


def _ratio(trial: Trial) -> float:
    """Duration / known duration of effort good; 0 without one."""
    if trial.effort != "good" or trial.outcome.status != "planned":
        return 0.0
    return trial.outcome.duration / trial.known


def _ratios(trials: Iterable[Trial]) -> np.ndarray:
    return np.array([r for t in trials if (r := _ratio(t)) > 0])


def _row(name: str, trials: list[Trial]) -> None:
    outcomes = [t.outcome for t in trials]
    if not outcomes:
        return
    between = sum(bool(o.faults) and all(f.between for f in o.faults) for o in outcomes)
    failed = sum(any(not f.between for f in o.faults) for o in outcomes)
    line = f"{name:16}{len(trials):6}{sum(map(_missed, trials)):7}"
    line += f"{sum(o.status in ('5xx', 'invalid') for o in outcomes):5}{failed:7}{between:8}"
    line += f"{sum(o.refused > 0 for o in outcomes):8}"
    ratios = _ratios(trials)
    if len(ratios):
        line += f"{np.median(ratios):21.3f}{np.quantile(ratios, 0.99):7.3f}{ratios.max():8.3f}"
    took = [o.seconds for o in outcomes]
    print(line + f"{np.median(took) * 1e3:15.0f} ms{max(took):7.2f} s")


def _law(name: str, trials: list[Trial]) -> None:
    found = {t.seed: t.laws[name] for t in trials if name in t.laws}
    broken = {seed: value for seed, value in found.items() if not isinstance(value, str) and value > 0}
    refused = {seed: value for seed, value in found.items() if isinstance(value, str)}
    worst = sorted(broken, key=lambda seed: -broken[seed])[:5]
    line = (
        f"{name:16}{len(found):6}{len(broken):7}{len(refused):12}{max(broken.values(), default=0.0):8.3f}  "
    )
    print(line + ", ".join([f"{seed}: {broken[seed]:.3f}" for seed in worst]
                           + [f"{seed}: {value}" for seed, value in list(refused.items())[:5]]))  # fmt: skip


def _faults(trials: list[Trial]) -> None:
    """Each kind of fault, refusal and internal error: how often, and the first seeds."""
    counts: Counter[str] = Counter()
    seeds: dict[str, list[str]] = {}
    for trial in trials:
        for which, outcome in [("", trial.outcome), *trial.others]:
            kinds = [("fault" + (" between" if f.between else ""), f.what, f.detail) for f in outcome.faults]
            if outcome.status != "planned":
                kinds.append((outcome.status, "", outcome.error))
            for kind, what, detail in kinds:
                key = f"{kind} {what}".strip()
                counts[key] += 1
                seeds.setdefault(key, []).append(
                    f"{trial.seed}{f' ({which})' if which else ''}: {detail[:110]}"
                )
    for key, count in counts.most_common():
        print(f"\n{count} × {key}")
        for line in seeds[key][:6]:
            print(f"  {line}")
