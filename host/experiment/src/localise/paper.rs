//! What the paper prints.

use nalgebra::Vector3;
use umi_scan::rigid::Pose;

/// A clamping of table 4: millimetres and degrees, measured by the probe and located by the scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrintedClamping {
    /// X, Y, Z as measured.
    pub measured_mm: [f64; 3],
    /// X, Y, Z as located.
    pub located_mm: [f64; 3],
    /// About X, Y, Z as measured.
    pub measured_deg: [f64; 3],
    /// About X, Y, Z as located.
    pub located_deg: [f64; 3],
}

const fn clamping(
    measured_mm: [f64; 3],
    located_mm: [f64; 3],
    measured_deg: [f64; 3],
    located_deg: [f64; 3],
) -> PrintedClamping {
    PrintedClamping {
        measured_mm,
        located_mm,
        measured_deg,
        located_deg,
    }
}

/// Table 4.
pub const TABLE_4: [PrintedClamping; 5] = [
    clamping(
        [-77.47, -12.79, 20.67],
        [-77.52, -13.0, 20.99],
        [0.5, -0.1, 0.0],
        [0.7, 0.0, 0.2],
    ),
    clamping(
        [-80.06, -10.41, 21.08],
        [-80.13, -10.95, 21.49],
        [-6.8, 0.1, 0.0],
        [-6.6, 0.2, 0.0],
    ),
    clamping(
        [-78.81, -12.16, 20.31],
        [-78.91, -12.44, 20.63],
        [-1.9, 0.3, 0.0],
        [-1.9, 0.4, 0.0],
    ),
    clamping(
        [-80.9, -11.59, 21.71],
        [-80.97, -12.01, 22.11],
        [-3.1, 0.0, 0.0],
        [-3.0, 0.0, 0.1],
    ),
    clamping(
        [-78.78, -13.86, 19.75],
        [-78.85, -14.16, 20.03],
        [4.0, 0.0, 0.0],
        [4.2, 0.0, 0.3],
    ),
];

/// The scanner's stated accuracy, taken as two standard deviations, mm.
pub const SCANNER_2_SIGMA_MM: f64 = 0.381;
/// Between neighbouring points of its scans: 4400 a square inch, mm.
pub const SPACING_MM: f64 = 0.383;
/// What the paper calls sufficient for use: an industrial scanner, mm.
pub const INDUSTRIAL_MM: f64 = 0.025;
/// The run-out to which a fiducial was aligned: 0.0254 mm over about 50 mm, rad.
pub const RUN_OUT_RAD: f64 = 0.0254 / 50.0;

impl PrintedClamping {
    /// The measured pose: machine from part.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let turn =
            axes.iter()
                .zip(self.measured_deg)
                .fold(Pose::identity(), |turned, (axis, degrees)| {
                    Pose::turn(axis, &Vector3::zeros(), degrees.to_radians()).after(&turned)
                });
        Pose::shift_mm(Vector3::from(self.measured_mm)).after(&turn)
    }

    /// Located less measured, mm.
    #[must_use]
    pub fn error_mm(&self) -> Vector3<f64> {
        Vector3::from(self.located_mm) - Vector3::from(self.measured_mm)
    }

    /// Located less measured, degrees.
    #[must_use]
    pub fn error_deg(&self) -> Vector3<f64> {
        Vector3::from(self.located_deg) - Vector3::from(self.measured_deg)
    }
}

/// A parameter that the authors chose "by trial and error as well as the authors' experience", as tables 2 and 3 print it, in
/// millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrintedParameter {
    /// Its name.
    pub name: &'static str,
    /// What it was set to: in table 2, and in table 3 where that differs.
    pub set: &'static str,
    /// What stands for it here.
    pub here: Counterpart,
}

/// What stands for a parameter of the paper here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counterpart {
    /// [`umi_scan::localise::Chosen::normals_mm`]
    Normals,
    /// [`umi_scan::localise::Chosen::search_mm`]
    Search,
    /// [`umi_scan::localise::Chosen::reach_mm`]
    Reach,
    /// [`umi_scan::localise::Chosen::enough_mm`]
    Enough,
    /// The noise that was found.
    Noise,
    /// Nothing, for this reason.
    None(&'static str),
}

/// Tables 2 and 3, and the threshold of the text.
pub const PARAMETERS: [PrintedParameter; 12] = {
    const fn set(name: &'static str, set: &'static str, here: Counterpart) -> PrintedParameter {
        PrintedParameter { name, set, here }
    }
    use Counterpart::{Enough, Noise, None, Normals, Reach, Search};
    [
        set("normal estimation radius", "1 mm", Normals),
        set("downsampling radius, fiducials and scan", "4 mm", Search),
        set("FPFH radius", "20 mm", None("pairs of points vote")),
        set("SAC-IA samples", "3", None("pairs of points vote")),
        set(
            "SAC-IA correspondence randomness",
            "2",
            None("nothing is drawn"),
        ),
        set("SAC-IA iterations", "4000", None("nothing is drawn")),
        set("ICP largest distance", "5 mm", Reach),
        set("ICP iterations", "400; 600", None("ends by its step")),
        set("ICP epsilon", "1e-9; 2.5e-3 mm", Enough),
        set(
            "MLS radius, order, Gauss parameter",
            "2 mm, 3, 4 mm2",
            None("nothing is smoothed"),
        ),
        set(
            "voxels of the joined scans",
            "0.5 mm",
            None("all points count"),
        ),
        set("mean distance of a good fit", "0.4 mm", Noise),
    ]
};
