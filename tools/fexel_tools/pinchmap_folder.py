"""Many images or SVGs to a folder of pinchmap stages, several at a time, with a contact sheet.

Every file is on its own: one that cannot be used is named, the others are made. Each runs in one of `jobs` processes,
so that a file on which a decoder crashes takes no other with it; results and messages come in the order of the files,
whatever finishes first.
"""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from fexel.errors import FexelError, FexelWarning
from fexel_tools.pinchmap import AuthoredPinchmap, author_pinchmap, check_input, check_side_outputs
from fexel_tools.pinchmap_options import PinchmapOptions, check_options
from fexel_tools.pinchmap_report import PinchmapReport
from fexel_tools.pinchmap_sheet import write_sheet
from fexel_tools.progress import Progress, silent
from fexel_tools.report import check_report, write_report
from fexel_tools.staged_output import check_output

__all__ = ["CONTACT_SHEET", "make_pinchmaps"]

CONTACT_SHEET = "contact_sheet.png"
_PANEL_PX = 224
_EXTENSIONS = (".usda", ".usdc", ".usd")


@dataclass(frozen=True)
class _Task:
    file: str
    out: Path
    options: PinchmapOptions


@dataclass(frozen=True, eq=False)
class _Outcome:
    """What came of a task: what was authored, or why not; and what was warned of."""

    authored: AuthoredPinchmap | None
    error: str = ""
    warned: tuple[str, ...] = ()


def make_pinchmaps(
    files: list[str],
    folder: str | Path,
    options: PinchmapOptions | None = None,
    *,
    report: str | Path | None = None,
    sheet: str | Path | None = None,
    jobs: int = 2,
    extension: str = ".usda",
    progress: Progress | None = None,
) -> PinchmapReport:
    """Author a stage per file, named after it, and a contact sheet.

    Parameters
    ----------
    files : list of str
    folder : str or Path
        Made where it does not exist.
    options : PinchmapOptions, optional
        For all files.
    report : str or Path, optional
        JSON file, see `fexel_tools.pinchmap_report`.
    sheet : str or Path, optional
        Contact sheet; default ``contact_sheet.png`` in the folder, which must not be one of the files.
    jobs : int
        Processes. More than one start fresh interpreters: a script that calls this needs the usual
        ``if __name__ == "__main__"``.
    extension : str
        Of the stages: ``.usda``, ``.usdc`` or ``.usd``.
    progress : callable(step, done, total), optional

    Returns
    -------
    PinchmapReport
        With the files that could not be used, and why.

    Raises
    ------
    FexelError
        An option is wrong, or folder, report or sheet cannot be written. Nothing is written then.
    """
    options = options or PinchmapOptions()
    folder = Path(folder)
    check_options(options)
    if jobs < 1:
        raise FexelError(f"--jobs: {jobs}, expected at least 1")
    if extension not in _EXTENSIONS:
        raise FexelError(f"stages end in '{extension}', expected one of {', '.join(_EXTENSIONS)}")
    tasks = [_Task(f, folder / name, options) for f, name in zip(files, _stage_names(files, extension), strict=True)]
    read = [*files, *_shared_inputs(options)]
    check_side_outputs(report, sheet, [*read, *(task.out for task in tasks)])
    if sheet is None:
        sheet = folder / CONTACT_SHEET
        _check_contact_sheet(sheet, [*read, *([report] if report is not None else [])])
    was_missing = _make_folder(folder)
    outcomes = _run(tasks, jobs, progress or silent)
    result = _report(tasks, outcomes)
    if result.items:
        panels = [o.authored.panels for o in outcomes if o.authored and o.authored.panels]
        write_sheet(panels, sheet)
    elif was_missing:
        folder.rmdir()
    if report is not None:
        write_report(result, report)
    return result


def _shared_inputs(options: PinchmapOptions) -> list[str]:
    """Images that every file is made with."""
    return [file for file in (options.mask, options.regions) if file and Path(file).is_file()]


def _check_contact_sheet(sheet: Path, others: Sequence[str | Path]) -> None:
    """The sheet that nobody named replaces nothing that is read, such as the sheet of an earlier run."""
    for other in others:
        if Path(other).resolve() == sheet.resolve():
            raise FexelError(f"{other}: would be replaced by the contact sheet, expected a --sheet elsewhere")
    if sheet.parent.is_dir():
        check_report(sheet, what="sheet")


def _make_folder(folder: Path) -> bool:
    """Make the folder; returns whether it was missing."""
    if folder.is_dir():
        return False
    if folder.exists():
        raise FexelError(f"{folder}: is a file, expected a folder for the stages")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise FexelError(f"{folder}: cannot be made: {error.strerror}") from error
    return True


def _stage_names(files: list[str], extension: str) -> list[str]:
    """A file name per input, after its stem, unique without regard to case."""
    names: list[str] = []
    taken: set[str] = set()
    for file in files:
        stem = Path(file).stem or "pinchmap"
        name, number = stem, 2
        while name.lower() in taken:
            name, number = f"{stem}_{number}", number + 1
        taken.add(name.lower())
        names.append(f"{name}{extension}")
    return names


def _run(tasks: list[_Task], jobs: int, progress: Progress) -> list[_Outcome]:
    """Outcomes in the order of the tasks."""
    outcomes: dict[int, _Outcome] = {}
    progress("pinchmaps", 0, len(tasks))
    for number, outcome in _finished(tasks, jobs):
        outcomes[number] = outcome
        progress("pinchmaps", len(outcomes), len(tasks))
    ordered = [outcomes[number] for number in range(len(tasks))]
    for message in [message for outcome in ordered for message in outcome.warned]:
        warnings.warn(message, FexelWarning, stacklevel=3)
    return ordered


def _finished(tasks: list[_Task], jobs: int) -> Iterator[tuple[int, _Outcome]]:
    """Number and outcome of every task, as they come."""
    workers = min(jobs, len(tasks))
    if workers <= 1:
        for number, task in enumerate(tasks):
            yield number, _author(task)
        return
    lost = []
    with _pool(workers) as pool:
        futures: dict[Future[_Outcome], int] = {pool.submit(_author, task): n for n, task in enumerate(tasks)}
        try:
            for future in as_completed(futures):
                try:
                    yield futures[future], future.result()
                except BrokenProcessPool:  # a process died, and with it what the others were at
                    lost.append(futures[future])
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    for number in sorted(lost):  # one process each, so that only the culprit fails
        try:
            with _pool(1) as pool:
                yield number, pool.submit(_author, tasks[number]).result()
        except BrokenProcessPool:
            yield number, _Outcome(None, f"{tasks[number].file}: the process that read it ended unexpectedly")


def _pool(workers: int) -> ProcessPoolExecutor:
    # Not forked: threads of NumPy, OpenCV and USD do not survive a fork.
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def _author(task: _Task) -> _Outcome:
    """Author one file; any failure is an outcome."""
    error = ""
    authored = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FexelWarning)
        try:
            check_output(task.out, check_input(task.file, task.options))
            authored = author_pinchmap(task.file, task.out, task.options, panel_px=_PANEL_PX, square_panels=True)
        except FexelError as failure:
            error = str(failure)
        except Exception as failure:  # a fault of ours with this file must not cost the user the others
            error = f"{task.file}: {type(failure).__name__}: {' '.join(str(failure).split()) or 'no reason given'}"
    warned = tuple(str(w.message) for w in caught if issubclass(w.category, FexelWarning))
    return _Outcome(authored, error, warned)


def _report(tasks: list[_Task], outcomes: list[_Outcome]) -> PinchmapReport:
    return PinchmapReport(
        tuple(outcome.authored.item for outcome in outcomes if outcome.authored),
        tuple((task.file, o.error) for task, o in zip(tasks, outcomes, strict=True) if not o.authored),
    )
