//! Poses judged, and moved, by the field alone: thousands of them, in single precision.

use nalgebra::{Matrix6, Vector6};

use crate::localise::search::field::HeightField;
use crate::localise::search::oriented::Oriented;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3, stepped};
use crate::solve::pseudo_solve;
use crate::surface::Mesh;

/// A model as poses are judged roughly.
pub(in crate::localise) struct Rough {
    /// The distances around it.
    pub field: HeightField,
    planes: Vec<Plane>,
    diagonal: f64,
    middle: Vec3,
    /// Whether there is an inside in which no point can be.
    closed: bool,
}

/// Oriented points about the first of them.
pub(in crate::localise) struct Points {
    origin: Vec3,
    all: Vec<Point>,
}

#[derive(Clone, Copy)]
struct Point {
    at: [f32; 3],
    /// Zero where the neighbourhood has no direction.
    normal: [f32; 3],
    is_oriented: bool,
}

/// The plane of a triangle, in the field's frame: its normal, and how far from there it is along it, in mm.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: [f32; 3],
    height: f32,
}

/// A pose as points are carried by it, from the scan to the field's frame, in mm.
struct Carried {
    turn: [[f32; 3]; 3],
    shift: [f32; 3],
}

/// A rough step takes planes for its points that are within so many times the coarse distance; the first steps take few
/// points.
const REACH: [f64; 6] = [4.0, 3.5, 3.0, 2.0, 1.5, 1.0];
const FIRST: usize = 3;

impl Points {
    pub fn new<'a>(points: impl Iterator<Item = &'a Oriented> + Clone) -> Self {
        let origin = points.clone().next().map_or_else(Vec3::zeros, |o| o.at);
        let all = points.map(|o| Point {
            at: single(&(o.at - origin)),
            normal: single(&o.normal),
            is_oriented: o.is_oriented(),
        });
        Self {
            origin,
            all: all.collect(),
        }
    }
}

impl Plane {
    /// Those of these normals and heights over the model's origin.
    fn all(planes: &[(Vec3, f64)], field: &HeightField) -> Vec<Self> {
        let of = |(normal, height): &(Vec3, f64)| Self {
            normal: single(normal),
            height: (height - normal.dot(field.low())) as f32,
        };
        planes.iter().map(of).collect()
    }
}

impl Carried {
    fn new(points: &Points, motion: &Pose, field: &HeightField) -> Self {
        let turn = motion.rotation.transpose();
        let shift = motion.undo(&points.origin) - field.low();
        Self {
            turn: std::array::from_fn(|i| std::array::from_fn(|k| turn[(i, k)] as f32)),
            shift: single(&shift),
        }
    }

    #[inline]
    fn turned(&self, v: &[f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| dot(&self.turn[i], v))
    }

    #[inline]
    fn point(&self, v: &[f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| dot(&self.turn[i], v) + self.shift[i])
    }
}

fn single(v: &Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

#[inline]
fn dot(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Rough {
    /// Of a mesh, with the normals of its triangles and how far from the origin their planes are along them, in mm.
    pub fn new(mesh: &Mesh, planes: &[(Vec3, f64)], threads: Threads) -> Self {
        let field = HeightField::new(mesh, threads);
        Self {
            planes: Plane::all(planes, &field),
            field,
            diagonal: mesh.diagonal_mm(),
            middle: mesh.corners().iter().sum::<Vec3>() / 8.0,
            closed: mesh.is_closed(),
        }
    }

    /// How near a point counts as on the surface before anything is refined, in mm.
    pub fn coarse_mm(&self) -> f64 {
        self.diagonal / 45.0
    }

    /// What speaks for a pose: points on the surface that look its way, less those within the material.
    pub fn score(&self, scene: &Points, motion: &Pose) -> f64 {
        let coarse = self.coarse_mm() as f32;
        let deep = if self.closed {
            -1.5 * coarse
        } else {
            f32::NEG_INFINITY
        };
        let carried = Carried::new(scene, motion, &self.field);
        let mut score = 0.0;
        for q in &scene.all {
            let Some((distance, face)) = self.field.near(&carried.point(&q.at)) else {
                continue;
            };
            if distance.abs() < coarse {
                let plane = &self.planes[face as usize];
                let looks = dot(&carried.turned(&q.normal), &plane.normal).abs();
                if looks > 0.8 || !q.is_oriented {
                    score += 1.0 - distance.abs() / coarse;
                }
            } else if distance < deep {
                score -= 1.0;
            }
        }
        f64::from(score)
    }

    /// A pose moved to where the points near its surface fit its planes: a few rough steps, with the field alone. What
    /// votes propose is off by half a step of each angle. The first steps are by the first points, the last by the others.
    pub(super) fn moved_near(&self, [few, more]: [&Points; 2], motion: &Pose) -> Pose {
        let about = self.middle;
        let arm = self.diagonal / 2.0;
        let centre = single(&(about - self.field.low()));
        let mut motion = *motion;
        for (k, reach) in REACH.into_iter().enumerate() {
            let scene = if k < FIRST { few } else { more };
            let reach = (reach * self.coarse_mm()) as f32;
            let carried = Carried::new(scene, &motion, &self.field);
            // Turns in units of the arm, shifts, and the distance beside them.
            let mut sums = [[0.0_f32; 8]; 6];
            for q in &scene.all {
                let p = carried.point(&q.at);
                let near = self.field.near(&p).filter(|(d, _)| d.abs() < reach);
                let Some((_, face)) = near else {
                    continue;
                };
                let Plane { normal: n, height } = self.planes[face as usize];
                let off = dot(&n, &p) - height;
                let looks = dot(&carried.turned(&q.normal), &n).abs();
                if off.abs() >= reach || (q.is_oriented && looks < 0.7) {
                    continue;
                }
                let share = off / reach;
                let rest = 1.0 - share * share;
                let weight = rest * rest;
                let r: [f32; 3] = std::array::from_fn(|i| (p[i] - centre[i]) / arm as f32);
                let row = [
                    r[1] * n[2] - r[2] * n[1],
                    r[2] * n[0] - r[0] * n[2],
                    r[0] * n[1] - r[1] * n[0],
                    n[0],
                    n[1],
                    n[2],
                    off,
                    0.0,
                ];
                for (sum, of) in sums.iter_mut().zip(row) {
                    let of = of * weight;
                    for (sum, other) in sum.iter_mut().zip(row) {
                        *sum += of * other;
                    }
                }
            }
            let h = Matrix6::from_fn(|i, k| f64::from(sums[i][k]));
            let g = Vector6::from_fn(|i, _| -f64::from(sums[i][6]));
            let x = pseudo_solve(&h, &g, 1e-3);
            let x = Vector6::new(x[0] / arm, x[1] / arm, x[2] / arm, x[3], x[4], x[5]);
            motion = motion.after(&stepped(&Pose::identity(), &x, &about).inverse());
        }
        motion
    }
}
