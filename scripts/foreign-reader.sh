#!/usr/bin/env bash
# Installs a reader of Parquet that is not ours (DuckDB, one wheel without dependencies) for the test that opens a campaign's result.
set -euo pipefail
cd "$(dirname "$0")/.."
venv=target/foreign-reader
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/python" -c 'import duckdb' 2>/dev/null || "$venv/bin/pip" install --quiet --disable-pip-version-check duckdb
"$venv/bin/python" -c 'import duckdb; print("duckdb", duckdb.__version__)'
