mod signs;

use super::*;
use crate::rigid::Vec3;

/// A box from the origin, its triangles looking outwards.
fn block(x: f64, y: f64, z: f64) -> Vec<[Vec3; 3]> {
    let c = |i: usize| {
        Vec3::new(
            if i & 1 == 0 { 0.0 } else { x },
            if i & 2 == 0 { 0.0 } else { y },
            if i & 4 == 0 { 0.0 } else { z },
        )
    };
    [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ]
    .iter()
    .flat_map(|f| [[c(f[0]), c(f[1]), c(f[2])], [c(f[0]), c(f[2]), c(f[3])]])
    .collect()
}

/// The distance to a box from its origin, by its own formula.
fn to_block(q: &Vec3, size: &Vec3) -> f64 {
    let d = (q - size / 2.0).abs() - size / 2.0;
    d.sup(&Vec3::zeros()).norm() + d.max().min(0.0)
}

/// Random numbers in 0..1 (SplitMix64).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

fn binary(corners: &[[Vec3; 3]]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend((corners.len() as u32).to_le_bytes());
    for t in corners {
        bytes.extend([0; 12]);
        for x in t.iter().flat_map(|c| c.iter()) {
            bytes.extend((*x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn the_distance_to_a_box_is_exact_and_signed_also_at_edges_and_corners() {
    let size = Vec3::new(10.0, 7.0, 4.0);
    let mesh = Mesh::new(&block(10.0, 7.0, 4.0)).unwrap();
    let mut seed = 1;
    for _ in 0..20_000 {
        let q = Vec3::from_fn(|_, _| random(&mut seed) * 24.0 - 7.0);
        let near = mesh.near(&q);
        let exact = to_block(&q, &size);
        assert!((near.distance_mm - exact).abs() < 1e-12, "{q} {near:?}");
        // The direction leads to the surface.
        let foot = q - near.direction * near.distance_mm;
        assert!(to_block(&foot, &size).abs() < 1e-12);
        assert!((near.direction.norm() - 1.0).abs() < 1e-12);
        // A hint changes nothing.
        assert_eq!(mesh.near_from(&q, 7).distance_mm, near.distance_mm);
    }
}

#[test]
fn a_point_beside_a_sharp_edge_has_the_sign_of_the_face_that_looks_at_it() {
    // A wedge of 20 degrees: beside its edge, the other face's plane has the wrong sign.
    let (x, z) = (10.0, 20.0_f64.to_radians().tan() * 10.0);
    let (a, b) = (Vec3::zeros(), Vec3::new(0.0, 10.0, 0.0));
    let (c, d) = (Vec3::new(x, 10.0, 0.0), Vec3::new(x, 0.0, 0.0));
    let (e, f) = (Vec3::new(x, 10.0, z), Vec3::new(x, 0.0, z));
    let mesh = Mesh::new(&[[a, b, c], [a, c, d], [a, e, b], [a, f, e]]).unwrap();
    let outside = mesh.near(&Vec3::new(-0.5, 5.0, 0.3));
    assert!((outside.distance_mm - 0.34_f64.sqrt()).abs() < 1e-12);
    let inside = mesh.near(&Vec3::new(5.0, 5.0, 0.2));
    assert!((inside.distance_mm + 0.2).abs() < 1e-12);
}

#[test]
fn balls_and_cones_have_their_own_distances() {
    let surface = CompositeSurface {
        mesh: None,
        balls: vec![BallShape {
            centre_mm: Vec3::new(100.0, 0.0, 0.0),
            radius_mm: 12.7,
        }],
        cones: vec![Cone {
            pose: crate::rigid::Pose::identity(),
            half_angle_rad: 30_f64.to_radians(),
            height_mm: 20.0,
        }],
    };
    let at_ball = surface.near(&Vec3::new(100.0, 13.0, 0.0), 0).unwrap();
    assert!((at_ball.distance_mm - 0.3).abs() < 1e-12);
    // 10 below the apex the flank is 10 tan 30 from the axis; the axis is inside by 10 sin 30.
    let on_axis = surface.near(&Vec3::new(0.0, 0.0, -10.0), 0).unwrap();
    assert!((on_axis.distance_mm + 5.0).abs() < 1e-12);
    assert_eq!(on_axis.face, 1);
}

#[test]
fn an_stl_file_is_read_from_both_kinds() {
    let corners = block(1.5, 2.25, 3.0);
    let mut text = String::from("solid a block\n");
    for t in &corners {
        text += "facet normal 0 0 0\n outer loop\n";
        for c in t {
            text += &format!("  vertex {} {:e} {}\r\n", c.x, c.y, c.z);
        }
        text += " endloop\nendfacet\n";
    }
    text += "endsolid a block\n";
    let mut bytes = binary(&corners);
    // Many programs begin their binary files so.
    bytes[..5].copy_from_slice(b"solid");
    // Others write a few bytes behind the last triangle.
    let longer = [bytes.as_slice(), b"ab"].concat();
    for bytes in [bytes.as_slice(), &longer, text.as_bytes()] {
        let mesh = stl_from_bytes(bytes).unwrap();
        assert_eq!(mesh.triangles().len(), 12);
        assert!((mesh.area_mm2() - 2.0 * (1.5 * 2.25 + 1.5 * 3.0 + 2.25 * 3.0)).abs() < 1e-12);
    }
}

#[test]
fn a_text_in_large_letters_behind_blanks_or_a_mark_is_an_stl_file() {
    let small = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 3 1e0\nendloop\nendfacet\nendsolid a\n";
    let wanted = stl_from_bytes(small.as_bytes()).unwrap();
    let large = small.to_uppercase();
    for text in [
        large.clone(),
        format!("\u{feff}{small}"),
        format!(" \r\n\t{large}"),
        format!("\u{feff}\n{large}"),
        small.replace("facet", "Facet").replace("vertex", " Vertex"),
    ] {
        let read = stl_from_bytes(text.as_bytes()).unwrap();
        assert_eq!(read.triangles()[0].corners, wanted.triangles()[0].corners);
        assert!(super::is_stl(text.as_bytes(), text.len() as u64));
        // Cut short it is refused, as the other is.
        let cut = &text.as_bytes()[..text.len() - 12];
        assert_eq!(stl_from_bytes(cut).unwrap_err().code, "bad_file");
    }
}

#[test]
fn a_bad_stl_file_is_refused_before_memory_is_taken() {
    let code = |bytes: &[u8]| stl_from_bytes(bytes).unwrap_err().code;
    let good = binary(&block(1.0, 1.0, 1.0));
    assert_eq!(code(&good[..good.len() - 1]), "bad_file");
    let more = [good.as_slice(), &[0; 50]].concat();
    assert_eq!(code(&more), "bad_file");
    let mut huge = good.clone();
    huge[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(code(&huge), "bad_file");
    assert_eq!(code(b""), "bad_file");
    assert_eq!(code(b"solid x\nfacet\nvertex 1 2\n"), "bad_file");
    assert_eq!(
        code(b"solid x\nfacet\nvertex 1 2 3\nendfacet\nendsolid"),
        "bad_file"
    );
    assert_eq!(code(b"solid x\nendsolid x\n"), "empty_model");
    assert_eq!(code(&binary(&[])), "empty_model");
    assert_eq!(code(&binary(&[[Vec3::zeros(); 3]])), "empty_model");
    let mut nan = block(1.0, 1.0, 1.0);
    nan[3][1].y = f64::NAN;
    assert_eq!(code(&binary(&nan)), "not_finite");
}

/// Hills of this many squares along each side, their corner here.
fn hills(count: usize, at: &Vec3) -> Vec<[Vec3; 3]> {
    let p = |i: usize, k: usize| {
        let (x, y) = (i as f64, k as f64);
        at + Vec3::new(x, y, 3.0 * (x * 0.7).sin() * (y * 0.45).cos())
    };
    let squares = (0..count * count).map(|n| (n / count, n % count));
    squares
        .flat_map(|(i, k)| {
            let [a, b, c, d] = [p(i, k), p(i + 1, k), p(i + 1, k + 1), p(i, k + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

#[test]
fn the_nearest_of_many_triangles_is_that_of_all_tried_one_by_one_near_and_far_from_the_origin() {
    let mut seed = 5;
    for at in [0.0, 3e5, -2e7] {
        let at = Vec3::new(at, -at, at / 3.0);
        let all = hills(16, &at);
        let mesh = Mesh::new(&all).unwrap();
        let alone: Vec<Mesh> = all.iter().map(|t| Mesh::new(&[*t]).unwrap()).collect();
        for wide in [20.0, 2000.0, 1e18] {
            for _ in 0..60 {
                let middle = at + Vec3::new(8.0, 8.0, 0.0);
                let q = middle + Vec3::from_fn(|_, _| (random(&mut seed) - 0.5) * wide);
                let least = alone
                    .iter()
                    .map(|one| one.near(&q).distance_mm.abs())
                    .fold(f64::INFINITY, f64::min);
                let found = mesh.near_from(&q, (random(&mut seed) * 500.0) as usize);
                assert_eq!(found.distance_mm.abs(), least, "{q}");
                let within = |limit: f64| mesh.near_within(&q, 0, limit).is_some();
                assert!(within(least * 1.000_001) && !within(least * 0.999_999));
            }
        }
    }
}
