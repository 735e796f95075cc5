"""Reads the Parquet files of a campaign with whichever foreign reader is installed and compares them with summary.json."""
import importlib
import json
import math
import sys

SKIPPED = 77


def with_pyarrow(module, path):
    del module
    import pyarrow.parquet

    return pyarrow.parquet.read_table(path).to_pydict()


def with_duckdb(module, path):
    relation = module.sql(f"select * from '{path}'")
    rows = relation.fetchall()
    return {name: [row[i] for row in rows] for i, name in enumerate(relation.columns)}


def with_polars(module, path):
    return module.read_parquet(path).to_dict(as_series=False)


def readers():
    for name, read in [("duckdb", with_duckdb), ("pyarrow", with_pyarrow), ("polars", with_polars)]:
        try:
            yield name, importlib.import_module(name), read
        except ImportError:
            pass


def check(folder, module, read):
    with open(f"{folder}/summary.json", encoding="utf-8") as file:
        summary = json.load(file)
    runs = read(module, f"{folder}/runs.parquet")
    times = read(module, f"{folder}/times.parquet")
    assert runs["run"] == list(range(summary["runs"])), "a row a run, in order"
    assert times["run"] == runs["run"]
    assert list(times) == ["run", "step_median_us", "step_worst_us"]
    for cell in summary["cells"]:
        rows = [i for i, index in enumerate(runs["cell"]) if index == cell["cell"]]
        for setting in cell["settings"]:
            assert {str(runs[setting["key"]][i]) for i in rows} == {setting["value"]}
        assert sum(runs["success"][i] is True for i in rows) == cell["success"]["count"]
        for name in ["rms_mm", "p95_mm", "max_mm", "final_mm", "rotation_rev"]:
            values = [runs[name][i] for i in rows if runs[name][i] is not None]
            spread = cell[name]
            assert spread["count"] == len(values)
            # Two ways to add up a few thousand numbers.
            assert math.isclose(math.fsum(values) / len(values), spread["mean"]["value"], rel_tol=1e-12, abs_tol=1e-15)
            assert max(values) == spread["worst"]
    tracks = read(module, f"{folder}/tracks.parquet")
    assert set(tracks["run"]) == set(runs["run"])
    assert all(math.isfinite(x) for name in ["x_mm", "y_mm", "z_mm", "time_s"] for x in tracks[name])


found = list(readers())
if not found:
    sys.exit(SKIPPED)
for name, module, read in found:
    check(sys.argv[1], module, read)
    print(f"{name} {module.__version__} agrees")
