"""`estim batch`: many runs one by one, whatever befalls any of them, and the same numbers however
the work is spread.
"""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from command_runner import runner
from troubles import Disk

from estim.batch import RunRow, Settings, run_batch, shard_of, spreads, units_of
from estim.batch.rows import Value, keep, kept
from estim.batch.units import Unit
from estim.campaign import Campaign, load_campaign
from estim.cli.commands import cli
from estim.common import EstimError, InputError, key_of, write_whole
from estim.reports.batch import batch_report, lean_files, overview_figure

QUICK = Settings(ess=300.0)
TIMES = np.arange(0.0, 3.0, 0.25)


def campaign(folder: Path, runs: dict[str, float], kind: str = "synthetic") -> Path:
    """Straight lines of the slopes `runs`, each with its own noise."""
    folder.mkdir(parents=True)
    text = (
        f'title = "{folder.name}"\nkind = "{kind}"\n[curve]\nexpression = "a + b*x"\nx = '
        f'{{column = "t", unit = "s"}}\n'
    )
    text += (
        'y = {column = "y", unit = "m"}\nu_y = 0.1\n[curve.parameters]\na = {start = 0.0}\nb '
        '= {start = 1.0, unit = "m/s"}\n'
    )
    for i, (name, slope) in enumerate(runs.items()):
        y = 1.0 + slope * TIMES + 0.1 * np.random.default_rng(i).standard_normal(TIMES.size)
        (folder / f"{name}.csv").write_text(
            "t,y\n" + "".join(f"{t},{v:.6f}\n" for t, v in zip(TIMES, y, strict=True))
        )
        text += f'[[runs]]\nname = "{name}"\nfile = "{name}.csv"\n'
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


@pytest.fixture
def three(tmp_path: Path) -> Path:
    return campaign(tmp_path / "in" / "spring", {"a": 2.0, "b": 2.0, "c": 2.0}).parent


def batch(*arguments: object):
    return runner().invoke(cli, ["batch", *map(str, arguments), "--jobs", "1"])


def files_in(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("result.json"))
    }


def test_one_bad_file_stops_no_other_and_is_told(three: Path, tmp_path: Path) -> None:
    (three / "b.csv").write_text(
        "t,y\n0.0,1.0\n0.5,word\n" + "".join(f"{t},{t}\n" for t in range(1, 9))
    )
    (tmp_path / "in" / "worse").mkdir()
    (tmp_path / "in" / "worse" / "campaign.toml").write_text("title = 3\n")
    done = batch(tmp_path / "in", "--out", tmp_path / "out")
    assert done.exit_code == 3
    assert "4 runs: 2 ok, 2 without a result" in done.output
    for words in (
        "error: b: ",
        "b.csv:3: 'y' must be a number",
        "worse/campaign.toml:1: 'title' must be text",
    ):
        assert words in done.stderr
    with (tmp_path / "out" / "summary.csv").open() as file:
        lines = {line["run"]: line for line in csv.DictReader(file)}
    assert [lines[name]["status"] for name in ("a", "b", "c", "")] == [
        "ok",
        "no result",
        "ok",
        "no result",
    ]
    assert abs(float(lines["a"]["b [m/s]"]) - 2.0) < 4.0 * float(lines["a"]["b [m/s] sd"])
    assert (lines["a"]["why"], lines["b"]["b [m/s]"]) == ("", "")
    report = (tmp_path / "out" / "report.md").read_text()
    assert (
        report.index("SYNTHETIC data") < report.index("## Quantities") < report.index("## Not ok")
    )
    assert "![" in report
    assert (tmp_path / "out" / "figures" / "overview.png").stat().st_size > 5000
    assert sorted(files_in(tmp_path / "out")) == ["spring/a/result.json", "spring/c/result.json"]


def test_a_run_in_a_batch_has_the_numbers_of_the_run_alone(three: Path, tmp_path: Path) -> None:
    batch(three, "--out", tmp_path / "out", "--figures", "none")
    runner().invoke(
        cli,
        [
            "fit",
            str(three / "campaign.toml"),
            "--run",
            "b",
            "--out",
            str(tmp_path / "alone"),
            "--figures",
            "none",
        ],
    )
    alone = json.loads((tmp_path / "alone" / "result.json").read_text())
    # not computed for a table
    assert json.loads((tmp_path / "out" / "spring" / "b" / "result.json").read_text()) == {
        **alone,
        "profile": None,
    }


def test_what_is_there_stays_and_what_changed_is_done_again(
    three: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    units, out = units_of([three]), tmp_path / "out"
    first = run_batch(units, out, report=lean_files, settings=QUICK)
    (three / "b.csv").write_text((three / "b.csv").read_text().replace("0.0,", "0.00,"))
    (out / "spring" / "c" / "result.json").unlink()
    done: list[str] = []

    def counting(subject, analysis):
        done.append(analysis.problem.runs[0].name)
        return lean_files(subject, analysis)

    again = run_batch(units, out, report=counting, settings=QUICK, resume=True)
    assert done == ["b", "c"]
    assert [row.values for row in again] == [row.values for row in first]
    run_batch(units, out, report=counting, settings=replace(QUICK, seed=2), resume=True)
    assert done == ["b", "c", "a", "b", "c"]


def test_a_run_that_was_changed_is_read_again_and_one_that_fails_keeps_no_older_result(
    tmp_path: Path,
) -> None:
    path = campaign(tmp_path / "one", {"a": 2.0})
    units, out = units_of([path]), tmp_path / "out"
    (first,) = run_batch(units, out, report=lean_files, settings=QUICK)
    table = (path.parent / "a.csv").read_text()
    (path.parent / "a.csv").write_text(table.replace("\n0.0,", "\n0.0,-"))
    (second,) = run_batch(units, out, report=lean_files, settings=QUICK)
    assert second.values != first.values
    (path.parent / "a.csv").write_text("t,y\n0,nothing\n")
    (third,) = run_batch(units, out, report=lean_files, settings=QUICK)
    assert (third.status, list(files_in(out))) == ("", [])


def test_a_fault_of_the_program_is_a_line_and_not_the_end(three: Path, tmp_path: Path) -> None:
    def broken(subject, analysis):
        if analysis.problem.runs[0].name == "b":
            raise ZeroDivisionError("by nought")
        return lean_files(subject, analysis)

    rows = run_batch(units_of([three]), tmp_path, report=broken, settings=QUICK)
    assert [row.status for row in rows] == ["ok", "", "ok"]
    assert "ZeroDivisionError: by nought" in rows[1].error


def pictures(subject, analysis):
    """A whole report, as far as files go."""
    return {
        **lean_files(subject, analysis),
        "report.md": b"![a](figures/a.png)",
        "report.html": b"a page",
        "figures/a.png": b"a picture",
    }


def test_nothing_of_an_earlier_batch_stands_beside_what_is_made_now(tmp_path: Path) -> None:
    path = campaign(tmp_path / "one", {"a": 2.0})
    units, out = units_of([path]), tmp_path / "out"
    run_batch(units, out, report=pictures, settings=QUICK)
    assert {p.name for p in (out / "one" / "a").rglob("*.*")} == {
        "a.png",
        "report.html",
        "report.md",
        "result.json",
        "row.json",
    }
    run_batch(units, out, report=lean_files, settings=QUICK)
    assert {p.name for p in (out / "one" / "a").rglob("*")} == {"result.json", "row.json"}
    run_batch(units, out, report=pictures, settings=QUICK)
    (path.parent / "a.csv").write_text("t,y\n0,nothing\n")
    run_batch(units, out, report=pictures, settings=QUICK)
    assert list((out / "one" / "a").rglob("*")) == []


def test_whatever_decides_a_result_decides_whether_it_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def key(
        *, campaign: str = "c", data: str = "d", truth: float = 1.0, run: str = "a", seed: int = 1
    ) -> str:
        tables = {name: SimpleNamespace(sha256=data) for name in "ab"}
        read = SimpleNamespace(sha256=campaign, tables=tables, truth={"p": truth})
        return key_of(Campaign.digests(read, [run]), Settings(seed=seed))  # type: ignore[arg-type]

    keys = [key(), key(campaign="C"), key(data="D"), key(truth=2.0), key(run="b"), key(seed=2)]
    assert key() == keys[0]
    monkeypatch.setattr("estim.versions.version", lambda package: f"next {package}")
    assert len({*keys, key()}) == 7


def test_a_row_stands_only_beside_its_own_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (plain,) = rows_of(np.array([1.0]), 0.1)
    unit = Unit(Path("c.toml"), "r0", plain.place)
    monkeypatch.setattr(
        "estim.batch.rows.row_of",
        lambda unit, data, labels, *, key, seconds, interval: rows[data.decode()],
    )
    rows = {text: msgspec.structs.replace(plain, key=text) for text in ("one", "two")}
    keep(tmp_path, rows["one"], {"result.json": b"one"})
    assert kept(tmp_path, unit, "one", None) == rows["one"]
    assert kept(tmp_path, unit, "two", None) is None

    def killed(target: Path, data: bytes, *, within: Path) -> None:
        if target.name != "row.json":
            raise KeyboardInterrupt
        write_whole(target, data, within=within)

    with monkeypatch.context() as patched:
        patched.setattr("estim.common.ownership.write_whole", killed)
        with pytest.raises(KeyboardInterrupt):
            keep(tmp_path, rows["two"], {"result.json": b"two"})
    assert (kept(tmp_path, unit, "one", None), kept(tmp_path, unit, "two", None)) == (None, None)
    keep(tmp_path, rows["one"], {"result.json": b"one"})  # what a kill left behind is nobody else's
    (tmp_path / plain.place / "result.json").unlink()
    assert kept(tmp_path, unit, "one", None) is None


def test_a_row_that_somebody_edited_is_not_believed_and_a_result_is_refused(
    three: Path, tmp_path: Path
) -> None:
    units, out = units_of([three]), tmp_path / "out"
    first = run_batch(units, out, report=lean_files, settings=QUICK)
    row, result = out / "spring" / "a" / "row.json", out / "spring" / "a" / "result.json"
    edited = json.loads(row.read_text())
    edited["values"]["b"]["mean"], edited["status"], edited["kind"] = 300.0, "ok", "measured"
    row.write_text(json.dumps(edited))
    again = run_batch(units, out, report=lean_files, settings=QUICK, resume=True)
    assert [(one.values, one.kind) for one in again] == [(one.values, one.kind) for one in first]
    result.write_text(result.read_text().replace("synthetic", "measured"))
    for resume in (True, False):
        with pytest.raises(
            EstimError, match=r"a/result.json: was not written by estim, or was changed since"
        ):
            run_batch(units, out, report=lean_files, settings=QUICK, resume=resume)


def test_a_folder_whose_name_is_not_utf8_is_a_run_like_any_other(tmp_path: Path) -> None:
    campaign(tmp_path / "in" / "one", {"a": 2.0})
    campaign(tmp_path / "two", {"b": 2.0})
    try:
        (tmp_path / "two").rename(tmp_path / "in" / os.fsdecode(b"tw\xff"))
    except OSError:
        pytest.skip("a file system of UTF-8 alone")
    done = batch(tmp_path / "in", "--out", tmp_path / "out", "--figures", "none")
    assert "2 runs: 2 ok" in done.output, done.output
    assert "tw\\udcff/campaign.toml" in (tmp_path / "out" / "summary.csv").read_text()
    again = batch(tmp_path / "in", "--out", tmp_path / "out", "--figures", "none", "--resume")
    assert "2 runs: 2 ok" in again.output, again.output


@pytest.mark.parametrize("kind", ["pipe", "dangling", "device", "folder without access"])
def test_a_campaign_that_is_no_file_is_told_in_a_line(
    kind: str, three: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = three.parent / "odd"
    place.mkdir()
    if kind == "pipe":
        os.mkfifo(place / "campaign.toml")
    elif kind == "dangling":
        (place / "campaign.toml").symlink_to(tmp_path / "gone.toml")
    elif kind == "device":
        (place / "campaign.toml").symlink_to("/dev/zero")
    else:  # root may read everything
        scan = os.scandir

        def refusing(path: str):
            if Path(path) == place:
                raise PermissionError(13, "Permission denied", str(path))
            return scan(path)

        monkeypatch.setattr("os.scandir", refusing)
    found = units_of([three.parent])
    assert [unit.run for unit in found] == ["", "a", "b", "c"]
    rows = run_batch(found[:1], tmp_path / "out", report=lean_files, settings=QUICK)
    assert rows[0].error.startswith(str(place / "campaign.toml"))


@pytest.mark.parametrize(
    ("status", "error", "code"), [("ok", "", 0), ("poor-fit", "", 3), ("", "cannot be read", 3)]
)
def test_one_run_that_is_not_ok_ends_the_command_with_3(
    status: str, error: str, code: int, three: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = rows_of(np.array([1.0, 1.1]), 0.1)
    rows[1] = msgspec.structs.replace(rows[1], status=status, error=error)
    monkeypatch.setattr("estim.batch.run_batch", lambda *_, **__: rows)
    assert batch(three, "--out", three.parent / "out", "--figures", "none").exit_code == code


def test_one_name_in_two_units_is_two_quantities() -> None:
    rows = rows_of(np.array([1.0, 1.1]), 0.1)
    other = [replace_row(row, unit="V", mean=100.0 + i) for i, row in enumerate(rows)]
    assert [(one.name, one.unit, one.rows, one.median) for one in spreads([*rows, *other])] == [
        ("a", "m", (0, 1), 1.05),
        ("a", "V", (2, 3), 100.5),
    ]
    table = list(
        csv.DictReader(
            batch_report([*rows, *other], figures="none")["summary.csv"].decode().splitlines()
        )
    )
    assert [(line["a [m]"], line["a [V]"]) for line in table] == [
        ("1.0", ""),
        ("1.1", ""),
        ("", "100.0"),
        ("", "101.0"),
    ]


def replace_row(row: RunRow, *, unit: str, mean: float) -> RunRow:
    return msgspec.structs.replace(
        row, values={"a": msgspec.structs.replace(row.values["a"], unit=unit, mean=mean)}
    )


def test_a_frame_interval_unlike_those_of_most_runs_is_told_in_the_batch() -> None:
    rows = [
        msgspec.structs.replace(row, interval=dt)
        for row, dt in zip(rows_of(np.full(4, 1.0), 0.1), (0.04, 0.04, 0.02, None), strict=True)
    ]
    text = batch_report(rows, figures="none")["report.md"].decode().replace("\u00a0", " ")
    assert (
        "| c.toml | r2 | the frames are 0.02 s apart, while those of most runs are 0.04 s "
        "apart: is the frame rate right? |" in text
    )
    elsewhere = [msgspec.structs.replace(row, campaign=f"{i}.toml") for i, row in enumerate(rows)]
    assert "the frames are" not in batch_report(elsewhere, figures="none")["report.md"].decode()


@pytest.mark.slow
def test_a_batch_is_verified_and_its_reports_have_figures_only_where_they_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    campaign(tmp_path / "one", {"a": 2.0})
    done = batch("one", "--reports", "--figures", "none", "--out", "out")
    assert done.exit_code == 0
    assert "1 run: 1 ok (" in done.output
    assert (tmp_path / "out" / "one" / "a" / "report.md").is_file()
    assert not list((tmp_path / "out").rglob("*.png"))
    assert (
        (tmp_path / "out" / "times.csv")
        .read_text()
        .startswith("campaign,run,cpu_s\none/campaign.toml,a,")
    )
    checked = runner().invoke(cli, ["verify", "out"])
    assert checked.exit_code == 0, checked.output


def test_shards_and_any_executor_give_the_same_bytes(three: Path, tmp_path: Path) -> None:
    units = units_of([three])
    run_batch(units, tmp_path / "whole", report=lean_files, settings=QUICK)
    for part in ("1/2", "2/2"):
        run_batch(shard_of(units, part), tmp_path / "shards", report=lean_files, settings=QUICK)
    with ThreadPoolExecutor(2) as executor:
        seen: list[int] = []
        rows = run_batch(
            units,
            tmp_path / "threads",
            report=lean_files,
            settings=QUICK,
            executor=executor,
            progress=seen.append,
        )
    assert [row.run for row in rows] == ["a", "b", "c"]
    assert seen == [1, 2, 3]
    whole = files_in(tmp_path / "whole")
    assert len(whole) == 3
    assert files_in(tmp_path / "shards") == files_in(tmp_path / "threads") == whole


def test_a_cluster_does_the_work_where_one_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in for dask.distributed: which address is asked, and that its executor does the
    work.
    """
    asked: list[str] = []

    class Client:
        def __init__(self, address: str, timeout: str) -> None:
            if address == "tcp://nowhere:1":
                raise OSError("Timed out")
            asked.append(address)
            self.pool = ThreadPoolExecutor(1)

        def __enter__(self):
            return self

        def __exit__(self, *_: object) -> None:
            self.pool.shutdown()

        def get_executor(self):
            asked.append("executor")
            return self.pool

    class Lost:
        def submit(self, *_: object) -> Future[object]:
            future: Future[object] = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    monkeypatch.setitem(sys.modules, "distributed", type("distributed", (), {"Client": Client}))
    only = campaign(tmp_path / "one", {"a": 2.0})
    assert (
        batch(
            only, "--out", tmp_path / "out", "--scheduler", "tcp://here:1", "--figures", "none"
        ).exit_code
        == 0
    )
    assert asked == ["tcp://here:1", "executor"]
    assert "cannot be reached (Timed out)" in str(
        batch(only, "--out", tmp_path / "no", "--scheduler", "tcp://nowhere:1").exception
    )
    monkeypatch.setattr(Client, "get_executor", lambda self: Lost())
    lost = batch(
        only, "--out", tmp_path / "out", "--scheduler", "tcp://here:1", "--figures", "none"
    )
    assert (
        str(lost.exception)
        == "'--scheduler' was lost (CancelledError); what is done is kept: continue with "
        "--resume: tcp://here:1"
    )
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert 'pip install "estim[dask]"' in str(
        batch(only, "--out", tmp_path / "no", "--scheduler", "tcp://here:1").exception
    )


@pytest.mark.slow
def test_verify_knows_what_other_processes_have_read(three: Path, tmp_path: Path) -> None:
    assert (
        runner()
        .invoke(
            cli,
            [
                "batch",
                str(three),
                "--jobs",
                "2",
                "--out",
                str(tmp_path / "out"),
                "--figures",
                "none",
            ],
        )
        .exit_code
        == 0
    )
    inputs = json.loads((tmp_path / "out" / "origin.json").read_text())["inputs"]
    assert {Path(path).name for path in inputs} == {"campaign.toml", "a.csv", "b.csv", "c.csv"}


def test_a_quantity_that_follows_from_other_runs_too_stops_none(
    project: Path, tmp_path: Path
) -> None:
    """As `estim fit --run` leaves it out where the other runs are not fit."""
    shutil.copytree(project / "data" / "replica", tmp_path / "replica")
    file = tmp_path / "replica" / "campaign.toml"
    file.write_text(
        file.read_text() + '\n[derived]\nratio = "gamma[heavy]/gamma[light]"\nown = "2*gamma"\n'
    )
    for run in ("light-01", "heavy-02"):
        campaign = load_campaign(file, only=run)
        assert campaign.run_names == (run,)
        (sought,) = {one.sought for one in campaign.problem([run]).runs}
        assert [(one.name, one.lacking != ()) for one in sought] == [
            ("ratio", True),
            ("own", False),
        ]


def test_a_campaign_without_runs_is_a_line_of_its_own(project: Path, tmp_path: Path) -> None:
    (row,) = run_batch(
        units_of([project / "data" / "trials"]), tmp_path, report=lean_files, settings=QUICK
    )
    assert row.status == ""
    assert row.error.endswith("campaign.toml: 'campaign' has no [[runs]]")


def test_places_are_told_apart(tmp_path: Path) -> None:
    for path in ("x/day 1/campaign.toml", "x/day-1/campaign.toml", "x/extra.toml"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("title = 3")
    units = units_of([tmp_path / "x", tmp_path / "x" / "extra.toml", tmp_path / "x"])
    assert [unit.place for unit in units] == ["day-1", "day-1-2", "extra"]
    assert [unit.place for unit in units_of([tmp_path / "x" / "extra.toml"])] == ["extra"]


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        (["empty"], "'folder' holds no campaign.toml"),
        (["full", "--shard", "3/2"], "'--shard' must be I/N"),
        (["full", "--shard", "0/2"], "'--shard' must be I/N"),
        (["nothing-there"], "cannot be found"),
    ],
)
def test_what_is_no_batch_is_refused(tmp_path: Path, arguments: list[str], rule: str) -> None:
    (tmp_path / "empty").mkdir()
    campaign(tmp_path / "full", {"a": 2.0})
    done = batch(tmp_path / arguments[0], *arguments[1:], "--out", tmp_path / "out")
    assert isinstance(done.exception, InputError)
    assert rule in str(done.exception)
    assert not (tmp_path / "out").exists()


def rows_of(means: np.ndarray, sd: float, *, informed: bool = True) -> list[RunRow]:
    values = [
        Value(float(m), sd, float(m - 2 * sd), float(m + 2 * sd), "m", informed) for m in means
    ]
    return [
        RunRow("c.toml", f"r{i}", f"c/r{i}", "measured", "ok", "", "", {"a": v}, 1.0, "")
        for i, v in enumerate(values)
    ]


def test_people_read_degrees_and_symbols_and_programs_radians(tmp_path: Path) -> None:
    """In a batch of rolling bodies, also where a run was kept from an earlier batch."""
    path = Disk().write(tmp_path)
    for resume in (False, True):
        rows = run_batch(
            units_of([path]), tmp_path / "out", report=lean_files, settings=QUICK, resume=resume
        )
        files = batch_report(rows, figures="none")
        (line,) = csv.DictReader(files["summary.csv"].decode().splitlines())
        table = [row.split(" | ") for row in files["report.md"].decode().splitlines()]
        (shown,) = [row for row in table if row[0] == "| θ₀"]
        assert shown[1] == "°"
        assert float(shown[3]) == pytest.approx(math.degrees(float(line["theta0 [rad]"])), rel=1e-3)


def test_what_stands_apart_is_named_and_what_scatters_is_not() -> None:
    means = np.random.default_rng(5).normal(3.0, 0.5, 400)
    (clean,) = spreads(rows_of(means, 0.1))
    assert clean.apart == ()
    # the estimator's sd is 1.17 sigma/sqrt(n)
    assert clean.scatter == pytest.approx(0.5, abs=4.0 * 1.17 * 0.5 / 20.0)
    assert clean.median == pytest.approx(3.0, abs=4.0 * 1.25 * 0.5 / 20.0)
    means[17] += 4.0
    (spoiled,) = spreads(rows_of(means, 0.1))
    assert spoiled.apart == (17,)
    assert spreads(rows_of(means, 0.1, informed=False))[0].apart == ()
    assert spreads(rows_of(means, 2.0))[0].apart == ()  # their own uncertainties are that large
    text = batch_report(rows_of(means, 0.1), figures="none")["report.md"].decode()
    assert "c.toml: r17" in text
    assert "SYNTHETIC" not in text


def test_runs_are_counted_in_whole_numbers_and_each_column_is_explained() -> None:
    rows = rows_of(np.array([1.0, 1.1, 0.9]), 0.1)
    figure = overview_figure(rows, spreads(rows))
    figure.draw_without_rendering()
    assert np.all(figure.axes[-1].get_xticks() % 1.0 == 0.0)
    text = batch_report(rows, figures="none")["report.md"].decode()
    (head,) = (line for line in text.splitlines() if line.startswith("| quantity |"))
    meaning = text.partition("Meaning of the columns")[2].lower()
    for column in ("scatter", "typical sd", "narrowed", "outlying"):
        assert column in head
        assert column in meaning


def test_a_cross_stands_only_where_the_run_has_the_quantity() -> None:
    values = np.array([1.0, 1.1])
    one = [msgspec.structs.replace(row, names=("a", "b")) for row in rows_of(values, 0.1)]
    other = [
        msgspec.structs.replace(row, campaign="d.toml", names=("a",))
        for row in rows_of(values, 0.1)
    ]
    bad = msgspec.structs.replace(other[0], status="poor-fit", values={})
    none = msgspec.structs.replace(one[0], status="", error="no file", values={}, names=())
    nobody = msgspec.structs.replace(none, campaign="e.toml")
    rows = [*one, *other, bad, none, msgspec.structs.replace(none, campaign="d.toml"), nobody]
    (a,) = spreads(rows)
    for spread, numbers in ((a, [5, 6, 7, 8]), (replace(a, name="b"), [6])):
        figure = overview_figure(rows, [spread])
        (crosses,) = (line for line in figure.axes[0].lines if line.get_marker() == "x")
        assert crosses.get_xdata().tolist() == numbers
    assert [text.get_text() for text in figure.legends[0].texts] == ["median"]
