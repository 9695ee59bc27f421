//! Our side of `tests/bench/scan_peers.py`: meshes and rays are written for the peers, times are printed as JSON lines.

use std::fs;
use std::path::Path;
use std::time::Instant;

use nalgebra::Vector3;
use serde_json::json;

use super::super::map::flatten::FlatMap;
use super::super::mesh::{PartMesh, RawMesh};

const ROUNDS: usize = 7;

/// A wavy sheet of 2 x cells x cells triangles.
fn sheet(cells: usize) -> PartMesh {
    let mut raw = RawMesh::default();
    let at = |k: usize| 60.0 * k as f64 / cells as f64 - 30.0;
    for i in 0..=cells {
        for j in 0..=cells {
            let (x, y) = (at(i), at(j));
            let z = 6.0 * (x / 14.0).sin() * (y / 17.0).cos() - x * x / 200.0;
            raw.vertices.push(Vector3::new(x, y, z));
        }
    }
    let number = |i: usize, j: usize| i * (cells + 1) + j;
    for i in 0..cells {
        for j in 0..cells {
            let [a, b] = [number(i, j), number(i + 1, j)];
            raw.faces.push([a, b, b + 1]);
            raw.faces.push([a, b + 1, a + 1]);
        }
    }
    PartMesh::weld(raw, true).unwrap()
}

/// Median, least and largest time in nanoseconds.
fn measured(mut work: impl FnMut()) -> [u128; 3] {
    let mut times: Vec<u128> = (0..ROUNDS)
        .map(|_| {
            let begun = Instant::now();
            work();
            begun.elapsed().as_nanos()
        })
        .collect();
    times.sort_unstable();
    [times[ROUNDS / 2], times[0], times[ROUNDS - 1]]
}

fn told(task: &str, [median, least, most]: [u128; 3], angle_deg: Option<f64>) {
    let line = json!({
        "task": task, "by": "umi-scan",
        "median_ns": median as u64, "min_ns": least as u64, "max_ns": most as u64,
        "max_angle_error_deg": angle_deg,
    });
    println!("{line}");
}

fn numbers(path: &Path, values: impl Iterator<Item = f64>) {
    let bytes: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
    fs::write(path, bytes).unwrap();
}

#[test]
#[ignore = "called by tests/bench/scan_peers.py"]
fn maps_and_rays_beside_peers() {
    let folder = std::env::var("UMI_PEERS_FOLDER").unwrap();
    let folder = Path::new(&folder);
    for cells in [45, 224] {
        let part = sheet(cells);
        let name = part.faces.len();
        let faces: Vec<u32> = (0..part.faces.len() as u32).collect();
        let mut angle = 0.0;
        let times = measured(|| angle = FlatMap::new(&part, &faces).quality.max_angle_error_deg);
        told(&format!("map of {name} triangles"), times, Some(angle));
        numbers(
            &folder.join(format!("{name}.vertices")),
            part.vertices.iter().flat_map(|v| [v.x, v.y, v.z]),
        );
        numbers(
            &folder.join(format!("{name}.faces")),
            part.faces.iter().flatten().map(|k| f64::from(*k)),
        );
        // Rays from 60 mm above, leaning all ways, as a sensor's do.
        let rays: Vec<(Vector3<f64>, Vector3<f64>)> = (0..200_000)
            .map(|k| {
                let u = |step: f64| (f64::from(k) * step).fract() - 0.5;
                let from = Vector3::new(u(0.754_877_666) * 70.0, u(0.569_840_291) * 70.0, 60.0);
                let way = Vector3::new(u(0.618_033_989) * 0.5, u(0.414_213_562) * 0.5, -1.0);
                (from, way.normalize())
            })
            .collect();
        numbers(
            &folder.join(format!("{name}.rays")),
            rays.iter()
                .flat_map(|(o, d)| [o.x, o.y, o.z, d.x, d.y, d.z]),
        );
        let mut hits = Vec::new();
        let times = measured(|| {
            hits = rays
                .iter()
                .map(|(o, d)| part.surface.first_hit(o, d, 1e3).map_or(-1.0, |hit| hit.at))
                .collect();
        });
        told(&format!("200000 rays on {name} triangles"), times, None);
        numbers(&folder.join(format!("{name}.hits")), hits.into_iter());
    }
}
