//! Random scans of random parts, whole and with a hole: what of them is told as not scanned.

use super::patches::bare;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::measure;
use crate::surface::{CompositeSurface, Mesh};

/// Random numbers from 0 to 1 (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::from_fn(|_, _| self.between(-1.0, 1.0));
            if v.norm() < 1.0 && v.norm() > 0.1 {
                return v.normalize();
            }
        }
    }
}

/// A prism over an angle or a regular polygon, each triangle cut into four as often as is said.
fn part(random: &mut Random, cuts: u32) -> Mesh {
    let [a, b, c, height] = [40.0, 25.0, 0.5, 15.0].map(|mm| random.between(mm, 2.5 * mm));
    let (x, y) = (a * (0.2 + 0.3 * c), b * (0.2 + 0.3 * c));
    let sides = [0, 4, 6, 12, 40][(random.next() * 5.0) as usize];
    let (outline, caps): (Vec<[f64; 2]>, Vec<[usize; 3]>) = if sides == 0 {
        let angle = [[0.0, 0.0], [a, 0.0], [a, y], [x, y], [x, b], [0.0, b]];
        let caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
        (angle.to_vec(), caps.to_vec())
    } else {
        let at = |k: usize| {
            let (s, c) = (std::f64::consts::TAU * k as f64 / sides as f64).sin_cos();
            [a * c / 2.0, b * s / 2.0]
        };
        let fan = (1..sides - 1).map(|k| [0, k, k + 1]);
        ((0..sides).map(at).collect(), fan.collect())
    };
    let at = |k: usize, z: f64| Vec3::new(outline[k][0], outline[k][1], z);
    let mut all = Vec::new();
    for k in 0..outline.len() {
        let next = (k + 1) % outline.len();
        let [low, side] = [at(k, 0.0), at(next, 0.0)];
        all.extend([
            [low, side, at(next, height)],
            [low, at(next, height), at(k, height)],
        ]);
    }
    for [i, j, k] in caps {
        all.extend([
            [at(i, height), at(j, height), at(k, height)],
            [at(i, 0.0), at(k, 0.0), at(j, 0.0)],
        ]);
    }
    cut(all, cuts)
}

/// A mesh of these triangles, each cut into four so many times.
fn cut(mut all: Vec<[Vec3; 3]>, times: u32) -> Mesh {
    for _ in 0..times {
        all = all
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [d, e, f] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
                [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
            })
            .collect();
    }
    Mesh::new(&all).unwrap()
}

/// A place on the surface and its normal.
fn place(mesh: &Mesh, random: &mut Random) -> (Vec3, Vec3) {
    let mut at = random.next() * mesh.area_mm2();
    let fits = |area: f64| {
        at -= area;
        at < 0.0
    };
    let areas = mesh.triangles().iter().map(|t| t.area_mm2);
    let k = areas.map(fits).position(|fits| fits).unwrap_or(0);
    let t = &mesh.triangles()[k];
    let (mut u, mut v) = (random.next(), random.next());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let [a, b, c] = t.corners;
    (a + (b - a) * u + (c - a) * v, t.normal)
}

/// How many times as dense as its least the scan is somewhere.
enum Density {
    Even,
    /// From 1 to 20 along a direction.
    Growing(Vec3),
    /// 20 in a part of it.
    Steps(Vec3, f64),
}

impl Density {
    fn random(random: &mut Random) -> Self {
        match (random.next() * 3.0) as usize {
            0 => Self::Even,
            1 => Self::Growing(random.direction()),
            _ => Self::Steps(random.direction(), random.between(0.1, 0.4)),
        }
    }

    /// From 0.05 to 1. `spans`: how far the part reaches along the direction, in 100 steps of equal area.
    fn at(&self, p: &Vec3, spans: &[f64]) -> f64 {
        let share = |along: f64| spans.partition_point(|s| *s < along) as f64 / 100.0;
        match self {
            Self::Even => 1.0,
            Self::Growing(way) => 20_f64.powf(-share(p.dot(way)).min(1.0)),
            Self::Steps(way, dense) => {
                if share(p.dot(way)) < *dense {
                    1.0
                } else {
                    0.05
                }
            }
        }
    }

    fn spans(&self, mesh: &Mesh, random: &mut Random) -> Vec<f64> {
        let (Self::Growing(way) | Self::Steps(way, _)) = self else {
            return Vec::new();
        };
        let mut all: Vec<f64> = (0..10_000)
            .map(|_| place(mesh, random).0.dot(way))
            .collect();
        all.sort_by(f64::total_cmp);
        all.into_iter().step_by(100).collect()
    }
}

/// The share of the part that is told as not scanned, by these places with their normals and 0.5 mm of stock.
fn told(mesh: &Mesh, places: &[(Vec3, Vec3)], random: &mut Random) -> f64 {
    let stocked = |(p, normal): &(Vec3, Vec3)| p + normal * random.between(0.48, 0.52);
    let points: Vec<Vec3> = places.iter().map(stocked).collect();
    let surface = CompositeSurface::from(mesh.clone());
    let (pose, threads) = (Pose::identity(), Threads::new(2));
    let measured = measure(&surface, &points, &pose, &[], threads);
    bare(mesh, &pose, &points, &measured, threads).0
}

/// So many places of a scan.
fn places(mesh: &Mesh, count: usize, density: &Density, random: &mut Random) -> Vec<(Vec3, Vec3)> {
    let spans = density.spans(mesh, random);
    let mut all = Vec::new();
    while all.len() < count {
        let (p, normal) = place(mesh, random);
        if random.next() < density.at(&p, &spans) {
            all.push((p, normal));
        }
    }
    all
}

/// How many of so many whole scans, even or up to 20 times as dense in one place as in another, are told wrongly.
fn wrongly(scans: u64) -> usize {
    let is_told = |k: &u64| {
        let random = &mut Random(*k);
        let cuts = (random.next() * 4.0) as u32;
        let mesh = part(random, cuts);
        let density = Density::random(random);
        let few = if matches!(density, Density::Even) {
            1500.0
        } else {
            5000.0
        };
        let count = random.log_between(few, 30_000.0) as usize;
        let places = places(&mesh, count, &density, random);
        let share = told(&mesh, &places, random);
        if share > 0.01 {
            println!("whole, {k}: {count} points, {share:.4} told");
        }
        share > 0.01
    };
    (0..scans).filter(is_told).count()
}

/// Of so many scans with a round hole in a face: what of its area in shares of the part over the window's is missed, the
/// largest first; and how many holes of at least twice the window there are.
fn missed(scans: u64) -> (Vec<f64>, usize) {
    let (mut missed, mut large) = (Vec::new(), 0);
    for k in 0..scans {
        let random = &mut Random(1000 + k);
        let cuts = (random.next() * 4.0) as u32;
        let mesh = part(random, cuts);
        let count = random.log_between(1500.0, 30_000.0) as usize;
        let mut places = places(&mesh, count, &Density::Even, random);
        // The face about a place, and a disc about that with a share of the face.
        let (at, normal) = place(&mesh, random);
        let is_beside =
            |p: &Vec3, n: &Vec3| n.dot(&normal) > 0.99 && (p - at).dot(&normal).abs() < 1e-6;
        let mut face: Vec<f64> = (0..20_000)
            .map(|_| place(&mesh, random))
            .filter(|(p, n)| is_beside(p, n))
            .map(|(p, _)| (p - at).norm())
            .collect();
        face.sort_by(f64::total_cmp);
        let inside = (face.len() as f64 * random.between(0.02, 0.5)) as usize;
        let radius = face[inside];
        places.retain(|(p, n)| !is_beside(p, n) || (p - at).norm() > radius);
        let hole = inside as f64 / 20_000.0;
        let times = hole / (100.0 / count as f64).max(0.01);
        large += usize::from(times > 2.0);
        if times > 1.0 && told(&mesh, &places, random) <= 0.01 {
            println!("hole, {k}: {count} points, {hole:.4} of the part, {times:.2} windows");
            missed.push(times);
        }
    }
    missed.sort_by(|a, b| b.total_cmp(a));
    (missed, large)
}

/// What so many flat sides make of a profile (radius and height), closed, that goes up outside.
fn round(sides: usize, profile: &[(f64, f64)]) -> Mesh {
    let at = |(radius, z): (f64, f64), k: usize| {
        let (s, c) = (std::f64::consts::TAU * k as f64 / sides as f64).sin_cos();
        Vec3::new(radius * c, radius * s, z)
    };
    let mut all = Vec::new();
    for k in 0..sides {
        for (i, from) in profile.iter().enumerate() {
            let to = profile[(i + 1) % profile.len()];
            let [a, b, c, d] =
                [(*from, k), (*from, k + 1), (to, k + 1), (to, k)].map(|(p, k)| at(p, k));
            all.extend([[a, b, c], [a, c, d]]);
        }
    }
    Mesh::new(&all).unwrap()
}

/// A ring with a bore of so many flat sides: of 40 the bore has 6 % of the surface, and what of it looks one way, to 20
/// degrees, 0.7 %.
fn ring(sides: usize) -> Mesh {
    round(sides, &[(20.0, 0.0), (20.0, 15.0), (3.0, 15.0), (3.0, 0.0)])
}

/// A countersink meets its face and its bore by 45 degrees: what is scanned of those shows nothing of it.
#[test]
fn a_countersink_that_no_point_shows_is_told() {
    let profile = [
        (20.0, 0.0),
        (20.0, 15.0),
        (8.0, 15.0),
        (3.0, 10.0),
        (3.0, 0.0),
    ];
    let mesh = round(40, &profile);
    let random = &mut Random(8);
    let on_cone = |p: &Vec3| p.z > 10.02 && p.z < 14.98 && p.xy().norm() < 8.1;
    let cone = (5.0_f64.powi(2) * 2.0).sqrt() * std::f64::consts::PI * 11.0 / mesh.area_mm2();
    is_told_where_none_shows_it(&mesh, 20_000, on_cone, cone, random);
}

/// That a round, this share of the part, is told by so many points where none of them lies on it, and not where some do.
fn is_told_where_none_shows_it(
    mesh: &Mesh,
    points: usize,
    is_on: impl Fn(&Vec3) -> bool,
    round: f64,
    random: &mut Random,
) {
    let all = places(mesh, points, &Density::Even, random);
    for (keep, expected) in [(0.0, round), (0.3, 0.0), (1.0, 0.0)] {
        let mut scanned = all.clone();
        scanned.retain(|(p, _)| !is_on(p) || random.next() < keep);
        let share = told(mesh, &scanned, random);
        assert!(
            (share - expected).abs() < 0.012,
            "{round}, {keep}: {share}, {expected}"
        );
    }
}

#[test]
fn a_bore_that_no_point_shows_is_told_and_one_that_few_show_is_not() {
    let random = &mut Random(7);
    for sides in [6, 8, 12, 17, 40] {
        let mesh = ring(sides);
        let in_bore = |p: &Vec3| p.xy().norm() < 3.1;
        let bore = mesh
            .triangles()
            .iter()
            .filter(|t| t.corners.iter().all(in_bore));
        let bore = bore.map(|t| t.area_mm2).sum::<f64>() / mesh.area_mm2();
        is_told_where_none_shows_it(&mesh, 6000, in_bore, bore, random);
    }
}

/// The wall of a step of 4 mm that nobody has scanned: over the floor before it lies stock of 0.5 mm, which is nearer to the
/// wall in the corner, and an eighth of what the wall owes.
#[test]
fn stock_on_a_floor_shows_no_wall() {
    let outline = [
        [0.0, 0.0],
        [60.0, 0.0],
        [60.0, 20.0],
        [30.0, 20.0],
        [30.0, 24.0],
        [0.0, 24.0],
    ];
    let at = |k: usize, z: f64| Vec3::new(outline[k % 6][0], outline[k % 6][1], z);
    let mut all = Vec::new();
    for k in 0..6 {
        let [a, b, c, d] = [at(k, 0.0), at(k + 1, 0.0), at(k + 1, 30.0), at(k, 30.0)];
        all.extend([[a, b, c], [a, c, d]]);
    }
    for [i, j, k] in [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]] {
        all.push([at(i, 30.0), at(j, 30.0), at(k, 30.0)]);
        all.push([at(i, 0.0), at(k, 0.0), at(j, 0.0)]);
    }
    let mesh = Mesh::new(&all).unwrap();
    let random = &mut Random(13);
    let is_wall = |p: &Vec3, n: &Vec3| n.x > 0.9 && p.x < 40.0;
    let wall = 4.0 * 30.0 / mesh.area_mm2();
    for count in [8000, 40_000] {
        let mut scanned = places(&mesh, count, &Density::Even, random);
        assert!(told(&mesh, &scanned, random) < 1e-9);
        scanned.retain(|(p, n)| !is_wall(p, n));
        let share = told(&mesh, &scanned, random);
        assert!((share - wall).abs() < 0.002, "{count}: {share}, {wall}");
    }
}

#[test]
fn a_hole_in_a_face_is_told_and_a_sparse_side_is_not() {
    assert_eq!(wrongly(30), 0);
    let (missed, large) = missed(40);
    assert!(large > 8, "{large}");
    assert!(
        missed.first().is_none_or(|times| *times < 2.0),
        "{missed:?}"
    );
}

/// Some minutes: run by hand (docs: tests/bench/LOCALISE.md).
#[test]
#[ignore = "minutes"]
fn of_many_random_scans_none_is_told_wrongly() {
    let (missed, large) = missed(300);
    println!("holes above one window that are missed, in windows: {missed:?}; {large} above two");
    let wrong = wrongly(300);
    println!("told wrongly: {wrong} of 300");
    assert_eq!(wrong, 0);
    assert!(
        missed.first().is_none_or(|times| *times < 2.0),
        "{missed:?}"
    );
}

/// Of a block, the top of 50 mm by 50 mm is scanned in a strip at one end alone: as a whole it has a sixth of its points, more
/// than a tenth. How it is cut into triangles tells nothing.
#[test]
fn a_strip_of_a_face_does_not_show_the_rest_of_it() {
    let size = Vec3::new(50.0, 50.0, 30.0);
    let at = |k: usize| Vec3::from_fn(|i, _| if k & (1 << i) == 0 { 0.0 } else { size[i] });
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = faces.map(|f| f.map(at)).into_iter();
    let all: Vec<[Vec3; 3]> = halves
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    for cuts in [0, 4] {
        let mesh = cut(all.clone(), cuts);
        let random = &mut Random(11);
        let mut places = places(&mesh, 6000, &Density::Even, random);
        assert!(told(&mesh, &places, random) < 1e-9);
        places.retain(|(p, normal)| normal.z < 0.5 || p.x < 8.0);
        let share = told(&mesh, &places, random);
        let is = 42.0 * 50.0 / mesh.area_mm2();
        assert!(
            (share - is).abs() < 0.15 * is,
            "{cuts}: {share:.4} of {is:.4}"
        );
    }
}
