"""The map and the rays of `umi scan plan` beside libigl's LSCM and trimesh with Embree, on the same meshes in one run.

    pip install numpy libigl trimesh embreex
    python tests/bench/scan_peers.py

Runs the project's own side first (`cargo test --release -p umi-scan`), then the peers, one thread each. Prints the
table of tests/bench/PLAN.md. Ends with an error where the peers do not agree with what they are compared with.
"""

import json
import os
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import igl  # noqa: E402
import numpy as np  # noqa: E402
import trimesh  # noqa: E402

ROUNDS = 7


def measure(work):
    """Median time in ns, and what the last round gave."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter_ns()
        answer = work()
        times.append(time.perf_counter_ns() - start)
    return statistics.median(times), answer


def angles(places, faces):
    """Of each triangle, at each corner, in degrees."""
    found = []
    for k in range(3):
        a, b, o = (places[faces[:, (k + j) % 3]] for j in (1, 2, 0))
        u, v = a - o, b - o
        cosine = (u * v).sum(1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        found.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(found, 1)


def main():
    top = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as folder:
        command = "cargo test --release -q -p umi-scan --lib beside_peers -- --ignored --nocapture".split()
        run = subprocess.run(
            command, cwd=top, env={**os.environ, "UMI_PEERS_FOLDER": folder}, text=True, stdout=subprocess.PIPE, check=True
        )
        ours = {}
        for line in run.stdout.splitlines():
            if line.startswith("{"):
                told = json.loads(line)
                ours[told["task"]] = told
        print("| task | peer | openumi, ms | peer, ms | peer / openumi | agreement |")
        print("|---|---|---:|---:|---:|---|")
        for file in sorted(Path(folder).glob("*.vertices"), key=lambda f: int(f.stem)):
            vertices = np.fromfile(file).reshape(-1, 3)
            faces = np.fromfile(file.with_suffix(".faces")).reshape(-1, 3).astype(np.int64)
            # The same two vertices are held: the farthest pair, about.
            first = np.argmax(np.linalg.norm(vertices - vertices[0], axis=1))
            second = np.argmax(np.linalg.norm(vertices - vertices[first], axis=1))
            held = np.array([first, second])
            wanted = np.array([[0.0, 0.0], [np.linalg.norm(vertices[second] - vertices[first]), 0.0]])

            def flatten(vertices=vertices, faces=faces, held=held, wanted=wanted):
                places = [np.asarray(a) for a in igl.lscm(vertices, faces, held, wanted) if hasattr(a, "shape")]
                return next(a for a in places if a.shape == (len(vertices), 2))

            took, places = measure(flatten)
            error = np.abs(angles(vertices, faces) - angles(places, faces)).max()
            name = f"map of {len(faces)} triangles"
            mine = ours[name]
            print(
                f"| {name} | libigl {igl.__version__ if hasattr(igl, '__version__') else ''} LSCM"
                f" | {mine['median_ns'] / 1e6:.1f} | {took / 1e6:.1f} | {took / mine['median_ns']:.2f}"
                f" | largest error of an angle {mine['max_angle_error_deg']:.2f} and {error:.2f} degrees |"
            )
            assert mine["max_angle_error_deg"] < error + 0.5
            rays = np.fromfile(file.with_suffix(".rays")).reshape(-1, 6)
            hits = np.fromfile(file.with_suffix(".hits"))
            mesh = trimesh.Trimesh(vertices, faces, process=False)
            assert "embree" in type(mesh.ray).__module__, "trimesh has no Embree here"
            # Its tree is built by a first question.
            mesh.ray.intersects_first(rays[:1, :3], rays[:1, 3:])
            took, first = measure(lambda mesh=mesh, rays=rays: mesh.ray.intersects_first(rays[:, :3], rays[:, 3:]))
            same = ((first >= 0) == (hits >= 0)).mean()
            name = f"200000 rays on {len(faces)} triangles"
            mine = ours[name]
            print(
                f"| {name} | trimesh {trimesh.__version__} with Embree | {mine['median_ns'] / 1e6:.1f} | {took / 1e6:.1f}"
                f" | {took / mine['median_ns']:.2f} | {100 * same:.3f} % of the rays hit, or do not, for both |"
            )
            assert same > 0.999


if __name__ == "__main__":
    main()
