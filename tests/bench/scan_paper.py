"""The comparison of Guo and others (MM Science Journal) by driven clouds: five axes against three on a part of their size.

    python tests/bench/scan_paper.py [path of umi]

Writes a mesh of 135 x 380 x 650 mm with normals to 60 degrees, plans it for five axes and for the same machine with its
rotary axes clamped, drives both paths on the virtual machine with the same sensor at the same feed, and prints one row
for each. Takes minutes. The figures: tests/bench/PLAN.md.
"""

import csv
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

FEED = 120.0  # mm/min, theirs
NOISE_UM = 37.1  # straight on: so that what lies straight on deviates as their five axes do
# The noise lies along the beam and grows with this power of 1/cos of the incidence. Its part across the surface, which is the
# deviation, stays the same with 1, and grows with 1/cos with 2.
POWERS = [1, 2]
EVERY_MS, COLUMNS = 500, 32  # a profile each millimetre

HEAD = """[part]
rotation_deg = [90, 0, 90]
[sensor]
line_mm = 16.0
reference_mm = 60.0
range_mm = [52.0, 68.0]
max_incidence_deg = 60.0
receiver_mm = [0.0, 30.0, -10.0]
body_mm = [[-20.0, -20.0, -100.0], [20.0, 60.0, -5.0]]
[plan]
overlap = 0.15
stand_off_tolerance_mm = 1.0
max_tilt_deg = TILT
min_coverage = 0.97
clearance_mm = 3.0
max_step_mm = 2.0
max_turn_deg = 6.0
[machine]
travel_mm = { X = [-900, 900], Y = [-900, 900], Z = [-900, 900] }
mount = { origin_mm = [-150, 0, 0], beam = [-1, 0, 0], line = [0, 1, 0] }
"""
# A lathe that mills: the part lies along C, which rolls it; B swings the head; the spindle stands.
AXES = """[[machine.table]]
name = "C"
axis = [0, 0, 1]
point_mm = [-100, 0, 0]
limits_deg = [-360, 360]
[[machine.head]]
name = "B"
axis = [0, 1, 0]
limits_deg = [-110, 110]
"""
# Name, largest tilt, rotary axes.
PLANS = [("five axes", 10.0, AXES), ("three axes, 10 degrees", 10.0, ""), ("three axes, any tilt", 65.0, "")]


CELLS = 125


def height(i, j):
    """A corner of the mesh, that of the test `the_papers_part_on_five_axes_and_on_three`."""
    x, y = (2 * i / CELLS - 1) * 190.0, (2 * j / CELLS - 1) * 325.0
    return x, y, 110.0 * (1 - abs(x / 190.0) ** 2.985) - 122.5 + 12.5 * math.cos(math.pi * y / 325.0)


def part(path):
    n = CELLS + 1
    number = lambda i, j: i * n + j + 1
    with open(path, "w") as file:
        file.writelines("v %r %r %r\n" % height(i, j) for i in range(n) for j in range(n))
        for i in range(CELLS):
            for j in range(CELLS):
                a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
                file.write(f"f {a} {b} {c}\nf {a} {c} {d}\n")


def umi(binary, *arguments):
    run = subprocess.run([binary, "scan", *map(str, arguments), "--json"], capture_output=True, text=True)
    answer = json.loads(run.stdout) if run.stdout else {"error": {"message": run.stderr}}
    if run.returncode:
        sys.exit(f"umi scan {arguments[0]}: {answer['error']['message']}")
    return answer


def rotary_seconds(path, answer):
    """Time in which a rotary axis, not the way of X Y Z and the point, says how long a row takes."""
    rows = [line.split(",") for line in open(path)]
    names, rows = rows[0], [list(map(float, row)) for row in rows[1:]]
    first = 14
    total = 0.0
    for a, b in zip(rows, rows[1:]):
        turn = max((abs(x - y) for x, y in zip(a[first:], b[first:])), default=0.0)
        tip = [[row[2 + k] + 60.0 * row[5 + k] for k in range(3)] for row in (a, b)]
        on = a[1] == 1 and b[1] == 1 and a[0] == b[0]
        way = math.dist(*tip) / (FEED / 60) if on else 0.0
        way = max(way, math.dist(a[11:14], b[11:14]) / answer["duration_at"]["rapid_mm_per_s"])
        total += max(0.0, turn / answer["duration_at"]["turn_deg_per_s"] - way)
    return total


def weighed(cloud):
    """The root of the mean square and the mean amount of a driven cloud's distances from the mesh, each place of the area as much
    as another: on a slope the points lie farther apart."""
    z = [[height(i, j)[2] for j in range(CELLS + 1)] for i in range(CELLS + 1)]
    across, along = 380.0 / CELLS, 650.0 / CELLS
    facets = {}
    with open(cloud) as file:
        for row in csv.DictReader(file):
            x, y, found = (float(row[name]) for name in ("x_mm", "y_mm", "z_mm"))
            u, v = (x + 190.0) / across, (y + 325.0) / along
            i, j = min(max(int(u), 0), CELLS - 1), min(max(int(v), 0), CELLS - 1)
            u, v = u - i, v - j
            a, b, c, d = z[i][j], z[i + 1][j], z[i + 1][j + 1], z[i][j + 1]
            by_u, by_v = (b - a, c - b) if u >= v else (c - d, d - a)
            steep = math.sqrt(1 + (by_u / across) ** 2 + (by_v / along) ** 2)
            off = (found - a - u * by_u - v * by_v) / steep
            sums = facets.setdefault((i, j, u >= v), [0, steep, 0.0, 0.0])
            sums[0] += 1
            sums[2] += off * off
            sums[3] += abs(off)
    area = sum(steep for _, steep, _, _ in facets.values())
    square = sum(steep * squares / n for n, steep, squares, _ in facets.values()) / area
    return math.sqrt(square), sum(steep * amounts / n for n, steep, _, amounts in facets.values()) / area


def main():
    binary = sys.argv[1] if len(sys.argv) > 1 else "umi"
    print("plan | way, mm | way with links, mm | time, s | of it turning alone, s | passes | share seen", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        part(folder / "part.obj")
        for name, tilt, axes in PLANS:
            spec, path, cloud = folder / "spec.toml", folder / "path.csv", folder / "cloud.csv"
            spec.write_text(HEAD.replace("TILT", str(tilt)) + axes)
            plan = umi(binary, "plan", folder / "part.obj", "--spec", spec, "-o", path, "--feed", FEED, "--allow-partial", "--force", "--time-limit", 600)
            print(
                f"{name} | {plan['scan_length_mm']:.0f} | {plan['path_length_mm']:.0f} | {plan['duration_s']:.0f} | {rotary_seconds(path, plan):.1f} | "
                f"{plan['passes']} | {plan['coverage']:.3f}",
                flush=True,
            )
            for power in POWERS:
                driven = umi(
                    binary, "drive", folder / "part.obj", "--spec", spec, path, "-o", cloud, "--feed", FEED, "--every-ms", EVERY_MS,
                    "--columns", COLUMNS, "--noise-um", NOISE_UM, "--noise-power", power, "--force",
                )
                rms, mean = weighed(cloud)
                print(
                    f"  driven, power {power}: {driven['machine_s']:.0f} s, {driven['points']} points, {driven['coverage']:.3f} of the area, rms "
                    f"{driven['deviations']['rms_mm']:.4f} mm; by area rms {rms:.4f}, mean {mean:.4f} mm",
                    flush=True,
                )
            for u in plan["uncovered"]:
                print(f"  not seen: {u['area_mm2']:.0f} mm2, {u['reason']}", flush=True)


if __name__ == "__main__":
    main()
