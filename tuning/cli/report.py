"""Reports on finished runs."""

from __future__ import annotations

from pathlib import Path

import click

from tuning.terminal.following import Words, again, deploy, words
from tuning.terminal.options import JSON, QUIET, emit


@click.command(epilog="Example: vsajax report runs/population --open")
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("other", metavar="[RUN2]", type=click.Path(path_type=Path), required=False)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File; by default RUN/report.html.")
@click.option("--open", "opens", is_flag=True, help="Show it in the browser.")
@JSON
@QUIET
def report(run: Path, other: Path | None, output: Path | None, opens: bool, as_json: bool, quiet: bool) -> None:
    """Write what a finished RUN shows as one HTML file; with RUN2, how the two differ."""
    from tuning.files.errors import input_error

    output = output or run / ("report.html" if other is None else f"report-{other.name}.html")
    if output.is_dir():
        raise input_error(output, "is a folder", "name a file with -o, e.g. report.html")
    from tuning.runs.machine import start_jax

    start_jax()
    from tuning.files.whole import write_text
    from tuning.kinds.log.search_page import is_log_search, report_log_search
    from tuning.report.gather import own_page

    best = run / "best.toml"
    folders = [folder for folder in (run, other) if folder is not None]
    own = {folder: page for folder in folders if (page := own_page(folder)) is not None}
    if own:
        if len(folders) == 2:
            problem = "holds a run of a command of its kind's own, of which there is no report in pairs"
            raise input_error(next(iter(own)), problem, "name it alone")
        page = own[run].load()(run)
    elif other is None and is_log_search(run):
        page = report_log_search(run)
    else:
        from tuning.report.compose import report_pair, report_run
        from tuning.report.gather import check_comparable, contender_file, open_finished

        runs = [open_finished(folder) for folder in folders]
        if len(runs) == 2:
            check_comparable(*runs)
            page = report_pair(*runs)
        else:
            page = report_run(runs[0])
        if runs[0].command == "contest":
            best = contender_file(runs[0], next(iter(runs[0].compared)))
    text = page.html()
    write_text(output, text)
    size = len(text.encode())
    emit(
        {"report": output, "headline": page.headline, "pictures": len(page.pictures), "bytes": size},
        as_json=as_json,
        quiet=quiet,
        text=f"{page.headline}\nwrote {output} ({len(page.pictures)} pictures, {size / 1e6:.1f} MB)",
        following=lambda: _following(best, opened=opens),
    )
    if opens:
        click.launch(str(output))


def _following(best: Path, *, opened: bool) -> Words:
    """Return how to deploy the best that a run found; where it looked for nothing, how to see the report."""
    if best.is_file():
        return deploy(best)
    return words("init", "--list") if opened else again(extra=["--open"])
