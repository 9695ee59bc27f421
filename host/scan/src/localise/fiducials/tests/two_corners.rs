//! Scenes with two machined corners, an outer and an inner one, among a table and a block: what a scanner above them sees
//! of their reference faces, of the other faces of their walls, and of the rest.
//!
//! The long form, with its figures in `tests/bench/LOCALISE.md`: `cargo test --release -p umi-scan --lib two_corners --
//! --ignored --nocapture`.

use std::collections::BTreeMap;

use super::*;

/// Scenes that are always tried, and by hand.
const FEW: [u64; 4] = [103, 107, 110, 112];
const MANY: std::ops::Range<u64> = 100..260;
/// How right a pose is at the fiducials, in mm.
const RIGHT_MM: f64 = 1.0;
/// How far a corner that was moved stands from its place, in mm.
const MOVED_MM: f64 = 3.0;

type Triangle = [Vec3; 3];

/// A block with its sides along the axes.
fn block(low: [f64; 3], high: [f64; 3]) -> Vec<Triangle> {
    let corner = |k: usize| {
        Vec3::new(
            [low, high][k & 1][0],
            [low, high][k >> 1 & 1][1],
            [low, high][k >> 2][2],
        )
    };
    let sides = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let two = |s: [usize; 4]| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]].map(|t| t.map(corner));
    sides.into_iter().flat_map(two).collect()
}

/// The reference faces of an inner corner, open to X, Y, Z.
fn inner(name: &str) -> Fiducial {
    let o = Vec3::zeros();
    let [x, y, low, high] = [
        Vec3::x() * 52.0,
        Vec3::y() * 44.0,
        Vec3::z() * 20.0,
        Vec3::z() * 30.0,
    ];
    let quad = |a: Vec3, b: Vec3| [[o, a, a + b], [o, a + b, b]];
    let all = [quad(x, y), quad(y, low), quad(high, x)].concat();
    let shape = FiducialShape::Mesh(Mesh::new(&all).unwrap());
    at(name, shape, [0.0; 3], [0.0; 3])
}

/// The bodies that carry the faces: a block, and a floor with two walls, 10 mm thick.
fn solids() -> [Vec<Triangle>; 2] {
    let walls = [
        block([-10.0, -10.0, -12.0], [52.0, 44.0, 0.0]),
        block([-10.0, -10.0, 0.0], [0.0, 44.0, 20.0]),
        block([-10.0, -10.0, 0.0], [52.0, 0.0, 30.0]),
    ];
    [block([-64.0, -42.0, -26.0], [0.0; 3]), walls.concat()]
}

/// A scene and the truth about it.
struct Scene {
    fiducials: Vec<Fiducial>,
    points: Vec<Vec3>,
    scanner: Pose,
}

/// Whether the way from `p` along `way` meets a triangle (Möller and Trumbore, J. Graphics Tools 2, 1997).
fn is_hidden(p: &Vec3, way: &Vec3, all: &[Triangle]) -> bool {
    all.iter().any(|[a, b, c]| {
        let (u, v) = (b - a, c - a);
        let h = way.cross(&v);
        let volume = u.dot(&h);
        if volume.abs() < 1e-12 {
            return false;
        }
        let s = (p - a) / volume;
        let x = s.dot(&h);
        let q = s.cross(&u);
        let y = way.dot(&q);
        x >= 0.0 && y >= 0.0 && x + y <= 1.0 && v.dot(&q) > 0.0
    })
}

impl Scene {
    /// `moved`: how far the second corner stands from where the file has it.
    fn random(number: u64, moved: Vec3) -> Self {
        let mut random = Random(0x2c0_0000 + number);
        let mut between = |low: f64, high: f64| low + (high - low) * random.next();
        let outer = corner("A", [64.0, 42.0, 26.0], [0.0; 3], [0.0; 3]);
        let mut fiducials = vec![outer, inner("B")];
        let mut triangles: Vec<Triangle> = Vec::new();
        for (k, (fiducial, solid)) in fiducials.iter_mut().zip(solids()).enumerate() {
            let angle = std::f64::consts::PI * k as f64 + between(-0.3, 0.3);
            fiducial.pose = Pose {
                rotation: rotation(&Vec3::new(0.0, 0.0, between(0.0, std::f64::consts::TAU))),
                translation_mm: Vec3::new(
                    150.0 * (1.0 + angle.cos()),
                    150.0 * (1.0 + angle.sin()),
                    between(10.0, 110.0),
                ),
            };
            let stands = Pose {
                translation_mm: fiducial.pose.translation_mm + moved * k as f64,
                ..fiducial.pose
            };
            triangles.extend(solid.iter().map(|t| t.map(|p| stands.point(&p))));
        }
        if between(0.0, 1.0) < 0.6 {
            let half = [150.0, 200.0][between(0.0, 2.0) as usize];
            let at = |x: f64, y: f64| Vec3::new(150.0 + half * x, 150.0 + half * y, -40.0);
            let [a, b, c, d] = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        if between(0.0, 1.0) < 0.5 {
            let low = [between(60.0, 200.0), between(60.0, 200.0), -40.0];
            triangles.extend(block(low, low.map(|x| x + between(20.0, 80.0))));
        }
        let noise = [0.005, 0.02, 0.05][between(0.0, 3.0) as usize];
        let count = [8000, 16_000][between(0.0, 2.0) as usize];
        let eyes: Vec<Vec3> = (0..1 + between(0.0, 2.0) as usize)
            .map(|_| {
                Vec3::new(150.0, 150.0, 700.0)
                    + random
                        .vector()
                        .component_mul(&Vec3::new(200.0, 200.0, 60.0))
            })
            .collect();
        let scanner = random.pose();
        let points = seen(&triangles, &eyes, count, &mut random)
            .into_iter()
            .map(|p| scanner.point(&(p + random.vector() * noise)))
            .collect();
        Self {
            fiducials,
            points,
            scanner,
        }
    }

    /// What is said of it: the verdict and whether the pose is right, or the code.
    fn answer(&self) -> String {
        let located = match task(&self.fiducials, &self.points).find() {
            Err(error) => return error.code.into(),
            Ok(found) => found.located,
        };
        let truth = self.scanner.inverse();
        let off = self.fiducials.iter().map(|f| {
            let q = self.scanner.point(&f.pose.translation_mm);
            (located.motion.point(&q) - truth.point(&q)).norm()
        });
        let right = off.fold(0.0, f64::max) < RIGHT_MM;
        let right = if right { "right" } else { "wrong" };
        let verdict = if located.reasons.is_empty() {
            "OK"
        } else {
            "NG"
        };
        format!("{right} {verdict}")
    }
}

/// So many points of the triangles that an eye sees, as dense everywhere.
fn seen(all: &[Triangle], eyes: &[Vec3], count: usize, random: &mut Random) -> Vec<Vec3> {
    let double = |[a, b, c]: &Triangle| (b - a).cross(&(c - a));
    let mut up_to = Vec::new();
    let mut whole = 0.0;
    for t in all {
        whole += double(t).norm();
        up_to.push(whole);
    }
    let mut points = Vec::new();
    for _ in 0..40 * count {
        let at = whole * random.next();
        let t = &all[up_to.partition_point(|x| *x < at).min(all.len() - 1)];
        let (mut u, mut v) = (random.next(), random.next());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let p = t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v;
        let normal = double(t).normalize();
        let is_seen = |eye: &Vec3| {
            let way = (eye - p).normalize();
            way.dot(&normal) > 0.2 && !is_hidden(&(p + way * 0.02), &way, all)
        };
        if eyes.iter().any(is_seen) {
            points.push(p);
            if points.len() == count {
                break;
            }
        }
    }
    points
}

/// The answers, and those to the same scenes if the second corner stands higher than its file says; along the table nothing
/// but the corners themselves says where they stand.
fn counted(scenes: impl IntoIterator<Item = u64>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for number in scenes {
        let answer = Scene::random(number, Vec3::zeros()).answer();
        let moved = Scene::random(number, Vec3::new(0.0, 0.0, MOVED_MM)).answer();
        println!("{number}: {answer}; moved: {moved}");
        *counts.entry(format!("moved: {moved}")).or_default() += 1;
        *counts.entry(answer).or_default() += 1;
    }
    counts
}

fn hold(counts: &BTreeMap<String, usize>) {
    for wrong in ["wrong OK", "moved: wrong OK", "moved: right OK"] {
        assert_eq!(counts.get(wrong), None, "{counts:?}");
    }
}

/// Of most bodies two sides are seen, which slide along their edge, and the other faces of their walls look the same: the
/// pose by both is right, or there is none.
#[test]
fn two_corners_hold_the_pose_together_or_say_that_they_do_not() {
    let counts = counted(FEW);
    hold(&counts);
    assert!(counts.get("right OK") >= Some(&3), "{counts:?}");
    let named = counts.get("moved: fiducials_disagree");
    assert!(named >= Some(&3), "{counts:?}");
}

#[test]
#[ignore = "minutes: by hand"]
fn many_scenes_with_two_corners() {
    let counts = counted(MANY);
    println!("{counts:?}");
    hold(&counts);
}
