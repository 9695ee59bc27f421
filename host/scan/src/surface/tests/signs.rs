//! The sign of a distance at sharp corners, against the solid angle that the surface fills about the point.

use super::super::*;
use crate::rigid::Vec3;

/// Random numbers in 0..1 (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Within −1..1 in each direction.
    fn vector(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| 2.0 * self.next() - 1.0)
    }
}

/// Whether a point is within a closed surface: by the sum of the solid angles (van Oosterom and Strackee, 1983), for bodies
/// that look outwards and cavities that look inwards.
fn is_within(all: &[[Vec3; 3]], q: &Vec3) -> bool {
    let angle: f64 = (all.iter())
        .map(|t| {
            let [a, b, c] = t.map(|corner| corner - q);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            2.0 * a.dot(&b.cross(&c)).atan2(below)
        })
        .sum();
    angle > 2.0 * std::f64::consts::PI
}

/// The hull of a few points, by trying all triangles.
fn hull(points: &[Vec3]) -> Vec<[Vec3; 3]> {
    let n = points.len();
    let mut all = Vec::new();
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let (a, b, c) = (points[i], points[j], points[k]);
                let normal = (b - a).cross(&(c - a));
                let others = (0..n).filter(|other| ![i, j, k].contains(other));
                let beyond = others.filter(|other| normal.dot(&(points[*other] - a)) > 0.0);
                match beyond.count() {
                    0 => all.push([a, b, c]),
                    most if most == n - 3 => all.push([a, c, b]),
                    _ => {}
                }
            }
        }
    }
    all
}

/// A star: an eight-sided body with each side cut in 64, its corners at random distances from the middle.
fn star(random: &mut Random) -> Vec<[Vec3; 3]> {
    let mut all = Vec::new();
    for octant in 0..8 {
        let way = |bit: usize| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let [x, y, z] = [Vec3::x() * way(0), Vec3::y() * way(1), Vec3::z() * way(2)];
        let is_even = (octant as u32).count_ones().is_multiple_of(2);
        all.push(if is_even { [x, y, z] } else { [x, z, y] });
    }
    for _ in 0..3 {
        let halved = |[a, b, c]: [Vec3; 3]| {
            let (ab, bc, ca) = (
                (a + b).normalize(),
                (b + c).normalize(),
                (c + a).normalize(),
            );
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        all = all.into_iter().flat_map(halved).collect();
    }
    let mut lengths = std::collections::HashMap::new();
    for corner in all.iter_mut().flatten() {
        // A corner comes in several triangles, always as the same numbers but for the sign of zero.
        let key = corner.map(|x| (x * 1e9).round() as i64);
        let length = lengths.entry([key.x, key.y, key.z]).or_insert_with(|| {
            let place = key.cast::<f64>() / 1e9;
            place * (1.0 + 4.0 * random.next())
        });
        *corner = *length;
    }
    all
}

/// Asks for the sign about every corner and anywhere; how many points were asked.
fn ask(all: &[[Vec3; 3]], random: &mut Random, about: usize) -> usize {
    let mesh = Mesh::new(all).unwrap();
    assert!(mesh.is_closed() && mesh.dropped() == 0);
    let size = mesh.diagonal_mm();
    let mut asked = 0;
    for corner in all.iter().flatten() {
        for _ in 0..about {
            let far = size * 10_f64.powf(-4.0 * random.next());
            let q = corner + random.vector() * far;
            let found = mesh.near_from(&q, (random.next() * all.len() as f64) as usize);
            if found.distance_mm.abs() < 1e-7 * size {
                continue;
            }
            asked += 1;
            let within = is_within(all, &q);
            assert_eq!(found.distance_mm < 0.0, within, "{q} {found:?}");
            // The direction leads to the surface.
            let foot = q - found.direction * found.distance_mm;
            assert!(mesh.near(&foot).distance_mm.abs() < 1e-9 * size, "{q}");
        }
    }
    asked
}

/// The pyramid over a triangle of 10 mm, 20 mm high: 0.05 mm beside its tip and 0.02 mm above it a point is outside, while
/// the face that looks most at it passes behind.
#[test]
fn a_point_beside_the_tip_of_a_slender_pyramid_is_outside() {
    let base = [0.0, 1.0, 2.0].map(|third: f64| {
        let angle = third * std::f64::consts::TAU / 3.0;
        Vec3::new(angle.cos(), angle.sin(), 0.0) * (10.0 / 3_f64.sqrt())
    });
    let tip = Vec3::new(0.0, 0.0, 20.0);
    let mesh = Mesh::new(&hull(&[base[0], base[1], base[2], tip])).unwrap();
    let near = mesh.near(&Vec3::new(0.05, 0.0, 20.02));
    assert!((near.distance_mm - 0.05_f64.hypot(0.02)).abs() < 1e-12);
    assert!(near.direction.dot(&Vec3::new(0.05, 0.0, 0.02)) > 0.0);
}

#[test]
fn at_sharp_corners_of_tetrahedra_and_flat_bodies_the_sign_is_that_of_the_solid_angle() {
    let mut random = Random(3);
    let mut asked = 0;
    for body in 0..300 {
        // Slender in one direction, flat in another, four to nine corners.
        let shape = Vec3::new(1.0, 10_f64.powf(-2.0 * random.next()), 1.0);
        let tall = Vec3::new(1.0, 1.0, 10_f64.powf(-1.5 * random.next()));
        let points: Vec<Vec3> = (0..4 + body % 6)
            .map(|_| {
                let point = random.vector().component_mul(&shape).component_mul(&tall);
                point * 20.0
            })
            .collect();
        asked += ask(&hull(&points), &mut random, 20);
    }
    assert!(asked > 50_000, "{asked}");
}

#[test]
fn on_a_star_in_a_cavity_and_where_two_tips_touch_the_sign_is_that_of_the_solid_angle() {
    let mut random = Random(4);
    for _ in 0..3 {
        assert!(ask(&star(&mut random), &mut random, 6) > 7_000);
    }
    for _ in 0..50 {
        let body = || Vec3::new(0.3, 0.3, 2.0);
        let foot = |random: &mut Random| random.vector().component_mul(&body()) - 9.0 * Vec3::z();
        let below: Vec<Vec3> = (0..3).map(|_| foot(&mut random)).collect();
        let above: Vec<Vec3> = (0..3).map(|_| -foot(&mut random)).collect();
        let mut two = hull(&[below[0], below[1], below[2], Vec3::zeros()]);
        two.extend(hull(&[above[0], above[1], above[2], Vec3::zeros()]));
        assert!(ask(&two, &mut random, 10) > 200);
        // The same as cavities of a block about them, which look inwards.
        two.iter_mut().for_each(|t| t.swap(1, 2));
        let corners: Vec<Vec3> = (0..8)
            .map(|i| Vec3::from_fn(|k, _| if i >> k & 1 == 0 { -15.0 } else { 15.0 }))
            .collect();
        // Cut so that no four corners lie in one plane.
        let corners: Vec<Vec3> = (corners.iter())
            .map(|c| c + random.vector() * 0.5)
            .collect();
        two.extend(hull(&corners));
        assert!(ask(&two, &mut random, 10) > 500);
    }
}
