//! The part, the fiducials, and where the operator puts the scanner.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use umi_core::registration::RigidTransform;
use umi_scan::ScanError;
use umi_scan::localise::fiducials::{Fiducial, FiducialShape};
use umi_scan::rigid::{Pose, rotation};
use umi_scan::surface::Mesh;
use umi_virtual::random::Random;
use umi_virtual::scene::{AreaScannerSpec, Scene, SceneError};

/// What stands in the machine, and what is clamped.
const CELL: &str = include_str!("cell.toml");
const BAR: &str = include_str!("bar.toml");
/// The raw part, as a file beside the scene.
const RAW: &str = r#"
[[body]]
name = "RAW"
group = "PART"
shape = { mesh = { file = "raw.stl" } }
"#;
/// The machine that cuts.
pub(super) const MACHINE: &str = r#"
[machine]
travel_min_mm = [-300.0, -300.0, -100.0]
travel_max_mm = [300.0, 300.0, 300.0]
reference_mm = [0.0, 0.0, 300.0]
start_mm = [0.0, 0.0, 300.0]

[tools.2]
length_mm = 0.0
radius_mm = 4.0
"#;

/// Length and width of the bar, and its height.
const BAR_MM: [f64; 3] = [76.2, 25.4, 40.64];
/// Where its step begins along Y, and how deep it is.
const STEP_MM: [f64; 2] = [15.4, 14.0];

/// Where the corners of the fiducials are.
const A_MM: [f64; 3] = [-70.0, -84.0, -4.0];
const B_MM: [f64; 3] = [-10.0, 92.0, -18.0];

/// The extents of the reference planes of A and B: (x, y), (y, z), (z, x).
const A_PLANES_MM: [[f64; 2]; 3] = [[64.0, 42.0], [42.0, 26.0], [26.0, 64.0]];
const B_PLANES_MM: [[f64; 2]; 3] = [[52.0, 44.0], [44.0, 20.0], [30.0, 52.0]];

/// A scanner, as far as the experiment chooses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScannerKind {
    /// Standard deviation along the ray, mm.
    pub noise_mm: f64,
    /// Between neighbouring points, mm.
    pub spacing_mm: f64,
}

/// The bar, its corner at the origin.
///
/// # Errors
/// None for these figures.
pub fn part() -> Result<Mesh, ScanError> {
    let [x, y, z] = BAR_MM;
    let [at, deep] = STEP_MM;
    // Its outline in Y and Z, and the same at the other end.
    let outline = [
        [0.0, -z],
        [y, -z],
        [y, -deep],
        [at, -deep],
        [at, 0.0],
        [0.0, 0.0],
    ];
    let near = |i: usize| Vector3::new(0.0, outline[i][0], outline[i][1]);
    let far = |i: usize| near(i) + Vector3::x() * x;
    let mut all = Vec::new();
    let mut quad = |a, b, c, d| all.extend([[a, b, c], [a, c, d]]);
    for i in 0..outline.len() {
        let j = (i + 1) % outline.len();
        quad(near(i), near(j), far(j), far(i));
    }
    for [a, b, c, d] in [[0, 1, 2, 3], [0, 3, 4, 5]] {
        quad(far(a), far(b), far(c), far(d));
        quad(near(d), near(c), near(b), near(a));
    }
    Mesh::new(&all)
}

/// Three planes that meet in the origin, each over its quadrant.
fn corner(planes_mm: &[[f64; 2]; 3], sign: f64) -> Result<Mesh, ScanError> {
    let mut all = Vec::new();
    for (k, [first, second]) in planes_mm.iter().enumerate() {
        let mut a = Vector3::zeros();
        let mut b = Vector3::zeros();
        a[k] = sign * first;
        b[(k + 1) % 3] = sign * second;
        let o = Vector3::zeros();
        all.extend([[o, a, a + b], [o, a + b, b]]);
    }
    Mesh::new(&all)
}

/// The fiducials as they were measured: half a turn about Z, with this doubt about their turns.
///
/// # Errors
/// None for these figures.
pub fn fiducials(u_rotation_rad: f64) -> Result<Vec<Fiducial>, ScanError> {
    let half = Pose::turn(&Vector3::z(), &Vector3::zeros(), std::f64::consts::PI);
    let one = |name: &str, mesh: Mesh, at: [f64; 3]| Fiducial {
        name: name.to_owned(),
        shape: FiducialShape::Mesh(mesh),
        pose: Pose::shift_mm(Vector3::from(at)).after(&half),
        u_position_mm: 0.0,
        u_rotation_rad,
        carried: false,
    };
    Ok(vec![
        one("A", corner(&A_PLANES_MM, -1.0)?, A_MM),
        one("B", corner(&B_PLANES_MM, 1.0)?, B_MM),
    ])
}

/// The cell with the part here, and each fiducial turned about its corner by these.
///
/// # Errors
/// None for this text.
pub fn scene(part: &Pose, misaligned: &[Vector3<f64>; 2]) -> Result<Scene, SceneError> {
    let scene = Scene::parse(&format!("{CELL}{BAR}"))?;
    Ok(placed(scene, part, misaligned))
}

/// The cell with the raw part here; its file is in `folder`.
///
/// # Errors
/// The file cannot be read.
pub fn raw_scene(part: &RigidTransform, folder: &Path) -> Result<Scene, SceneError> {
    let scene = Scene::parse_in(&format!("{CELL}{RAW}"), folder)?;
    let part = Pose {
        rotation: part.rotation,
        translation_mm: part.translation_mm,
    };
    Ok(placed(scene, &part, &[Vector3::zeros(); 2]))
}

fn placed(mut scene: Scene, part: &Pose, misaligned: &[Vector3<f64>; 2]) -> Scene {
    let half = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
    let placed = |rotation, translation_mm| RigidTransform {
        rotation,
        translation_mm,
    };
    scene.place("PART", placed(part.rotation, part.translation_mm));
    for (name, at, turn) in [("A", A_MM, misaligned[0]), ("B", B_MM, misaligned[1])] {
        scene.place(name, placed(rotation(&turn) * half, Vector3::from(at)));
    }
    scene
}

/// The scanner where the operator puts it next: somewhere above the open sides of both corners.
pub fn scanner(kind: &ScannerKind, random: &mut Random) -> AreaScannerSpec {
    let mut about = |middle: f64, by: f64| middle + random.between(-by, by);
    let direction = Vector3::new(about(-0.5, 0.2), about(-0.5, 0.2), 1.0).normalize();
    let target = Vector3::new(about(-45.0, 8.0), about(0.0, 8.0), 0.0);
    AreaScannerSpec {
        position_mm: (target + direction * about(450.0, 30.0)).into(),
        look_at_mm: Some(target.into()),
        rotation_deg: None,
        field_deg: [25.0, 25.0],
        distance_mm: 450.0,
        spacing_mm: kind.spacing_mm,
        range_mm: [200.0, 700.0],
        noise_mm: kind.noise_mm,
        shared_noise_mm: 0.0,
        shared_length_mm: 15.0,
        grazing_deg: 75.0,
        drop_out: 0.01,
        spot_mm: 0.0,
        baseline_mm: 0.0,
    }
}
