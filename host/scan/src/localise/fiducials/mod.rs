//! Where the scanner stands, by fiducials of known place: balls, cones, and bodies of any shape.
//!
//! Every shape is sought by itself; what was found is matched with the places that the file states; all that agree enter
//! one fit of the points themselves.

mod adjust;
mod balls;
mod cones;
mod features;
mod file;
mod joint;
mod matching;
mod meshes;
mod own;
mod refuse;
#[cfg(test)]
mod tests;

use self::meshes::sides::Sides;
use super::uncertainty::Group;
use super::{Located, SymmetryAxis};
use crate::ScanError;
use crate::localise::search::oriented::Oriented;
use crate::parallel::Threads;
use crate::rigid::{Pose, Vec3};
use crate::solve::Kernel;
use crate::surface::{BallShape, CompositeSurface, Cone, Mesh};

pub use file::read_fiducials;

/// What a fiducial looks like, in its own frame.
#[derive(Clone, Debug)]
pub enum FiducialShape {
    /// Reference surfaces; nothing is said of what lies beyond their rims.
    Mesh(Mesh),
    /// A ball about the origin.
    Ball {
        /// Its radius in mm.
        radius_mm: f64,
    },
    /// A cone with its apex at the origin, opening to −Z.
    Cone {
        /// Half of its angle in rad.
        half_angle_rad: f64,
        /// From the apex to the rim along the axis, in mm.
        height_mm: f64,
    },
}

/// A fiducial and where it stands.
#[derive(Clone, Debug)]
pub struct Fiducial {
    /// What it is called.
    pub name: String,
    /// What it looks like.
    pub shape: FiducialShape,
    /// Machine from fiducial.
    pub pose: Pose,
    /// The standard uncertainty of each coordinate of its place, in mm.
    pub u_position_mm: f64,
    /// The standard uncertainty of its turn about each axis, in rad.
    pub u_rotation_rad: f64,
    /// Whether it moves with the part.
    pub carried: bool,
}

/// What became of a fiducial in a scan.
#[derive(Clone, Debug)]
pub struct FiducialSeen {
    /// What it is called.
    pub name: String,
    /// Its pose in the scan (scan from fiducial) by its own points, if it was found.
    pub motion: Option<Pose>,
    /// The points on it.
    pub n: usize,
    /// Root of the mean squared distance of these points, in mm, where the common pose puts it.
    pub rms_mm: f64,
    /// Its share of what holds the pose; the shares of all make 1.
    pub share: f64,
}

/// What is asked.
#[derive(Clone, Debug)]
pub struct FiducialTask<'a> {
    /// The fiducials.
    pub fiducials: &'a [Fiducial],
    /// The scan in mm.
    pub points: &'a [Vec3],
    /// Where the scanner stands about (machine from scanner): nothing is searched then.
    pub start: Option<Pose>,
    /// A stated problem over all points; without it noise and outliers are estimated.
    pub kernel: Option<Kernel>,
    /// Whether one of several poses that look alike will do.
    pub accept_symmetry: bool,
    /// The largest standard uncertainty at a corner of the scan, in mm.
    pub limit_mm: Option<f64>,
    /// By how much the scale may be off, in ppm.
    pub scale_limit_ppm: f64,
    /// Another seed begins the search with other points.
    pub seed: u64,
    /// Threads.
    pub threads: Threads,
}

/// Where the scanner stands.
#[derive(Clone, Debug)]
pub struct ScannerFound {
    /// Machine from scanner, with its uncertainty.
    pub located: Located,
    /// What became of each fiducial, in the order of the file.
    pub fiducials: Vec<FiducialSeen>,
    /// Which points lie on fiducials.
    pub on_fiducials: Vec<bool>,
}

impl FiducialShape {
    /// The shape in its own frame.
    fn surface(&self) -> CompositeSurface {
        let mut surface = CompositeSurface::default();
        match self {
            Self::Mesh(mesh) => surface.mesh = Some(mesh.clone()),
            Self::Ball { radius_mm } => surface.balls.push(BallShape {
                centre_mm: Vec3::zeros(),
                radius_mm: *radius_mm,
            }),
            Self::Cone {
                half_angle_rad,
                height_mm,
            } => surface.cones.push(Cone {
                pose: Pose::identity(),
                half_angle_rad: *half_angle_rad,
                height_mm: *height_mm,
            }),
        }
        surface
    }

    /// How large its features are, in mm: a neighbourhood must be smaller to have a normal.
    fn size_mm(&self) -> f64 {
        match self {
            Self::Mesh(mesh) => (mesh.area_mm2() / 3.0).sqrt(),
            Self::Ball { radius_mm } => *radius_mm,
            Self::Cone {
                half_angle_rad,
                height_mm,
            } => height_mm.min(height_mm * half_angle_rad.tan()),
        }
    }

    /// Places that carry it, in its own frame: one for a ball, two for a cone, the corners of its box for a mesh.
    fn landmarks(&self) -> Vec<Vec3> {
        match self {
            Self::Mesh(mesh) => mesh.corners().to_vec(),
            Self::Ball { .. } => vec![Vec3::zeros()],
            Self::Cone { height_mm, .. } => vec![Vec3::zeros(), Vec3::new(0.0, 0.0, -height_mm)],
        }
    }

    /// Its surface as triangles, as it is looked at: a ball and a cone with flat facets.
    fn mesh(&self) -> Option<Mesh> {
        const PARTS: usize = 24;
        let turned = |r: f64, z: f64, i: usize| {
            let (s, c) = (std::f64::consts::TAU * i as f64 / PARTS as f64).sin_cos();
            Vec3::new(r * c, r * s, z)
        };
        // Radius and height along a line from the upper pole down.
        let line: Vec<(f64, f64)> = match self {
            Self::Mesh(mesh) => return Some(mesh.clone()),
            Self::Ball { radius_mm } => (0..=PARTS / 2)
                .map(|k| {
                    let (s, c) = (std::f64::consts::TAU * k as f64 / PARTS as f64).sin_cos();
                    (radius_mm * s, radius_mm * c)
                })
                .collect(),
            Self::Cone {
                half_angle_rad,
                height_mm,
            } => vec![(0.0, 0.0), (height_mm * half_angle_rad.tan(), -height_mm)],
        };
        let mut all = Vec::new();
        for pair in line.windows(2) {
            let ((r, z), (s, y)) = (pair[0], pair[1]);
            for i in 0..PARTS {
                let [a, b] = [turned(r, z, i), turned(r, z, i + 1)];
                let [c, d] = [turned(s, y, i), turned(s, y, i + 1)];
                all.extend([[a, c, d], [a, d, b]]);
            }
        }
        Mesh::new(&all).ok()
    }

    /// Its middle, in its own frame.
    fn middle(&self) -> Vec3 {
        let all = self.landmarks();
        all.iter().sum::<Vec3>() / all.len() as f64
    }

    /// Whether the two look the same.
    fn is_like(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(b.abs());
        match (self, other) {
            (Self::Mesh(a), Self::Mesh(b)) => a.triangles() == b.triangles(),
            (Self::Ball { radius_mm: a }, Self::Ball { radius_mm: b }) => near(*a, *b),
            (
                Self::Cone {
                    half_angle_rad: a,
                    height_mm: h,
                },
                Self::Cone {
                    half_angle_rad: b,
                    height_mm: k,
                },
            ) => near(*a, *b) && near(*h, *k),
            _ => false,
        }
    }
}

impl Fiducial {
    /// Where it stands as seen from the machine, if the part has been moved by `moved`.
    #[must_use]
    pub fn moved(&self, moved: &Pose) -> Self {
        let pose = if self.carried {
            moved.after(&self.pose)
        } else {
            self.pose
        };
        Self {
            pose,
            ..self.clone()
        }
    }

    /// Its own doubt, where `machine` (scan from machine) puts it.
    fn group(&self, machine: &Pose) -> Group {
        let mut cov = nalgebra::Matrix6::zeros();
        for i in 0..3 {
            cov[(i, i)] = self.u_rotation_rad.powi(2);
            cov[(i + 3, i + 3)] = self.u_position_mm.powi(2);
        }
        Group {
            at: machine.point(&self.pose.translation_mm),
            cov,
            common: Vec::new(),
        }
    }
}

/// A scan made ready, with the shapes that are sought.
struct Sought<'a> {
    task: &'a FiducialTask<'a>,
    /// Every fiducial in its own frame.
    surfaces: Vec<CompositeSurface>,
    /// The rims and sharp edges of each, in its own frame; none of a ball or a cone.
    rims: Vec<Vec<[Vec3; 2]>>,
    /// The flat sides of each body; none of a ball or a cone.
    sides: Vec<Option<Sides>>,
    /// The first fiducial that looks like this one.
    class: Vec<usize>,
    /// Points to refine with.
    fine: Vec<Vec3>,
    /// The same, thinned to cubes that are small against the fiducials.
    coarse: Vec<Vec3>,
    /// Points to search with.
    places: Vec<Oriented>,
    /// The noise along the normals by the flatness of neighbourhoods, in mm.
    noise_mm: f64,
}

/// Points that a search needs.
const LEAST_POINTS: usize = 12;

impl FiducialTask<'_> {
    /// The scanner's pose with its uncertainty and verdict.
    ///
    /// # Errors
    /// Refused by name where the data do not decide: `no_fiducial`, `fiducials_disagree`, `degenerate`, `ambiguous`,
    /// `mirrored`, `wrong_scale`, `too_few_points`.
    pub fn find(&self) -> Result<ScannerFound, ScanError> {
        if self.points.len() < LEAST_POINTS {
            return Err(ScanError::refused(
                "too_few_points",
                format_args!(
                    "{} points are too few: at least {LEAST_POINTS} are needed, spread over the fiducials",
                    self.points.len()
                ),
            ));
        }
        let (machine, symmetries) = match &self.start {
            Some(start) => (start.inverse(), Vec::new()),
            None => {
                let found = refuse::search(self)?;
                (found.machine, found.symmetries)
            }
        };
        joint::finish(self, &machine, symmetries)
    }
}

/// A pose that the search stands by.
struct Searched {
    /// Scan from machine.
    machine: Pose,
    symmetries: Vec<SymmetryAxis>,
    /// Whether no motion is left free.
    held: bool,
    /// Whether something looks like a fiducial that is not at its place.
    elsewhere: bool,
}
