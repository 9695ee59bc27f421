"""`umi scan merge` beside NumPy and Open3D: a capture of the thesis' 7.68 million samples to a binary PLY, in one run.

    pip install numpy open3d
    cargo build --release -p umi
    python tests/bench/merge_peers.py [PROFILES]

Makes a capture (a group a profile, one sample in 97 without a range), its latches and a machine of three axes. By turns,
each in a process of its own: openumi, which pairs as well; NumPy, a loop over the messages and a view of each, profile
and latch in their order; the same with Open3D writing the file (it reads no capture). Prints the table of
tests/bench/CLOUD.md: medians of seconds of the clock and of the processors, and the most memory. Compares all points,
and ends with an error where they are not the same floats.
"""

import os
import statistics
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from cloud_peers import UMI, run

WIDTH, ROUNDS, SEED = 1280, 5, 14
X_NM, Z_NM = 60_000, 2_500
STEP_MM, HEIGHT_MM = 0.0125, -140.0
STAMP, ATTRIBUTES = 56, 32

MACHINE = "".join(
    f'[[joint]]\nname = "{n.upper()}"\nkind = "linear"\ndirection = {d}\ncolumn = "{n}"\ncounts_per_mm = 10000.0\norigin_counts = 0\n\n'
    for n, d in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1]))
) + '[chain]\nsensor = ["X", "Y", "Z"]\nworkpiece = []\n\n[sensor]\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\ntranslation_mm = [0, 0, 0]\n'

PEER = """
import json, struct, sys, time
import numpy as np
capture, triggers, out, by = sys.argv[1:5]
if by == "open3d":
    import open3d as o3d
begin = time.perf_counter()
with open(triggers) as text:
    names = text.readline().strip().split(",")
    place = [names.index(n + "_counts") for n in "xyz"]
    rows = [row.split(",") for row in text]
at = np.array([[int(row[p]) for p in place] for row in rows]) / 10000.0
data = open(capture, "rb").read()
where, profile, parts = 0, 0, []
while where < len(data):
    size, control = struct.unpack_from("<IH", data, where)
    if control & 0x7FFF == 5:
        attributes, _, width, x_nm, z_nm, x_um, z_um = struct.unpack_from("<HIIIIii", data, where + 6)
        pairs = np.frombuffer(data, "<i2", 2 * width, where + 8 + attributes).reshape(-1, 2)
        pairs = pairs[pairs[:, 1] != -32768].astype(float)
        part = np.empty((len(pairs), 3))
        part[:, 0] = x_um * 1e-3 + pairs[:, 0] * (x_nm * 1e-6) + at[profile, 0]
        part[:, 1] = at[profile, 1]
        part[:, 2] = z_um * 1e-3 + pairs[:, 1] * (z_nm * 1e-6) + at[profile, 2]
        parts.append(part.astype("<f4"))
        profile += 1
    where += size
points = np.concatenate(parts)
made = time.perf_counter() - begin
if by == "open3d":
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    o3d.t.io.write_point_cloud(out, cloud)
    version = "Open3D " + o3d.__version__
else:
    with open(out, "wb") as file:
        file.write(b"ply\\nformat binary_little_endian 1.0\\nelement vertex %d\\n" % len(points))
        file.write(b"property float x\\nproperty float y\\nproperty float z\\nend_header\\n")
        points.tofile(file)
    version = "NumPy " + np.__version__
print(json.dumps({"version": version, "points": len(points), "step": time.perf_counter() - begin, "file": time.perf_counter() - begin - made}))
"""


def make(folder, profiles):
    """The capture, the board's table and the machine."""
    import numpy as np

    rng = np.random.default_rng(SEED)
    along = np.arange(WIDTH)
    intervals = rng.integers(4600, 5400, profiles)
    times_us = 1_000_000 + np.cumsum(intervals)
    rows = ["event,number,cause,t_ns,x_counts,y_counts,z_counts,w_counts,axis5_counts,axis6_counts,x_mm,y_mm,z_mm,lost"]
    with open(folder / "scan.gocator", "wb") as file:
        for number, t_us in enumerate(times_us.tolist()):
            stamp = struct.pack("<IHBBQQqqQ", 1, STAMP, 0, 0, number, round((t_us - 250_000) * 1.024), 0, 0, 0)
            stamp += bytes(8 + STAMP - len(stamp))
            file.write(struct.pack("<IH", 6 + len(stamp), 1) + stamp)
            head = struct.pack("<HIIIIiiBI", ATTRIBUTES, 1, WIDTH, X_NM, Z_NM, 0, 0, 0, 0)
            head += bytes(2 + ATTRIBUTES - len(head))
            z = 8000 * np.sin(along / 200 + number / 900) + rng.normal(0, 4, WIDTH)
            pairs = np.stack([along - WIDTH // 2, z], 1).round().astype("<i2")
            pairs[(along + 31 * number) % 97 == 0, 1] = -32768
            body = head + pairs.tobytes()
            file.write(struct.pack("<IH", 6 + len(body), 0x8005) + body)
            y = round(number * STEP_MM * 1e4)
            rows.append(f"latch,{number},output,{t_us * 1000},12345,{y},{round(HEIGHT_MM * 1e4)},0,0,0,,,,0")
    (folder / "scan.csv").write_text("\n".join(rows) + "\n")
    (folder / "machine.toml").write_text(MACHINE)


def floats(path):
    import numpy as np

    data = path.read_bytes()
    return np.frombuffer(data, "<f4", offset=data.index(b"end_header\n") + 11).reshape(-1, 3)


def main():
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    profiles = int(sys.argv[1]) if len(sys.argv) > 1 else 6000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, __file__, "make", name, str(profiles)], check=True)
        capture, table, machine = (str(folder / n) for n in ("scan.gocator", "scan.csv", "machine.toml"))
        files = {by: folder / f"{by}.ply" for by in ("openumi", "numpy", "open3d")}
        commands = {by: [sys.executable, "-c", PEER, capture, table, str(files[by]), by] for by in ("numpy", "open3d")}
        ours = [UMI, "scan", "merge", capture, table, "--machine", machine, "-o", str(files["openumi"]), "--force", "--json"]
        commands = {"openumi": ours, **commands}
        print(f"{profiles * WIDTH} samples, a capture of {os.path.getsize(capture) / 1e6:.1f} MB, {ROUNDS} rounds, load {os.getloadavg()[0]:.1f}\n")
        took = {by: [] for by in commands}
        told = {}
        for _ in range(ROUNDS):
            for by, command in commands.items():
                told[by], *figures = run(command)
                took[by].append((told[by].get("step"), *figures))
        print("| | clock | processors | memory | without starting Python, clock | points |")
        print("|---|---:|---:|---:|---:|---:|")
        for by, rows in took.items():
            step, clock, cpu, memory = ([row[k] for row in rows] for k in range(4))
            alone = f"{statistics.median(step):.2f} s" if step[0] is not None else ""
            print(
                f"| {told[by].get('version', 'openumi')} | {statistics.median(clock):.2f} s ({min(clock):.2f} to {max(clock):.2f})"
                f" | {statistics.median(cpu):.2f} s | {max(memory):.0f} MB | {alone} | {told[by]['points']} |"
            )
        if len(told["openumi"]["pairs"]) != profiles:
            raise SystemExit("not every profile has its latch")
        check = [sys.executable, __file__, "same", *map(str, files.values())]
        raise SystemExit(subprocess.run(check).returncode)


if __name__ == "__main__":
    if sys.argv[1:2] == ["make"]:
        make(Path(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1:2] == ["same"]:
        clouds = [floats(Path(path)) for path in sys.argv[2:]]
        same = all(cloud.shape == clouds[0].shape and (cloud == clouds[0]).all() for cloud in clouds)
        print("\nall points are the same floats" if same else "\nTHE POINTS DIFFER")
        raise SystemExit(0 if same else 1)
    else:
        main()
