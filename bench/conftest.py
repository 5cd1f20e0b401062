"""What the pytest-benchmark suites share: one thread, contenders made once, and answers that were compared.

``python -m pytest bench/bench_points.py -k "featuretype and near"`` runs a part. The report (`report.py`) is
the fairer comparison, since it interleaves; these suites follow one contender from commit to commit.
"""

import one_thread

one_thread.hold_to_one_thread()

import agreement  # noqa: E402
import pytest  # noqa: E402

import cases  # noqa: E402 - NumPy counts its threads on import
import rivals  # noqa: E402

BY_NAME = {kind.name: kind for kind in rivals.CONTENDERS}


def pytest_collection_modifyitems(items):
    """Warnings of the rivals are theirs."""
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("ignore"))


@pytest.fixture(scope="session")
def contenders():
    """Contenders made so far, by name."""
    return {}


@pytest.fixture
def built(contenders):
    """A call that gives the contender *name*, ready to be asked about the mesh of *case*."""

    def give(name, case):
        if name not in contenders:
            found, missing = rivals.available((BY_NAME[name],))
            if missing:
                pytest.skip(f"{name} is not installed: {missing[name]}")
            contenders[name] = found[0]
        contenders[name].build(case.vertices, case.faces)
        return contenders[name]

    return give


@pytest.fixture
def load_case():
    """A call that makes the case *name*, or skips where its mesh is not here."""

    def load(name, query_count=cases.BATCH_COUNT):
        try:
            return cases.make_case(name, query_count)
        except cases.MissingMeshError as reason:
            pytest.skip(str(reason))

    return load


@pytest.fixture
def run_case(benchmark, built, load_case):
    """A call that checks the lengths of an answer against the oracle, and times it."""

    def run(contender_name, case_name, question, query_count):
        case = load_case(case_name, query_count)
        asked = built(contender_name, case)
        found = agreement.check_all(case, question, [asked])[contender_name]
        task = agreement.ask(asked, case, question)
        benchmark.group = f"{question}, {case}"
        benchmark.extra_info.update(version=asked.version, wrong_signs=found.wrong_sign_count)
        benchmark(task.run)
        assert found.off_count == 0, f"{found.off_count} of {found.checked_count} lengths are wrong"

    return run
