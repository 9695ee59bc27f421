//! Eight parts: four that no turn carries onto itself, and four symmetric ones.

use umi_scan::rigid::Vec3;
use umi_scan::surface::Mesh;

/// A part, and what it is called.
pub struct Part {
    pub name: &'static str,
    pub mesh: Mesh,
}

/// The parts, always in this order.
pub fn parts() -> Vec<Part> {
    let of = |name, triangles: Vec<[Vec3; 3]>| {
        let mesh = Mesh::new(&triangles).unwrap();
        assert!(mesh.is_closed(), "{name}");
        Part { name, mesh }
    };
    vec![
        of("bracket", bracket()),
        of("blade", blade()),
        of("block", block(false)),
        of("pinned block", block(true)),
        of("hexagon", lathe(6, &[(0.0, 30.0), (30.0, 30.0)])),
        of("flange", flange(false)),
        of("keyed flange", flange(true)),
        of(
            "shaft",
            lathe(
                96,
                &[
                    (0.0, 20.0),
                    (10.0, 20.0),
                    (10.0, 32.0),
                    (30.0, 32.0),
                    (30.0, 20.0),
                    (80.0, 20.0),
                ],
            ),
        ),
    ]
}

/// Whether the one is the other but for a feature: of a scan that does not show it either is right.
pub fn are_variants(a: &str, b: &str) -> bool {
    a.ends_with(b) || b.ends_with(a)
}

/// The faces between the full and the empty cells of a grid.
pub fn cells(grid: [&[f64]; 3], full: impl Fn(Vec3) -> bool) -> Vec<[Vec3; 3]> {
    let is_full = |at: [usize; 3]| {
        let inside = (0..3).all(|i| (1..grid[i].len()).contains(&at[i]));
        inside
            && full(Vec3::from_fn(|i, _| {
                f64::midpoint(grid[i][at[i] - 1], grid[i][at[i]])
            }))
    };
    let mut all = Vec::new();
    for x in 0..=grid[0].len() {
        for y in 0..=grid[1].len() {
            for z in 0..=grid[2].len() {
                if !is_full([x, y, z]) {
                    continue;
                }
                for axis in 0..3 {
                    for up in [false, true] {
                        let mut beside = [x, y, z];
                        beside[axis] = if up {
                            beside[axis] + 1
                        } else {
                            beside[axis] - 1
                        };
                        if is_full(beside) {
                            continue;
                        }
                        let at = [x, y, z];
                        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                        let corner = |over_b: usize, over_c: usize| {
                            let mut p = Vec3::zeros();
                            p[axis] = grid[axis][at[axis] - usize::from(!up)];
                            p[b] = grid[b][at[b] - 1 + over_b];
                            p[c] = grid[c][at[c] - 1 + over_c];
                            p
                        };
                        let q = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                        if up {
                            all.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
                        } else {
                            all.extend([[q[0], q[2], q[1]], [q[0], q[3], q[2]]]);
                        }
                    }
                }
            }
        }
    }
    all
}

/// A bracket that has the base of the first part, and a tower at the end where that has none instead of wall and rib.
pub fn tower() -> Part {
    let mesh = Mesh::new(&on_base(|p| p.x > 70.0 && p.x < 104.0 && p.y > 18.0)).unwrap();
    assert!(mesh.is_closed());
    Part {
        name: "tower",
        mesh,
    }
}

fn bracket() -> Vec<[Vec3; 3]> {
    on_base(|p| {
        let wall = p.x < 14.0;
        let rib = p.x < 50.0 && (8.0..18.0).contains(&p.y) && p.z < 36.0;
        wall || rib
    })
}

/// What stands on a base that no turn carries onto itself.
fn on_base(stands: impl Fn(Vec3) -> bool) -> Vec<[Vec3; 3]> {
    let grid: [&[f64]; 3] = [
        &[0.0, 14.0, 40.0, 50.0, 70.0, 104.0, 120.0],
        &[0.0, 8.0, 16.0, 18.0, 44.0, 60.0, 70.0],
        &[0.0, 8.0, 14.0, 36.0, 60.0],
    ];
    cells(grid, |p| {
        let base = p.z < 14.0;
        let pocket = (40.0..70.0).contains(&p.x) && (44.0..60.0).contains(&p.y) && p.z > 8.0;
        let notch = p.x > 104.0 && p.y < 16.0;
        (base || stands(p)) && !pocket && !notch
    })
}

fn block(pinned: bool) -> Vec<[Vec3; 3]> {
    let grid: [&[f64]; 3] = [
        &[-50.0, 27.0, 35.0, 50.0],
        &[-30.0, 13.0, 21.0, 30.0],
        &[-20.0, 20.0, 26.0],
    ];
    cells(grid, |p| {
        let pin = (27.0..35.0).contains(&p.x) && (13.0..21.0).contains(&p.y);
        p.z < 20.0 || (pinned && pin)
    })
}

/// Closed rings of points, each above or beside the one before, and their lids.
fn loft(rings: &[Vec<Vec3>]) -> Vec<[Vec3; 3]> {
    let mut all = Vec::new();
    let count = rings[0].len();
    for pair in rings.windows(2) {
        for i in 0..count {
            let j = (i + 1) % count;
            all.push([pair[0][i], pair[0][j], pair[1][j]]);
            all.push([pair[0][i], pair[1][j], pair[1][i]]);
        }
    }
    let middle = |ring: &[Vec3]| ring.iter().sum::<Vec3>() / count as f64;
    let (low, high) = (&rings[0], &rings[rings.len() - 1]);
    for i in 0..count {
        let j = (i + 1) % count;
        all.push([middle(low), low[j], low[i]]);
        all.push([middle(high), high[i], high[j]]);
    }
    all
}

fn polar(angle: f64, radius: f64, z: f64) -> Vec3 {
    Vec3::new(radius * angle.cos(), radius * angle.sin(), z)
}

/// A body of revolution with so many sides, by heights and radii.
fn lathe(sides: u32, profile: &[(f64, f64)]) -> Vec<[Vec3; 3]> {
    let ring = |&(z, radius): &(f64, f64)| {
        let turn = std::f64::consts::TAU / f64::from(sides);
        (0..sides)
            .map(|k| polar(f64::from(k) * turn, radius, z))
            .collect()
    };
    loft(&profile.iter().map(ring).collect::<Vec<Vec<Vec3>>>())
}

/// A disc with four slots and a hub; keyed, one of the slots stands askew.
fn flange(keyed: bool) -> Vec<[Vec3; 3]> {
    let slot = |k: u32| f64::from(k * 90 + if keyed && k == 1 { 16 } else { 0 });
    // Slots taper a little: no two corners stand at one angle.
    let corners = [(-7.0, 50.0), (-6.0, 38.0), (6.0, 38.0), (7.0, 50.0)];
    let of_slots = (0..4).flat_map(|k| corners.map(|(off, r)| (slot(k) + off, r)));
    let between = (0..360)
        .step_by(5)
        .map(|degrees| (f64::from(degrees), 50.0));
    let is_between = |(degrees, _): &(f64, f64)| {
        (0..4).all(|k| ((degrees - slot(k) + 180.0).rem_euclid(360.0) - 180.0).abs() > 7.5)
    };
    let mut rim: Vec<(f64, f64)> = of_slots.chain(between.filter(is_between)).collect();
    rim.sort_by(|a, b| a.0.total_cmp(&b.0));
    let ring = |z: f64, hub: Option<f64>| -> Vec<Vec3> {
        rim.iter()
            .map(|(degrees, r)| polar(degrees.to_radians(), hub.unwrap_or(*r), z))
            .collect()
    };
    loft(&[
        ring(0.0, None),
        ring(12.0, None),
        ring(12.0, Some(25.0)),
        ring(30.0, Some(25.0)),
    ])
}

/// A twisted blade on a root with the corners of a block.
fn blade() -> Vec<[Vec3; 3]> {
    let (low, high) = ([-32.0, -15.0], [38.0, 19.0]);
    let mut angles: Vec<f64> = (0..64)
        .map(|k| (f64::from(k) + 0.5) * std::f64::consts::TAU / 64.0)
        .collect();
    for x in [low[0], high[0]] {
        for y in [low[1], high[1]] {
            angles.push(f64::atan2(y, x).rem_euclid(std::f64::consts::TAU));
        }
    }
    angles.sort_by(f64::total_cmp);
    let root = |z: f64| -> Vec<Vec3> {
        let out = |angle: &f64| {
            let (s, c) = angle.sin_cos();
            let x = if c > 0.0 { high[0] } else { low[0] } / c;
            let y = if s > 0.0 { high[1] } else { low[1] } / s;
            polar(*angle, x.min(y), z)
        };
        angles.iter().map(out).collect()
    };
    let section = |v: f64| -> Vec<Vec3> {
        let (long, thick) = (24.0 - 7.0 * v, 8.0 - 3.0 * v);
        let twist = (10.0 + 36.0 * v).to_radians();
        let at = |angle: &f64| {
            let u = angle - twist;
            let egg = 1.0 + 0.25 * u.cos();
            let radius = egg / ((u.cos() / long).powi(2) + (u.sin() / thick).powi(2)).sqrt();
            polar(*angle, radius, 12.0 + 84.0 * v) + Vec3::new(4.0, -6.0, 0.0) * (v * v)
        };
        angles.iter().map(at).collect()
    };
    let mut rings = vec![root(0.0), root(12.0)];
    rings.extend((0..=24).map(|k| section(f64::from(k) / 24.0)));
    loft(&rings)
}
