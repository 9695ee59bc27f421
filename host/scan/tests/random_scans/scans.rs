//! Scans as a shop has them: few views, a table, things that stand about, stray points, uneven density, the wrong unit.

use umi_scan::rigid::{Pose, Vec3, rotation};
use umi_scan::surface::Mesh;

use crate::parts::{Part, cells};

/// Random numbers (SplitMix64).
pub struct Random(u64);

impl Random {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.next() * all.len() as f64) as usize]
    }

    /// Normal, by Box and Muller.
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.next()).ln()).sqrt() * (std::f64::consts::TAU * self.next()).cos()
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.normal(), self.normal(), self.normal())
    }
}

/// A scan and what is true of it.
pub struct RandomScan {
    pub points: Vec<Vec3>,
    /// Scan from part; none if the part is not in it as it is: mirrored, or in inches.
    pub pose: Option<Pose>,
    /// What is wrong with it, for people.
    pub faults: String,
}

/// A surface is seen where its normal and the way to the scanner have this cosine at least.
const STEEP: f64 = 0.2;
/// A scanned point may lie so deep behind the surface that hides it, in mm: its own.
const SKIN_MM: f64 = 0.05;
/// Places that are tried for each point before a view is given up.
const TRIES: usize = 60;

/// The scan with this number; always the same one.
pub fn random_scan(part: &Part, number: u64) -> RandomScan {
    let mut random = Random(number.wrapping_mul(0x5851_f42d_4c95_7f2d) ^ 0x15);
    let random = &mut random;
    let (low, high) = part.mesh.bounds();
    let (middle, diagonal) = ((low + high) / 2.0, part.mesh.diagonal_mm());
    let noise_mm = random.one_of(&[0.02, 0.05, 0.1]);
    let count = random.one_of(&[3000, 8000, 15_000]);
    let views = (random.next() * 4.0) as usize;
    let mut faults = vec![format!("{views} views")];
    // Without a stated number of views, from all around.
    let eyes: Vec<Vec3> = match views {
        0 => (0..6)
            .map(|k| {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                let mut eye = Vec3::new(0.31, -0.27, 0.19);
                eye[k / 2] += sign;
                eye
            })
            .collect::<Vec<Vec3>>(),
        _ => (0..views).map(|_| random.vector()).collect(),
    }
    .into_iter()
    .map(|way| middle + way.normalize() * (3.5 * diagonal))
    .collect();

    let mut bodies: Vec<Mesh> = Vec::new();
    if random.next() < 0.4 {
        let half = diagonal * random.between(0.7, 1.5);
        let below = if random.next() < 0.7 {
            0.0
        } else {
            random.between(5.0, 30.0)
        };
        let z = low.z - below;
        bodies.push(plate(&middle, half, z));
        faults.push("a table".to_owned());
        if random.next() < 0.5 {
            let size = Vec3::from_fn(|_, _| random.between(0.15, 0.5) * diagonal);
            let turn = random.between(0.0, std::f64::consts::TAU);
            let off =
                Vec3::new(turn.cos(), turn.sin(), 0.0) * (diagonal * random.between(0.6, 1.0));
            let at = Vec3::new(middle.x, middle.y, z) + off;
            bodies.push(boxed(&at, &size));
            faults.push("a box".to_owned());
        }
    }

    let mut points = views_of(random, &part.mesh, &bodies, &eyes, count);
    if random.next() < 0.15 {
        points.retain(|p| p.x < middle.x || random.next() < 1.0 / 12.0);
        faults.push("12:1 density".to_owned());
    }
    for p in &mut points {
        *p += random.vector() * noise_mm;
    }
    if random.next() < 0.3 {
        let share = random.between(0.05, 0.43);
        let (low, high) = around(&points);
        for _ in 0..(share * points.len() as f64) as usize {
            points.push(Vec3::from_fn(|i, _| {
                random.between(low[i] - 30.0, high[i] + 30.0)
            }));
        }
        faults.push(format!("{:.0} % strays", share * 100.0));
    }
    let axis = random.vector().normalize();
    let mut pose = Pose {
        rotation: rotation(&(axis * random.between(0.0, std::f64::consts::PI))),
        translation_mm: random.vector() * 200.0,
    };
    if random.next() < 0.1 {
        pose.translation_mm += Vec3::new(3e5, -2e5, 1e5);
        faults.push("far off".to_owned());
    }
    let wrong = random.next();
    let mirrored = wrong < 0.05;
    let inches = !mirrored && wrong < 0.09;
    for p in &mut points {
        if mirrored {
            p.x = -p.x;
        }
        *p = pose.point(p);
        if inches {
            *p /= 25.4;
        }
    }
    if mirrored {
        faults.push("mirrored".to_owned());
    }
    if inches {
        faults.push("inches".to_owned());
    }
    if random.next() < 0.1 && !inches {
        for p in &mut points {
            *p = p.map(|x| (x / 0.25).round() * 0.25);
        }
        faults.push("a lattice of 0.25 mm".to_owned());
    }
    // As a scanner that goes about the part gives them, no order.
    for i in (1..points.len()).rev() {
        points.swap(i, (random.next() * (i + 1) as f64) as usize);
    }
    RandomScan {
        points,
        pose: (!mirrored && !inches).then_some(pose),
        faults: faults.join(", "),
    }
}

/// About so many points of what the eyes see of the part and of the bodies.
fn views_of(
    random: &mut Random,
    part: &Mesh,
    bodies: &[Mesh],
    eyes: &[Vec3],
    count: usize,
) -> Vec<Vec3> {
    let all: Vec<&Mesh> = std::iter::once(part).chain(bodies).collect();
    let whole: f64 = all.iter().map(|mesh| mesh.area_mm2()).sum();
    let sums: Vec<Vec<f64>> = all
        .iter()
        .map(|mesh| {
            let mut sum = 0.0;
            let areas = mesh.triangles().iter();
            areas
                .map(|t| {
                    sum += t.area_mm2;
                    sum
                })
                .collect()
        })
        .collect();
    let mut points = Vec::with_capacity(count);
    for _ in 0..count * TRIES {
        if points.len() == count {
            break;
        }
        let mut at = random.next() * whole;
        let mut of = 0;
        while of + 1 < all.len() && at >= all[of].area_mm2() {
            at -= all[of].area_mm2();
            of += 1;
        }
        let face = sums[of]
            .partition_point(|sum| *sum < at)
            .min(sums[of].len() - 1);
        let t = &all[of].triangles()[face];
        let (mut u, mut v) = (random.next(), random.next());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let p =
            t.corners[0] + (t.corners[1] - t.corners[0]) * u + (t.corners[2] - t.corners[0]) * v;
        let seen = eyes.iter().any(|eye| {
            (eye - p).normalize().dot(&t.normal) > STEEP
                && all
                    .iter()
                    .all(|mesh| !mesh.stands_between(eye, &p, SKIN_MM))
        });
        if seen {
            points.push(p);
        }
    }
    points
}

fn around(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold(
        (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY)),
        |(low, high), p| (low.inf(p), high.sup(p)),
    )
}

/// A table's top.
fn plate(middle: &Vec3, half: f64, z: f64) -> Mesh {
    let at = |x: f64, y: f64| Vec3::new(middle.x + x * half, middle.y + y * half, z);
    let [a, b, c, d] = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
    Mesh::new(&[[a, b, c], [a, c, d]]).unwrap()
}

/// A box that stands with the middle of its underside at a place.
fn boxed(at: &Vec3, size: &Vec3) -> Mesh {
    let (low, high) = (
        at - Vec3::new(size.x / 2.0, size.y / 2.0, 0.0),
        at + Vec3::new(size.x / 2.0, size.y / 2.0, size.z),
    );
    let grid = [[low.x, high.x], [low.y, high.y], [low.z, high.z]];
    Mesh::new(&cells([&grid[0], &grid[1], &grid[2]], |_| true)).unwrap()
}
