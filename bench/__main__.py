"""Run the benchmarks: ``python -m bench [--quick] [--only NAME] [--output FOLDER] [--docs FILE] [--list]``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.harness import REPOSITORY, ModuleResult, discover, machine, run_module
from bench.plots import write_plots
from bench.report import markdown, summary_line, write_json, write_text

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run what was asked for, write the table after every module, and return the exit status: 1 if any failed."""
    options = _parser().parse_args(arguments)
    modules, broken = discover(options.only)
    if options.list:
        print("\n".join(sorted(modules)))
        return 0
    if not modules and not broken:
        print(f"no benchmark is named like {' or '.join(options.only)}; python -m bench --list", file=sys.stderr)
        return 2
    results = [ModuleResult(name, [], [], 0.0, message) for name, message in broken.items()]
    about = machine()
    for name in sorted(modules):
        print(f"{name} ...", file=sys.stderr, flush=True)
        results.append(run_module(name, modules[name], options.quick))
        _write(options.output, about, results, options.quick)
    _write(options.output, about, results, options.quick)
    if options.docs:
        links = write_plots((curve for result in results for curve in result.curves), options.docs.parent / "images")
        write_text(options.docs, markdown(about, results, options.quick, [f"images/{link.name}" for link in links]))
    print(f"{summary_line(results)}; {options.output / 'results.md'}")
    return int(any(result.error for result in results))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench", description="Measure fexel; write a table and plots.")
    parser.add_argument("--quick", action="store_true", help="smaller samples, same measures")
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="modules named like NAME; repeatable"
    )
    parser.add_argument("--output", type=Path, default=REPOSITORY / "out" / "bench", help="folder (default: out/bench)")
    parser.add_argument("--docs", type=Path, metavar="FILE", help="also write the table to FILE, as docs/benchmarks.md")
    parser.add_argument("--list", action="store_true", help="print the names of the modules and stop")
    return parser


def _write(folder: Path, about: dict, results: list[ModuleResult], quick: bool) -> None:
    """Write what there is so far, so that an interrupted run leaves the modules that it finished."""
    plots = write_plots((curve for result in results for curve in result.curves), folder)
    write_json(folder / "results.json", about, results, quick)
    write_text(folder / "results.md", markdown(about, results, quick, [plot.name for plot in plots]))


if __name__ == "__main__":
    sys.exit(main())
