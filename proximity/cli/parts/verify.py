"""Command ``proximity verify``, which verifies the requirements of a file and checks receipts."""

from pathlib import Path
from typing import Annotated

import typer

from proximity.cli import progress
from proximity.cli.options import JSON, argument, flag, option, refuse
from proximity.cli.output import report, write_document

EXIT_VIOLATED, EXIT_UNDECIDED = 1, 3


def verify(
    file: Annotated[
        Path | None, argument("FILE", "File of requirements (.toml).", show_default=False)
    ] = None,
    as_json: JSON = False,
    csv_path: Annotated[Path | None, option("FILE", "Write all pairs to a CSV file, too.", "--csv")] = None,
    junit: Annotated[Path | None, option("FILE", "Write the verdicts as JUnit XML, for a build.")] = None,
    report_page: Annotated[Path | None, option("FILE", "Write a page (.html).", "--report")] = None,
    write_receipt: Annotated[
        Path | None, option("FILE", "Write a receipt (.json): verdicts, bounds, and hashes of all files.")
    ] = None,
    receipt: Annotated[
        Path | None, option("FILE", "Check a receipt: verify again and compare. FILE is then optional.")
    ] = None,
    no_cache: Annotated[
        bool, flag("--no-cache", "Convert a STEP file again, without the triangles of earlier commands.")
    ] = False,
) -> None:
    """Verify the requirements of FILE: gaps, also along an axis or over a motion; clashes; thin walls.

    A requirement holds, is violated, or cannot be decided. The verdict follows from bounds of the measured
    length, which include the deviation of triangles from the CAD surfaces of a STEP file. If a requirement
    cannot be decided, a sentence gives the step tolerance that may decide it. Each row shows the pair of
    parts that decides; --csv and --json have all pairs, with both ends.

    The exit code is 0 if all requirements hold, 1 if one is violated, and 3 if none is violated but one
    cannot be decided. With --receipt it is also 1 if a file, a setting, a verdict or a bound differs.

    Examples:
      proximity verify fit.toml
      proximity verify fit.toml --junit fit.xml --report fit.html
      proximity verify fit.toml --write-receipt fit.json
      proximity verify --receipt fit.json
    """
    refuse((file is None and receipt is None, "FILE", "give a file of requirements, or --receipt FILE"))
    from proximity.cli.parts.reports import verify as verify_report
    from proximity.requirements import receipts
    from proximity.requirements.records import Verdict
    from proximity.requirements.verification import verify as verify_file

    if report_page is not None:
        verify_report.check_libraries()
    progress.prepare_kernels()
    differences: tuple[str, ...] | None = None
    with progress.spinner(f"verifying {file or receipt}"):
        if receipt is None:
            assert file is not None
            found = verify_file(file, cache=not no_cache)
        else:
            found, differences, notes = receipts.check_receipt(receipt, file, cache=not no_cache)
            for note in notes:
                report(f"note: {note}")
    if csv_path is not None:
        verify_report.write_csv(csv_path, found)
    if junit is not None:
        verify_report.write_junit(junit, found)
    if report_page is not None:
        verify_report.write_page(report_page, found)
    if write_receipt is not None:
        receipts.write_receipt(write_receipt, found)
    if as_json:
        write_document(verify_report.document(found, differences))
    else:
        verify_report.print_text(found)
        for note in found.notes:
            report(f"note: {note}")
        for difference in differences or ():
            typer.echo(f"The receipt differs: {difference}.")
        if differences == ():
            typer.echo("The receipt is confirmed.")
    if differences or found.verdict is Verdict.VIOLATED:
        raise typer.Exit(EXIT_VIOLATED)
    if found.verdict is Verdict.UNDECIDED:
        raise typer.Exit(EXIT_UNDECIDED)
