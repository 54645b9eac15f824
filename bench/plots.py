"""Plots of speed against error, one PNG per technique, what a user would otherwise pick beside ours."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from bench.harness import Curve

__all__ = ["write_plots"]

_MARKERS = "osD^vP*X"


def write_plots(curves: Iterable[Curve], folder: Path) -> list[Path]:
    """Draw every plot named by the curves into ``folder/<plot>.png``; needs matplotlib, [] without it.

    Curves of ours are drawn solid and heavier; the others dashed.
    """
    groups: dict[str, list[Curve]] = {}
    for curve in curves:
        groups.setdefault(curve.plot, []).append(curve)
    if not groups:
        return []
    try:
        import matplotlib
    except ImportError:
        return []
    matplotlib.use("Agg")
    folder.mkdir(parents=True, exist_ok=True)
    return [_write_plot(folder / f"{name}.png", members) for name, members in sorted(groups.items())]


def _write_plot(path: Path, curves: list[Curve]) -> Path:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 4.2), dpi=100, layout="constrained")
    for index, curve in enumerate(curves):
        style = {"linewidth": 2.4, "zorder": 3} if curve.ours else {"linewidth": 1.2, "linestyle": "--"}
        axes.plot(curve.x, curve.y, marker=_MARKERS[index % len(_MARKERS)], label=curve.label, **style)
        for x, y, text in zip(curve.x, curve.y, curve.annotations, strict=False):
            axes.annotate(text, (x, y), textcoords="offset points", xytext=(6, 4), fontsize=8)
    axes.set_xlabel(curves[0].x_label)
    axes.set_ylabel(curves[0].y_label)
    axes.set_xscale("log" if curves[0].x_log else "linear")
    axes.set_yscale("log" if curves[0].y_log else "linear")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend(fontsize=8)
    figure.savefig(path)
    pyplot.close(figure)
    return path
