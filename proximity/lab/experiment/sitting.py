"""A sitting: a participant begins, or goes on where the log ends."""

import platform
from functools import partial

import numpy as np

import proximity
from proximity.lab.experiment.conduct import Monitor, RefusedError, Respondent, conduct
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.display import Apparatus
from proximity.lab.experiment.session import Session
from proximity.lab.experiment.trial_log import TrialLog


def sit(
    dataset: Dataset,
    pseudonym: str,
    apparatus: Apparatus,
    respondent: Respondent,
    monitor: Monitor | None = None,
) -> None:
    """Do what is left of a participant's session."""
    session = Session(dataset.design, dataset.admit(pseudonym, apparatus.name))
    try:
        with TrialLog(dataset.log_path(pseudonym)) as log:
            session.replay(log.entries)
            if session.step is None:
                return
            log.append("begin", apparatus=apparatus.name, design_sha256=dataset.design.sha256, **versions())
            try:
                keep = partial(dataset.keep_frames, pseudonym)
                conduct(session, log, apparatus, respondent, keep, monitor)
                dataset.finish(pseudonym, log)
            finally:
                dataset.write_tables(pseudonym)
    except RefusedError:
        dataset.forget(pseudonym, keeps_reports=True)
        raise


def versions() -> dict[str, str]:
    """Return the versions that a session was done with."""
    return {
        "proximity": proximity.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
