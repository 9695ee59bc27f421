//! What in a scan looks like a fiducial, each shape by itself.

use super::meshes::sides::Sides;
use super::own::Own;
use super::{FiducialTask, Sought, balls, cones, meshes, own};
use crate::localise::search::oriented::{from_seed, orient, thin};
use crate::localise::search::pairs::spread;
use crate::rigid::{Pose, Vec3};

use super::FiducialShape;

/// Something that looks like a fiducial.
#[derive(Clone, Debug)]
pub(super) struct Feature {
    /// The first fiducial that looks like it.
    pub class: usize,
    /// Scan from the shape's own frame.
    pub motion: Pose,
    /// The points on it.
    pub inliers: usize,
    /// Its landmarks in the scan.
    pub landmarks: Vec<Vec3>,
    /// Its fit: what its points hold of it.
    pub own: Own,
}

/// Balls of another radius than the file says.
#[derive(Clone, Copy, Debug)]
pub(super) struct OtherBalls {
    /// About their radius.
    pub radius_mm: f64,
    /// What the file says.
    pub stated_mm: f64,
    /// How many have about this radius.
    pub count: usize,
}

/// Radii that differ by a smaller share are one.
const ALIKE: f64 = 0.01;

/// Other radii are looked for in so many steps down and up, from half to twice the stated one.
const STEP: f64 = 1.1;
const TRIED: i32 = 7;

/// Points to search with at most.
const PLACES: usize = 40_000;
/// Points to refine with at most.
const FINE: usize = 300_000;
/// Features of one shape that are kept.
const KEPT: usize = 40;
/// Neighbours that a normal is taken from: few, for fiducials are small.
const NEIGHBOURS: usize = 14;
/// The edge of the cubes that a scan is thinned to, in sizes of the least fiducial.
const CELL: f64 = 0.06;

impl<'a> Sought<'a> {
    pub fn new(task: &'a FiducialTask<'a>) -> Self {
        let shapes = || task.fiducials.iter().map(|f| &f.shape);
        let least = shapes()
            .map(FiducialShape::size_mm)
            .fold(f64::MAX, f64::min);
        let mut cell = CELL * least;
        let mut coarse = thin(&from_seed(task.points, task.seed), cell, task.threads);
        while coarse.len() > PLACES && cell < 0.15 * least {
            cell *= 1.25;
            coarse = thin(&coarse, cell, task.threads);
        }
        let coarse: Vec<Vec3> = spread(coarse.len(), 4 * PLACES)
            .into_iter()
            .map(|i| coarse[i])
            .collect();
        let (places, noise_mm) = orient(&coarse, &coarse, 0.75 * least, NEIGHBOURS, task.threads);
        let fine: Vec<Vec3> = spread(task.points.len(), FINE)
            .into_iter()
            .map(|i| task.points[i])
            .collect();
        Self {
            task,
            surfaces: shapes().map(FiducialShape::surface).collect(),
            rims: shapes()
                .map(|s| match s {
                    FiducialShape::Mesh(mesh) => own::rims(mesh),
                    _ => Vec::new(),
                })
                .collect(),
            sides: shapes()
                .map(|s| match s {
                    FiducialShape::Mesh(mesh) => Some(Sides::new(mesh)),
                    _ => None,
                })
                .collect(),
            class: shapes()
                .map(|s| shapes().position(|o| o.is_like(s)).unwrap_or(0))
                .collect(),
            fine,
            coarse,
            places,
            noise_mm: if noise_mm.is_finite() { noise_mm } else { 0.0 },
        }
    }

    /// The noise that nothing is taken for less than, in mm.
    pub fn floor_mm(&self) -> f64 {
        (0.3 * self.noise_mm).max(1e-6)
    }

    /// Everything that looks like one of the fiducials, by shape, the one with the most points first.
    pub fn features(&self) -> Vec<Feature> {
        let mut all = Vec::new();
        for k in 0..self.class.len() {
            if self.class[k] != k {
                continue;
            }
            let found = self.held(k);
            all.extend(self.settled(k, found.into_iter().filter(|own| self.is_this_size(k, own))));
        }
        all
    }

    /// The radius of balls in the scan that have another one than the file says, from half to twice of that; that one, and
    /// how many they are: as many as are sought at most, those with the most points. None of a single one, or of less than
    /// half of those that are sought: anything round may look like it.
    pub fn other_balls(&self) -> Option<OtherBalls> {
        let by = |factor: f64| {
            let mut fiducials = self.task.fiducials.to_vec();
            for fiducial in &mut fiducials {
                if let FiducialShape::Ball { radius_mm } = &mut fiducial.shape {
                    *radius_mm *= factor;
                }
            }
            let task = FiducialTask {
                fiducials: &fiducials,
                ..self.task.clone()
            };
            let balls = Sought::new(&task).balls_of_any_size()?;
            Some(OtherBalls {
                stated_mm: balls.stated_mm / factor,
                ..balls
            })
        };
        let tried = (-TRIED..=TRIED).map(|k| STEP.powi(k));
        let best = tried.filter_map(by).max_by_key(|balls| balls.count)?;
        let is_some = best.count > 1 && 2 * best.count >= self.balls_like(best.stated_mm);
        is_some.then_some(best)
    }

    /// How many balls of this radius are sought.
    fn balls_like(&self, stated_mm: f64) -> usize {
        let shapes = self.task.fiducials.iter().map(|f| &f.shape);
        let like = shapes.filter(|shape| {
            matches!(shape, FiducialShape::Ball { radius_mm } if (radius_mm / stated_mm - 1.0).abs() < ALIKE)
        });
        like.count()
    }

    /// The radius that most of the balls in the scan have which are about as large as the file says, or a step more or less.
    fn balls_of_any_size(&self) -> Option<OtherBalls> {
        let shapes = || self.task.fiducials.iter().map(|f| &f.shape);
        let of = |(k, shape): (usize, &FiducialShape)| {
            let FiducialShape::Ball { radius_mm } = shape else {
                return None;
            };
            let found = self.settled(k, self.held(k).into_iter());
            // How far it is off was found at the stated radius: that is where to look for it.
            let seen = |f: &Feature| {
                let about = radius_mm + self.size_off(k, &f.own)?.off;
                let centre = &f.motion.translation_mm;
                let sphere = balls::radius::other_radius(&self.fine, centre, about, self.noise_mm)?;
                let is_near = (sphere.radius_mm / radius_mm - 1.0).abs() < STEP - 1.0;
                is_near.then_some(sphere.radius_mm)
            };
            let found = found.iter().take(self.balls_like(*radius_mm));
            let radii: Vec<f64> = found.filter_map(seen).collect();
            let near = |a: f64| move |b: &&f64| (a - **b).abs() < ALIKE * radius_mm;
            let alike = |a: f64| radii.iter().filter(near(a)).count();
            let most = radii.iter().copied().max_by_key(|&radius| alike(radius))?;
            Some(OtherBalls {
                radius_mm: most,
                stated_mm: *radius_mm,
                count: alike(most),
            })
        };
        let all = shapes().enumerate().filter(|(k, _)| self.class[*k] == *k);
        all.filter_map(of).max_by_key(|balls| balls.count)
    }

    /// What looks like the fiducial `k` of whatever size, the one with the most points first.
    fn held(&self, k: usize) -> Vec<Own> {
        let shape = &self.task.fiducials[k].shape;
        let size = shape.size_mm();
        let starts = match shape {
            FiducialShape::Ball { radius_mm } => {
                balls::starts(&self.places, *radius_mm, self.task.threads)
            }
            FiducialShape::Cone {
                half_angle_rad,
                height_mm,
            } => cones::starts(&self.places, *half_angle_rad, *height_mm, self.task.threads),
            FiducialShape::Mesh(mesh) => meshes::starts(mesh, &self.places, self.task.threads),
        };
        let reach = (0.15 * size).max(4.0 * self.noise_mm);
        // A body has many starts: thinned points tell which of them are of any worth, all points settle those.
        let (points, starts) = match shape {
            FiducialShape::Mesh(_) => (&self.coarse, self.gathered(k, &starts, reach)),
            _ => (&self.fine, starts),
        };
        let mut found: Vec<Own> = self
            .task
            .threads
            .each(starts.len(), |i| self.own_by(points, k, &starts[i], reach))
            .into_iter()
            .flatten()
            .filter(|own| own.holds(shape))
            .collect();
        found.sort_by_key(|own| std::cmp::Reverse(own.on.len()));
        found
    }

    /// These, each once.
    fn settled(&self, k: usize, found: impl Iterator<Item = Own>) -> Vec<Feature> {
        let shape = &self.task.fiducials[k].shape;
        let size = shape.size_mm();
        let marks = shape.landmarks();
        let per = match shape {
            FiducialShape::Mesh(_) => self.fine.len() as f64 / self.coarse.len().max(1) as f64,
            _ => 1.0,
        };
        let mut kept: Vec<Feature> = Vec::new();
        for own in found {
            if kept.len() == KEPT {
                break;
            }
            let landmarks: Vec<Vec3> = marks.iter().map(|p| own.motion.point(p)).collect();
            let apart = |other: &Feature| {
                let pairs = other.landmarks.iter().zip(&landmarks);
                pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
            };
            if kept.iter().all(|other| apart(other) > 0.3 * size) {
                kept.push(Feature {
                    class: k,
                    motion: own.motion,
                    inliers: (own.on.len() as f64 * per) as usize,
                    landmarks,
                    own,
                });
            }
        }
        kept
    }

    /// Where a few steps lead from these starts, each place once: many of them lead to the same.
    fn gathered(&self, k: usize, starts: &[Pose], reach: f64) -> Vec<Pose> {
        let shape = &self.task.fiducials[k].shape;
        let marks = shape.landmarks();
        let near = 0.02 * shape.size_mm();
        let mut found: Vec<Own> = self
            .task
            .threads
            .each(starts.len(), |i| {
                self.settled_at(&self.coarse, k, &starts[i], reach, 2)
            })
            .into_iter()
            .flatten()
            .collect();
        found.sort_by_key(|own| std::cmp::Reverse(own.on.len()));
        let mut kept: Vec<Pose> = Vec::new();
        for own in found {
            if kept.iter().all(|k| k.apart_mm(&own.motion, &marks) > near) {
                kept.push(own.motion);
            }
        }
        kept
    }
}
