"""`umi scan sample`, `filter` and `compare` beside Open3D: the same cloud, the same mesh, one run.

    pip install numpy open3d
    cargo build --release -p umi
    python tests/bench/cloud_peers.py [POINTS]

Two cores for either. Prints the table of tests/bench/CLOUD.md: seconds of processor time and of the clock from file to
file, the peer's step alone, the most memory, and whether both come to the same figures. Ends with an error where they
do not.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TOP = Path(__file__).resolve().parents[2]
UMI = os.environ.get("UMI", str(TOP / "target/release/umi"))
VOXEL_MM, NEIGHBOURS, SIGMAS, SEED = 0.5, 20, 2.0, 14

# A process of its own for each step, so that its memory is its own.
PEER = """
import json, sys, time
import numpy as np, open3d as o3d
task, cloud, mesh, out, voxel, k, sigmas = sys.argv[1:8]
o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
pc = o3d.io.read_point_cloud(cloud)
begin = time.perf_counter()
if task == "sample":
    got = pc.voxel_down_sample(float(voxel))
elif task == "filter":
    # The point itself is among its neighbours here; means are then k / (k + 1) times as large, and so is their limit.
    got, _ = pc.remove_statistical_outlier(int(k) + 1, float(sigmas))
else:
    scene = o3d.t.geometry.RaycastingScene(nthreads=2)
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(o3d.io.read_triangle_mesh(mesh)))
    points = np.asarray(pc.points, dtype=np.float32)
    d = scene.compute_signed_distance(o3d.core.Tensor(points), nthreads=2).numpy().astype(np.float64)
    figures = {"n": len(d), "mean_mm": d.mean(), "std_mm": d.std(ddof=1), "rms_mm": float(np.sqrt((d * d).mean()))}
    got = None
step = time.perf_counter() - begin
if got is not None:
    o3d.io.write_point_cloud(out, got)
    p = np.asarray(got.points)
    figures = {"kept": len(p), "mean": p.mean(0).tolist()}
print(json.dumps({"step": step, "version": o3d.__version__, **{k: v if isinstance(v, (list, int)) else float(v) for k, v in figures.items()}}))
"""


def run(command):
    """What it printed, seconds of the clock and of processors, and its most memory in MB."""
    begin = time.perf_counter()
    with tempfile.TemporaryFile("w+") as text:
        child = subprocess.Popen(command, stdout=text, env={**os.environ, "OMP_NUM_THREADS": "2"})
        _, status, used = os.wait4(child.pid, 0)
        clock = time.perf_counter() - begin
        text.seek(0)
        told = text.read()
    if status:
        raise SystemExit(f"{command[:4]} ended with {status}")
    return json.loads(told.strip().splitlines()[-1]), clock, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def make(folder, points):
    """A bumpy ball of 9940 triangles, closed, and points about it; some of them far off."""
    import numpy as np

    rng = np.random.default_rng(SEED)

    def radius(u, v):
        return 40 + 2 * np.sin(5 * u) * np.sin(v) ** 2

    def at(u, v, r):
        return np.stack([r * np.cos(u) * np.sin(v), r * np.sin(u) * np.sin(v), r * np.cos(v)], -1) + 60.0

    m, n = 71, 71
    u, v = 2 * np.pi * np.arange(m) / m, np.pi * np.arange(1, n) / n
    ring = at(*np.meshgrid(u, v, indexing="xy"), radius(*np.meshgrid(u, v, indexing="xy"))).astype("<f4")
    top, bottom = (at(np.array(0.0), np.array(w), np.array(40.0)).astype("<f4") for w in (0.0, np.pi))
    triangles = []
    for j in range(m):
        k = (j + 1) % m
        triangles.append([top, ring[0, j], ring[0, k]])
        triangles.append([bottom, ring[-1, k], ring[-1, j]])
        for i in range(n - 2):
            triangles.append([ring[i, j], ring[i + 1, j], ring[i + 1, k]])
            triangles.append([ring[i, j], ring[i + 1, k], ring[i, k]])
    triangles = np.array(triangles, dtype="<f4")
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    (folder / "mesh.stl").write_bytes(b" " * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes())
    # In the order of the surface, as a scan has it.
    pick = np.sort(rng.integers(0, len(triangles), points))
    a, b = rng.random((2, points))
    flip = a + b > 1
    a[flip], b[flip] = 1 - a[flip], 1 - b[flip]
    t = triangles[pick].astype(float)
    p = t[:, 0] + a[:, None] * (t[:, 1] - t[:, 0]) + b[:, None] * (t[:, 2] - t[:, 0])
    out = p - 60.0
    out /= np.linalg.norm(out, axis=1)[:, None]
    p += out * rng.normal(0, 0.01, points)[:, None]
    p[:: points // 1000] += rng.normal(0, 2.0, p[:: points // 1000].shape)
    # Open3D's grid begins half a cell before the least coordinates: this one begins where ours does.
    p[0] = np.floor(p.min(0) / VOXEL_MM) * VOXEL_MM - 0.5 * VOXEL_MM
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {points}\n"
    header += "".join(f"property double {c}\n" for c in "xyz") + "end_header\n"
    (folder / "cloud.ply").write_bytes(header.encode() + p.astype("<f8").tobytes())
    return len(triangles)


def main():
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    points = int(sys.argv[1]) if len(sys.argv) > 1 else 7_680_000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # In a process of its own: what this one holds would be counted to those that it starts.
        made = subprocess.run([sys.executable, __file__, "make", name, str(points)], stdout=subprocess.PIPE, check=True)
        triangles = int(made.stdout)
        cloud, mesh = str(folder / "cloud.ply"), str(folder / "mesh.stl")
        ours_out, peers_out = str(folder / "ours.ply"), str(folder / "peers.ply")
        tasks = {
            "sample": ("voxel grid of 0.5 mm", ["--voxel", str(VOXEL_MM), "-o", ours_out]),
            "filter": (f"outliers ({NEIGHBOURS} neighbours, {SIGMAS:g} sigma)", ["--statistical", f"{NEIGHBOURS},{SIGMAS}", "-o", ours_out]),
            "compare": (f"deviation from {triangles} triangles", ["--nominal", mesh]),
        }
        print(f"{points} points, two cores, load {os.getloadavg()[0]:.1f}\n")
        print("| task | openumi: CPU, clock, memory | Open3D: CPU, clock, memory | its step alone, clock | CPU, Open3D / openumi | agreement |")
        print("|---|---|---|---:|---:|---|")
        wrong = []
        for task, (what, more) in tasks.items():
            more = more if task == "compare" else [*more, "--double", "--force"]
            ours, clock, cpu, memory = run([UMI, "scan", task, cloud, *more, "--json"])
            peer = [sys.executable, "-c", PEER, task, cloud, mesh, peers_out, str(VOXEL_MM), str(NEIGHBOURS), str(SIGMAS)]
            theirs, peer_clock, peer_cpu, peer_memory = run(peer)
            if task == "compare":
                off = max(abs(ours[k] - theirs[k]) for k in ("mean_mm", "std_mm", "rms_mm"))
                same = ours["n"] == theirs["n"] and off < 2e-6
                told = f"figures within {off * 1e6:.2f} nm"
            else:
                same = ours["kept"] == theirs["kept"]
                told = f"{ours['kept']} and {theirs['kept']} points"
            if not same:
                wrong.append((task, ours, theirs))
            print(
                f"| {what} | {cpu:.1f} s, {clock:.1f} s, {memory:.0f} MB "
                f"| {peer_cpu:.1f} s, {peer_clock:.1f} s, {peer_memory:.0f} MB | {theirs['step']:.1f} s | {peer_cpu / cpu:.2f} | {told} |",
                flush=True,
            )
        print(f"\nOpen3D {theirs['version']}")
        if wrong:
            raise SystemExit(f"no agreement: {wrong}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["make"]:
        print(make(Path(sys.argv[2]), int(sys.argv[3])))
    else:
        main()
