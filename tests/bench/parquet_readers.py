"""What DuckDB and pyarrow read of a Parquet file of `umi scan merge`, beside its CSV.

    pip install duckdb pyarrow
    cargo build --release -p umi
    python tests/bench/parquet_readers.py

Merges the project's five-axis reference case to both, a latch left out, so that one profile is interpolated and marked.
Prints versions, columns and the largest difference of each column; ends with an error where one is not 0.
"""

import os
import subprocess
import tempfile
from pathlib import Path

import duckdb
import pyarrow
import pyarrow.parquet

TOP = Path(__file__).resolve().parents[2]
UMI = os.environ.get("UMI", str(TOP / "target/release/umi"))
CASE = TOP / "tests/reference/scan/merge_5axis_latency"


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = Path(f"{CASE}.triggers.csv").read_text().splitlines()
        del rows[len(rows) // 2]
        triggers = folder / "triggers.csv"
        triggers.write_text("\n".join(rows) + "\n")
        for kind in ("csv", "parquet"):
            command = [UMI, "scan", "merge", f"{CASE}.profiles.csv", str(triggers), "--machine", f"{CASE}.toml"]
            more = ["--latency-us", "137", "--times-too", "--interpolate-ms", "1000", "-o", str(folder / f"cloud.{kind}"), "--json"]
            subprocess.run(command + more, check=True, stdout=subprocess.DEVNULL)
        file, table = folder / "cloud.parquet", folder / "cloud.csv"
        read = pyarrow.parquet.read_table(file)
        db = duckdb.connect()
        names = [row[0] for row in db.sql(f"describe from '{file}'").fetchall()]
        assert names == read.schema.names, (names, read.schema.names)
        off = ", ".join(f'max(abs(p."{n}"::double - q."{n}"::double))' for n in names)
        csv = f"read_csv('{table}', auto_type_candidates=['BIGINT', 'DOUBLE'])"
        [found] = db.sql(f"select count(*), sum(p.interpolated::int), {off} from '{file}' p join {csv} q using (profile, \"index\")").fetchall()
        [(lines,)] = db.sql(f"select count(*) from {csv}").fetchall()
        print(f"DuckDB {duckdb.__version__}, pyarrow {pyarrow.__version__}: {', '.join(names)}")
        print(f"{found[0]} points of {lines} in the CSV, {found[1]} interpolated; largest differences {found[2:]}")
        same = found[0] == lines == read.num_rows and found[1] > 0 and not any(found[2:])
        # The same by pyarrow, column by column.
        other = db.sql(f"from '{file}'").to_arrow_table() if hasattr(db.sql("select 1"), "to_arrow_table") else db.sql(f"from '{file}'").arrow()
        for column in names:
            same = same and other.column(column).to_pylist() == read.column(column).to_pylist()
        raise SystemExit(0 if same else "THEY DIFFER")


if __name__ == "__main__":
    main()
