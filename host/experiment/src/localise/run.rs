//! Six scans in each clamping, and where they put the part.

use nalgebra::{Matrix3, Vector3};
use umi_scan::ScanError;
use umi_scan::localise::fiducials::Fiducial;
use umi_scan::localise::scans::{ScanAnswer, ScanQuestion, TakenScan};
use umi_scan::parallel::Threads;
use umi_scan::rigid::{Pose, rotation_vector};
use umi_scan::surface::Mesh;
use umi_virtual::random::Random;
use umi_virtual::scene::{AreaScannerSpec, SceneError};
use umi_virtual::sensor::area;

use super::cell::{self, ScannerKind};
use super::figures::ErrorFigures;
use super::paper::PrintedClamping;

/// By what the trunnion had turned the part in the six scans of the paper, degrees.
pub const TURNED_DEG: [f64; 6] = [0.0, 0.0, 45.0, 45.0, 90.0, 90.0];
/// Standard deviation of a hit of the probe, mm: half of a repeatability of 1 µm.
const HIT_MM: f64 = 0.0005;
/// 95 % of a normal error in three directions lie within this, squared.
const REGION: f64 = 7.815;

/// How it is done.
#[derive(Clone, Copy, Debug)]
pub struct LocaliseSetting {
    /// The scanner.
    pub scanner: ScannerKind,
    /// How far the fiducials are turned from what is stated of them: a standard deviation about each axis, which is
    /// stated, too.
    pub misaligned_rad: f64,
    /// By what the trunnion had turned the part in each scan, degrees.
    pub turned_deg: &'static [f64],
    /// Also with each fiducial alone, as the paper takes the best one.
    pub alone: bool,
    /// Seed of everything.
    pub seed: u64,
    /// Threads; the results have the same bits for any number.
    pub threads: Threads,
}

/// Why it stopped.
#[derive(Clone, Debug, PartialEq)]
pub enum LocaliseTrouble {
    /// The scene.
    Scene(SceneError),
    /// The scans do not say where the part is.
    Scan(ScanError),
}

impl From<SceneError> for LocaliseTrouble {
    fn from(error: SceneError) -> Self {
        Self::Scene(error)
    }
}

impl From<ScanError> for LocaliseTrouble {
    fn from(error: ScanError) -> Self {
        Self::Scan(error)
    }
}

/// Where a clamping was found.
#[derive(Clone, Debug)]
pub struct ClampingFound {
    /// Machine from part, as it is.
    pub truth: Pose,
    /// And as the scans say.
    pub found: Pose,
    /// Whether the corner is within its stated 95 % region, and the stated uncertainty of the corner: the root of the sum
    /// of its variances, mm.
    pub inside: bool,
    /// That uncertainty.
    pub u_mm: f64,
    /// Probed by nine hits less true, mm.
    pub probed_mm: Vector3<f64>,
    /// What the data said of themselves: noise (mm) and points on the part.
    pub sigma_mm: f64,
    /// Those points.
    pub points: usize,
    /// All that the scans say.
    pub answer: ScanAnswer,
}

/// What the scans say of a clamping.
#[derive(Clone, Debug)]
pub struct ClampingTried {
    /// Where it was found by both corners, or why it was not.
    pub found: Result<ClampingFound, ScanError>,
    /// Located less true of the corner with A alone, and with B alone, if that was asked; or why one corner says nothing.
    pub alone_mm: Option<[Result<Vector3<f64>, ScanError>; 2]>,
}

impl ClampingFound {
    fn new(truth: Pose, probed_mm: Vector3<f64>, answer: ScanAnswer) -> Self {
        let located = &answer.located;
        let error = located.motion.translation_mm - truth.translation_mm;
        let cov = located.certainty.at(&located.motion, &Vector3::zeros());
        let inside = cov
            .try_inverse()
            .is_some_and(|inverse| error.dot(&(inverse * error)) < REGION);
        Self {
            truth,
            found: located.motion,
            inside,
            u_mm: cov.trace().sqrt(),
            probed_mm,
            sigma_mm: located.sigma_mm,
            points: located.n_used,
            answer,
        }
    }

    /// Located less true of the part's corner, mm.
    #[must_use]
    pub fn error_mm(&self) -> Vector3<f64> {
        self.found.translation_mm - self.truth.translation_mm
    }

    /// The turn from true to located about the machine's axes, degrees.
    #[must_use]
    pub fn error_deg(&self) -> Vector3<f64> {
        rotation_vector(&(self.found.rotation * self.truth.rotation.transpose()))
            .map(f64::to_degrees)
    }
}

/// One scanner in all clampings. Where the scans do not say where the part is, the others go on.
///
/// # Errors
/// The scene cannot be made.
pub fn run(
    setting: &LocaliseSetting,
    clampings: &[PrintedClamping],
    mut progress: impl FnMut(usize),
) -> Result<Vec<ClampingTried>, LocaliseTrouble> {
    let begun = |number| {
        progress(number);
        true
    };
    run_of(setting, clampings, begun)
}

/// The same of those clampings that are wanted. Each is as it is among all of them.
pub(super) fn run_of(
    setting: &LocaliseSetting,
    clampings: &[PrintedClamping],
    mut is_wanted: impl FnMut(usize) -> bool,
) -> Result<Vec<ClampingTried>, LocaliseTrouble> {
    let part = cell::part()?;
    let fiducials = cell::fiducials(setting.misaligned_rad)?;
    let mut random = Random::new(setting.seed);
    let mut turned = || Vector3::from_fn(|_, _| random.normal(setting.misaligned_rad));
    // They are aligned once, and stand for all clampings.
    let misaligned = [turned(), turned()];
    let mut all = Vec::new();
    for (number, clamping) in clampings.iter().enumerate() {
        let truth = clamping.pose();
        let places = places(setting, &mut random);
        let probed_mm = probed(&truth, &mut random) - truth.translation_mm;
        if !is_wanted(number) {
            continue;
        }
        let scans = take(setting, &truth, &misaligned, &places)?;
        let answer = question(setting, &scans, &fiducials, &part).answer();
        let alone_mm = setting.alone.then(|| {
            [0, 1].map(|k| {
                let one = question(setting, &scans, &fiducials[k..=k], &part).answer()?;
                Ok(one.located.motion.translation_mm - truth.translation_mm)
            })
        });
        all.push(ClampingTried {
            found: answer.map(|answer| ClampingFound::new(truth, probed_mm, answer)),
            alone_mm,
        });
    }
    Ok(all)
}

/// The figures of the corner's errors.
#[must_use]
pub fn figures<'a>(found: impl IntoIterator<Item = &'a ClampingFound>) -> ErrorFigures {
    let errors: Vec<Vector3<f64>> = found.into_iter().map(ClampingFound::error_mm).collect();
    ErrorFigures::of(&errors)
}

/// Where the operator puts the scanner for each scan, and the seed of its noise.
fn places(setting: &LocaliseSetting, random: &mut Random) -> Vec<(AreaScannerSpec, u64)> {
    let turned = setting.turned_deg.iter();
    let place = turned.map(|_| {
        let spec = cell::scanner(&setting.scanner, random);
        (spec, random.between(0.0, 9e15) as u64)
    });
    place.collect()
}

fn take(
    setting: &LocaliseSetting,
    truth: &Pose,
    misaligned: &[Vector3<f64>; 2],
    places: &[(AreaScannerSpec, u64)],
) -> Result<Vec<TakenScan>, SceneError> {
    let mut scans = Vec::new();
    for (k, (degrees, (spec, seed))) in setting.turned_deg.iter().zip(places).enumerate() {
        // The front side comes up.
        let moved = Pose::turn(&Vector3::x(), &Vector3::zeros(), -degrees.to_radians());
        let scene = cell::scene(&moved.after(truth), misaligned)?;
        scans.push(TakenScan {
            name: format!("scan {} at {degrees} degrees", k + 1),
            points: area::scan(&scene, spec, *seed, setting.threads).points,
            moved,
            carried: false,
        });
    }
    Ok(scans)
}

fn question<'a>(
    setting: &LocaliseSetting,
    scans: &'a [TakenScan],
    fiducials: &'a [Fiducial],
    part: &'a Mesh,
) -> ScanQuestion<'a> {
    ScanQuestion {
        scans,
        fiducials,
        part: Some(part),
        start: None,
        kernel: None,
        accept_symmetry: false,
        limit_mm: None,
        scale_limit_ppm: 1e4,
        seed: 0,
        threads: setting.threads,
    }
}

/// Where three hits on each of the three planes put the corner.
fn probed(truth: &Pose, random: &mut Random) -> Vector3<f64> {
    let mut normals = Matrix3::zeros();
    let mut heights = Vector3::zeros();
    for k in 0..3 {
        let hits = [[5.0, 4.0], [60.0, 4.0], [30.0, 13.0]].map(|[along, across]| {
            let mut p = Vector3::zeros();
            // The end face is as wide as the bar only.
            let along = if k == 0 { along / 6.0 } else { along };
            let (first, second) = match k {
                0 => (1, 2),
                1 => (0, 2),
                _ => (0, 1),
            };
            p[first] = along;
            p[second] = if second == 2 { -across } else { across };
            p[k] = random.normal(HIT_MM);
            truth.point(&p)
        });
        let normal = (hits[1] - hits[0]).cross(&(hits[2] - hits[0])).normalize();
        normals.set_row(k, &normal.transpose());
        heights[k] = normal.dot(&hits[0]);
    }
    normals
        .try_inverse()
        .map_or_else(Vector3::zeros, |inverse| inverse * heights)
}
