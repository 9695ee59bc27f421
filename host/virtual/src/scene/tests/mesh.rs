//! Meshes as bodies: their distances, and beams that never slip through.

use std::path::Path;

use nalgebra::Vector3;
use umi_scan::surface::Mesh;

use super::super::{Scene, SceneMesh, SceneShape};

/// A cube about the origin, its faces cut into
/// `n` by `n` squares of two triangles.
fn block(n: usize, half: f64) -> Vec<[Vector3<f64>; 3]> {
    let mut triangles = Vec::new();
    let at = |k: usize| -half + 2.0 * half * k as f64 / n as f64;
    for axis in 0..3 {
        for side in [-half, half] {
            for i in 0..n {
                for j in 0..n {
                    let corner = |i: usize, j: usize| {
                        let mut p = Vector3::zeros();
                        p[axis] = side;
                        p[(axis + 1) % 3] = at(i);
                        p[(axis + 2) % 3] = at(j);
                        p
                    };
                    let [a, b, c, d] = [
                        corner(i, j),
                        corner(i + 1, j),
                        corner(i + 1, j + 1),
                        corner(i, j + 1),
                    ];
                    if side > 0.0 {
                        triangles.extend([[a, b, c], [a, c, d]]);
                    } else {
                        triangles.extend([[a, c, b], [a, d, c]]);
                    }
                }
            }
        }
    }
    triangles
}

fn shape(n: usize, half: f64) -> SceneShape {
    let mesh = Mesh::new(&block(n, half)).unwrap();
    SceneShape::Mesh(SceneMesh::new("block", mesh).unwrap())
}

/// A mesh is where the same solid is.
#[test]
fn a_mesh_of_a_block_is_the_block() {
    let mesh = shape(7, 5.0);
    let solid = SceneShape::Block {
        size_mm: [10.0, 10.0, 10.0],
    };
    let up = Vector3::new(0.0, 0.0, 5.0);
    let mut seed = 7_u64;
    let mut number = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 11) as f64 / (1_u64 << 53) as f64 * 24.0 - 12.0
    };
    for _ in 0..2000 {
        let p = Vector3::new(number(), number(), number());
        let (ours, theirs) = (mesh.distance_mm(&p), solid.distance_mm(&(p - up)));
        assert!((ours - theirs).abs() < 1e-9, "{p:?} {ours} {theirs}");
        let from = p + Vector3::new(0.0, 0.0, 30.0);
        let way = Vector3::new(number() * 0.02, number() * 0.02, -1.0).normalize();
        let ours = mesh.beam(&from, &way, 100.0).map(|end| end.way_mm);
        let theirs = solid.beam(&(from - up), &way, 100.0).map(|end| end.way_mm);
        match (ours, theirs) {
            (Some(ours), Some(theirs)) => assert!((ours - theirs).abs() < 1e-7),
            (ours, theirs) => assert_eq!(ours, theirs, "{from:?} {way:?}"),
        }
    }
}

/// Beams exactly at edges and corners, from far away and askew: none comes through.
#[test]
fn no_beam_slips_between_two_triangles() {
    let n = 9;
    let half = 1.0 / 3.0;
    let mesh = shape(n, half);
    for i in 1..2 * n {
        for j in 1..2 * n {
            // Corners, middles of edges, and middles of the diagonals.
            let at = |k: usize| -half + half * k as f64 / n as f64;
            let target = Vector3::new(at(i), at(j), half);
            for from in [
                Vector3::new(at(i), at(j), 777.7),
                Vector3::new(100.1, -33.3, 917.3),
                Vector3::new(-0.1, 1e4, 1e5),
            ] {
                let way = (target - from).normalize();
                let end = mesh.beam(&from, &way, 1e6).expect("no hole");
                let off = end.way_mm - (target - from).norm();
                assert!(
                    off.abs() < 1e-9 * (target - from).norm(),
                    "{target:?} {off}"
                );
                assert_eq!(end.normal, Vector3::z());
            }
        }
    }
}

/// What has no inside is no body, and a file that is not there is named.
#[test]
fn open_and_missing_meshes_are_refused() {
    let mut open = block(2, 1.0);
    open.pop();
    let error = SceneMesh::new("part.stl", Mesh::new(&open).unwrap()).unwrap_err();
    assert!(error.contains("is not closed"), "{error}");
    let text =
        |shape: &str| format!("[[body]]\nname = \"PART\"\nshape = {{ mesh = {{ {shape} }} }}");
    for (shape, says) in [
        ("file = \"nothing.stl\"", "nothing.stl"),
        ("file = \"a\", colour = 1", "unknown field"),
        ("", "missing field"),
    ] {
        let error = Scene::parse_in(&text(shape), Path::new("/nowhere")).unwrap_err();
        assert!(error.message.contains(says), "{error}");
    }
}
