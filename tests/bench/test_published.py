"""Figures of the documentation are generated from the published runs."""

import json
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import publish
import pytest

from benchmarks.publication import charts, sections, tables
from benchmarks.queries import results

ROOT = Path(__file__).resolve().parents[2]
BENCH = ROOT / "bench"

MACHINE = {
    "processor": "Fast(R) Processor 9 (family 1, avx2)", "system": "Linux x86_64, 2 cores",
    "python": "Python 3.11.7, numpy 2.4.6", "threads": "one", "commit": "abc1234",
    "date": "2026-11-21 23:00 UTC", "load": "0.1, 0.2, 0.3",
}  # fmt: skip


def comparison(section, contender, median, times_ours, wrong=0):
    agreement = {"wrong_sign_count": wrong, "checked_count": 100}
    return {
        "section": section,
        "case": "plate/near",
        "contender": contender,
        "version": "1.2",
        "unit": "µs a query",
        "median": median,
        "p99": 2 * median,
        "times_ours": times_ours,
        "agreement": agreement,
    }


def tick_document(p50=5.0, processor="Fast"):
    figures = {"p50": p50, "p99": 20.0, "p999": 300.0}
    row = {
        "case": "fingers/plate",
        "part_count": 1,
        "face_count": 87_304,
        "finger_count": 5,
        "tick_count": 20_000,
        "thread": figures,
        "wall": figures,
        "best": {"p50": 4.0, "p99": 6.0, "p999": 8.0},
        "bare": {"p50": 4.0, "p99": 5.0, "p999": 90.0},
        "verdicts": [
            {"requirement": "p50 at most 10 µs", "measured": "5 µs", "is_met": True},
            {"requirement": "p99.9 at most 50 µs", "measured": "300 µs", "is_met": False},
        ],
    }
    return {"machine": MACHINE | {"processor": processor}, "rows": [row]}


@pytest.mark.parametrize(
    ("path", "made"),
    [
        (sections.README, sections.summary),
        *(
            (sections.PAGES / name, partial(sections.section, names=runs))
            for name, runs in sections.PAGES_OF.items()
        ),
    ],
)
def test_pages_have_the_figures_of_the_published_runs(path, made):
    """After a change of the generators: ``python bench/publish.py --from-json``."""
    text = path.read_text(encoding="utf-8")

    assert sections.replaced(text, made(sections.read(sections.PUBLISHED))) == text


def test_charts_have_the_figures_of_the_published_runs():
    """After a change to what draws them: ``python bench/publish.py --from-json``."""
    drawn = charts.charts(sections.read(sections.PUBLISHED))
    folder = sections.PAGES / sections.PERFORMANCE

    assert {name: (folder / name).read_text(encoding="utf-8") for name in drawn} == drawn
    assert {path.name for path in folder.glob("times*.svg")} == drawn.keys()


def test_chart_of_points_names_every_library_with_its_median():
    document = sections.read(sections.PUBLISHED)["report_v3"]
    medians = {
        row["contender"]: row["median"]
        for row in document["rows"]
        if (row["section"], row["case"]) == (results.SIGNED, "plate/near")
    }

    panel = charts.beside_others(document["rows"], results.SIGNED)

    assert [bar.name for bar in panel.bars] == ["proximity", "FCPW", "Warp", "libigl", "trimesh"]
    assert [bar.time for bar in panel.bars] == [medians[bar.name] for bar in panel.bars]
    assert panel.bars[1].remark == "<0.1 % of signs wrong"


def test_bar_much_longer_than_the_others_is_cut():
    bars = [charts.Bar("proximity", 1.0), charts.Bar("near", 5.0), charts.Bar("<far>", 100.0)]

    root = ElementTree.fromstring(charts.drawing("Times", "here", [charts.Panel("Points", "µs", bars)]))

    widths = [float(each.get("width")) for each in root.iter("{http://www.w3.org/2000/svg}rect")]
    assert widths[1] == pytest.approx(5.0 * widths[0], rel=0.01)
    assert sum(widths[2:]) < widths[1] and len(widths) == 4
    assert {"100", "<far>"} <= {each.text for each in root.iter("{http://www.w3.org/2000/svg}text")}


def test_published_pictures_are_there_and_small():
    for name in sections.PICTURES:
        assert (sections.PAGES / sections.PERFORMANCE / f"{name}.png").stat().st_size <= 100_000, name


def test_requirement_stands_beside_the_fastest_rival_and_whether_it_is_met():
    rows = [
        comparison(results.SIGNED, "proximity", 0.5, 1.0),
        comparison(results.SIGNED, "Warp", 1.0, 2.0, wrong=18),
        comparison(results.SIGNED, "FCPW", 4.0, 8.0),
    ]

    lines = tables.others_table({"rows": rows})

    assert lines[1] == "<summary>plate: 1 of 2 met</summary>"
    assert lines[5] == "| points, signed, µs each | 0.5 | 1 Warp, 18 % of its signs wrong | 2 | 4 | no |"
    assert lines[6] == "|  |  | 4 FCPW | 8 | 4 | yes |", "the fastest whose signs are right"


def test_a_rival_stands_beside_ours_that_answers_the_same():
    rows = [
        comparison(results.RAYS, "proximity", 0.5, 1.0),
        comparison(results.RAYS, "proximity (distances)", 0.4, 1.0),
        comparison(results.RAYS, "embreex", 0.6, 1.5) | {"beside": "proximity (distances)"},
        comparison(results.RAYS, "embreex (all outputs)", 0.7, 1.4) | {"beside": "proximity"},
    ]

    lines = tables.others_table({"rows": rows})

    assert lines[5] == "| rays, µs each | 0.4 | 0.6 embreex | 1.5 | 1 | yes |"
    assert lines[6] == "|  | 0.5 | 0.7 embreex (all outputs) | 1.4 | 1 | yes |"


def test_requirement_that_is_not_met_is_named():
    text = sections.section(
        {"ticks": tick_document(), "ticks_epyc": tick_document(processor="EPYC")}, ("ticks",)
    )

    assert "1 of 2 are met. Not met:\n\n- p99.9 at most 50 µs: 300 µs" in text
    assert "commit abc1234, load 0.1 when it began" in text
    assert "Beside it: EPYC, Linux x86_64, 2 cores" in " ".join(text.split())


def _empty_pages(folder):
    """Write pages of marks alone; return their paths by name."""
    pages = {name: folder / name for name in sections.PAGES_OF}
    for path in pages.values():
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"{sections.BEGIN}\n{sections.END}\n", encoding="utf-8")
    return pages


@pytest.mark.parametrize("text", ["", "{end}{begin}", "{begin}{end}{end}"])
def test_page_without_marks_is_refused(text, tmp_path, capsys):
    path = _empty_pages(tmp_path)["performance/results.md"]
    path.write_text(text.format(begin=sections.BEGIN, end=sections.END), encoding="utf-8")

    words = ["--from-json", "--published", str(tmp_path), "--pages", str(tmp_path)]

    assert publish.main(words) == 1
    assert "expected one line" in capsys.readouterr().err


def test_publishing_from_json_writes_pictures_and_page(tmp_path):
    rows = [
        {"axis": "faces", "series": "scene", "quantity": "memory", "unit": "bytes"}
        | {"x": x, "median": 100 * x, "p99": None, "count": 1}
        for x in (1e3, 1e4, 1e5)
    ]
    slope = {"slope": 1.0, "error": 0.0, "factor": 100.0, "first": 1e3, "last": 1e5, "count": 3}
    fits = [{"axis": "faces", "series": "scene", "quantity": "memory"} | slope]
    document = {"machine": MACHINE, "rows": rows, "fits": fits, "left_out": ["10⁷ faces are left out."]}
    (tmp_path / "growth.json").write_text(json.dumps(document), encoding="utf-8")
    pages = _empty_pages(tmp_path)

    exit_code = publish.main(["--from-json", "--published", str(tmp_path), "--pages", str(tmp_path)])

    text = pages["performance/growth.md"].read_text(encoding="utf-8")
    assert exit_code == 0
    assert "| its memory | 1000 to 10⁵ faces | 100 kB to 10 MB | 1.00 ± 0.00 |  |" in text
    assert "10⁷ faces are left out." in text
    assert (tmp_path / "performance/growth_faces.png").is_file()


def test_run_that_fails_publishes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(publish.RUNS, "growth", ["--only", "nowhere"])

    assert publish.main(["--only", "growth", "--published", str(tmp_path / "new")]) == 1
    assert "growth.py ended with 2: no figures are published" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
