"""Does LinuxCNC's own interpreter bring the axes to every row of a planned path?

    umi scan plan part.stl --spec spec.toml -o path.csv --nc path.ngc --dialect linuxcnc
    python tests/bench/scan_linuxcnc.py path.ngc path.csv X Y Z A B S

The last arguments are the path's columns for LinuxCNC's axes X Y Z A B C, in this order; `-` where an axis is not used.
`rs274` of LinuxCNC 2.8 or later must be on the PATH (Debian: `linuxcnc-uspace`). Alone it knows these six axes, so that
the spindle's orientation needs one of their words: `spindle = { orient_deg = [...], word = "C" }`.
Status 1 unless every row comes, in order, within 0.001, and the program comes from and goes back to one height above all
rows, along Z alone.
"""

import csv
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ALLOWED = 0.001


def main():
    program, path, *columns = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        tools, parameters = Path(folder) / "tool.tbl", Path(folder) / "parameters.var"
        tools.write_text("")
        parameters.write_text("5161\t0\n5162\t0\n5163\t0\n")
        run = subprocess.run(
            ["rs274", "-g", "-t", str(tools), "-v", str(parameters), program], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
    motions = [
        [float(word) for word in found.group(1).split(",")]
        for found in re.finditer(r"STRAIGHT_(?:FEED|TRAVERSE)\(([^)]*)\)", run.stdout)
    ]
    with open(path, newline="") as file:
        rows = [[float(row[name]) if name != "-" else 0.0 for name in columns] for row in csv.DictReader(file)]
    next_motion, worst, came = 0, 0.0, 0
    for row in rows:
        for number in range(next_motion, len(motions)):
            off = max(abs(a - b) for a, b in zip(motions[number], row))
            if off <= ALLOWED:
                worst, came, next_motion = max(worst, off), came + 1, number + 1
                break
    top, (first, last) = max(row[2] for row in rows), (motions[0], motions[-1])
    ends = first[2] == last[2] >= top and first[:2] == [0.0, 0.0] and all(abs(a - b) <= ALLOWED for a, b in zip(last[:2] + last[3:], rows[-1][:2] + rows[-1][3:]))
    print(f"{came} of {len(rows)} rows, in order, by {len(motions)} motions; off by {worst:.6f} at most; ends at Z{first[2]}: {'yes' if ends else 'NO'}")
    sys.exit(0 if came == len(rows) and ends else 1)


if __name__ == "__main__":
    main()
