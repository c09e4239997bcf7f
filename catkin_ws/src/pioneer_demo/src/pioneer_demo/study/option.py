"""Command line of ``./pioneer experiment``."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from pioneer_demo.error import OptionError
from pioneer_demo.scenario.option import Machine, Parser

MOST_JOBS = 1000
"""Maximum number of workers on one machine; each runs a fleet."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExperimentConfig:
    """Configuration of an experiment."""

    study: Path  #: the study's file
    runs: int = 0  #: runs per variant; 0 for the file's value
    jobs: int = 1  #: workers on this machine
    scheduler: str = ""  #: address of a dask scheduler to use instead; empty for none
    output: Path  #: the study's folder
    keep: bool = False  #: whether to keep each run's report and logs


def experiment_config(arguments: Sequence[str], machine: Machine) -> ExperimentConfig:
    """Returns the configuration of ``./pioneer experiment``; ``--help`` prints and exits as argparse does.

    Raises:
        OptionError: an unknown option, or a value out of its range.
    """
    values = vars(_experiment_parser().parse_args(arguments))
    values["output"] = values["output"] or Path(f"{values['study'].stem}-study")
    values["jobs"] = max(1, int(machine.processors)) if values["jobs"] is None else values["jobs"]
    if not 1 <= values["jobs"] <= MOST_JOBS:
        raise OptionError(f"--jobs must be 1 to {MOST_JOBS}, not {values['jobs']}")
    if values["runs"] < 0:
        raise OptionError(f"--runs must be 0 (as in the file) or more, not {values['runs']}")
    return ExperimentConfig(**values)


def _experiment_parser() -> Parser:
    parser = Parser(
        "experiment",
        "Runs a scenario many times: variants, each with the same seeds. Writes a table, a summary and a\n"
        "page with figures. What is done is kept: the same command continues after Ctrl-C.",
        "Exit status: 0 when all runs are done, 1 when not, 2 for a wrong file or option, 130 after Ctrl-C.\n"
        "Example: ./pioneer experiment head_on_planners.yaml --runs 100",
    )
    add = parser.add_argument
    add(
        "study",
        type=Path,
        metavar="STUDY",
        help="the study's file (pioneer_demo's README has its fields)",
    )
    add(
        "--runs",
        type=int,
        default=0,
        metavar="N",
        help="of each variant, instead of the file's (0: as in the file)",
    )
    add(
        "--jobs",
        type=int,
        metavar="J",
        help="runs at a time on this machine (default: its processors)",
    )
    add(
        "--scheduler",
        default="",
        metavar="URL",
        help="a dask scheduler, tcp://…, whose workers do the runs",
    )
    add("--output", type=Path, metavar="DIR", help="the study's folder (default: STUDY-study)")
    add("--keep", action="store_true", help="keep each run's report and logs, in DIR/reports")
    return parser
