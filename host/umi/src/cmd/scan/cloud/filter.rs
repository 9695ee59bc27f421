//! `umi scan filter`

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use umi_scan::ScanError;
use umi_scan::format::poses;
use umi_scan::format::table::TableReader;
use umi_scan::rigid::Vec3;
use umi_scan::thin::edges::mixed;
use umi_scan::thin::filter::{held, intensity, isolated, spikes, statistical};
use umi_scan::thin::seen::{Beams, of_these_poses, range, steep};

use super::thin::{Clouds, above_zero, numbers};
use crate::cmd::scan::answer::failure;
use crate::failure::Failure;

/// A cloud without points that are no surface, or that the sensor saw badly: dark ones, out of
/// range, mixed ones at edges, spikes, too much from the side, isolated ones, outliers
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Filter {
    #[command(flatten)]
    clouds: Clouds,
    /// The least and the greatest intensity
    #[arg(long, value_name = "LEAST,MOST", value_parser = least_and_most)]
    intensity: Option<[f64; 2]>,
    /// The least and the greatest z in the sensor's own frame, in mm (--poses)
    #[arg(long, value_name = "LEAST,MOST", value_parser = least_and_most, allow_hyphen_values = true, requires = "poses")]
    range: Option<[f64; 2]>,
    /// Leave out mixed points: at most N points in a row between two surfaces of their profile,
    /// further than MM from either as it would go on
    #[arg(long, value_name = "MM,N", value_parser = cell)]
    mixed: Option<(f64, u64)>,
    /// Leave out a point that stands off the line between its neighbours in the profile by more
    /// than this, where what is before it and what is behind it agree within it
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    spike: Option<f64>,
    /// Leave out points where the surface stands off the beam by more than DEG, by the points in
    /// their cell of MM and those about it (--poses or --beam)
    #[arg(long, value_name = "DEG[,MM]", value_parser = incidence, requires = "looking")]
    incidence: Option<(f64, f64)>,
    #[command(flatten)]
    looking: Looking,
    /// Leave out points with fewer than N others in their cell of MM and those about it
    #[arg(long, value_name = "MM,N", value_parser = cell)]
    isolated: Option<(f64, u64)>,
    /// Leave out points whose mean distance to the K nearest is more than SIGMAS standard
    /// deviations above the mean of all
    #[arg(long, value_name = "K,SIGMAS", value_parser = neighbours)]
    statistical: Option<(usize, f64)>,
    /// Write what is left out, too (.csv or .ply)
    #[arg(long, value_name = "CLOUD")]
    dropped: Option<PathBuf>,
}

/// Where the sensor looked from.
#[derive(Args)]
#[group(id = "looking", multiple = false)]
struct Looking {
    /// Where the sensor was at each profile, as `umi scan merge --poses` writes it
    #[arg(long, value_name = "POSES.csv")]
    poses: Option<PathBuf>,
    /// The direction in which it always looked, in the cloud's frame
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    beam: Option<[f64; 3]>,
}

const HELP: &str = "\
Filters follow each other in the order above; each point that is left out is counted by the
first one that says so. With --intensity, --range, --mixed and --spike points go through one by
one, with --mixed and --spike profile by profile; --incidence, --isolated and --statistical hold
the cloud in memory.

--spike and --mixed do not take the pitch of the points, or a steep flank, for a height: a point is
held against the lines that carry on what its profile has on either side. With --poses or --beam its
distance is taken along the beam, else square to each line (noted as no_beam): give --beam 0,0,-1 for
a sensor that looks down. A chamfer that no more than N points of a profile lie on looks like mixed
points; a rib of so few does not.

Examples:
  umi scan filter cloud.csv --spike 0.5 -o clean.csv
  umi scan filter cloud.ply --isolated 1,3 --dropped lonely.ply -o clean.ply
  umi scan filter cloud.csv --intensity 20,250 --statistical 8,3 -o clean.laz --json
  umi scan filter cloud.csv --spike 0.5 --beam 0,0,-1 -o clean.csv
  umi scan filter cloud.csv --mixed 0.3,2 --incidence 65 --beam 0,0,-1 -o clean.ply
  umi scan filter cloud.csv --poses poses.csv --range -38,38 --incidence 60,0.4 -o clean.ply

Refused (status 2): no_filter, no_profiles (for --spike, --mixed and --poses), no_intensity,
foreign_poses (of another scan, or of a cloud that was moved), unordered (points of a profile that do not follow each
other),
too_few_points, not_finite, nothing_left (no file is written).";

/// Said where spikes or mixed points are sought without knowing where the sensor looked from.
const NO_BEAM: &str = "no_beam: the cloud does not say where the sensor looked from. How far a point stands off its profile was \
                       taken square to the line of its neighbours, which on a slope is less than along the beam. Give --poses or \
                       --beam to have it along the beam.";

/// The cell's edge where none is given, in mm.
const CELL_MM: f64 = 0.5;

fn least_and_most(text: &str) -> Result<[f64; 2], String> {
    let [least, most] = numbers::<2>(text)?;
    if least <= most {
        return Ok([least, most]);
    }
    Err(format!(
        "nothing lies between them: give the least first, as {most},{least}"
    ))
}

fn incidence(text: &str) -> Result<(f64, f64), String> {
    let (deg, mm) = match text.split_once(',') {
        Some(_) => numbers::<2>(text).map(|[deg, mm]| (deg, mm))?,
        None => numbers::<1>(text).map(|[deg]| (deg, CELL_MM))?,
    };
    if deg > 0.0 && deg < 90.0 && mm > 0.0 {
        return Ok((deg, mm));
    }
    Err(
        "give an angle above 0 and below 90 degrees, and the size of a cell in mm, as 60,0.5"
            .into(),
    )
}

fn cell(text: &str) -> Result<(f64, u64), String> {
    numbers::<2>(text)
        .ok()
        .filter(|[mm, n]| *mm > 0.0 && *n >= 1.0 && n.fract() == 0.0 && *n < 1e9)
        .map(|[mm, n]| (mm, n as u64))
        .ok_or_else(|| "give the size of a cell in mm and a whole number of points, as 1,3".into())
}

fn neighbours(text: &str) -> Result<(usize, f64), String> {
    numbers::<2>(text)
        .ok()
        .filter(|[k, s]| (1.0..=1000.0).contains(k) && k.fract() == 0.0 && *s > 0.0)
        .map(|[k, s]| (k as usize, s))
        .ok_or_else(|| "give 1 to 1000 neighbours and standard deviations above 0, as 8,3".into())
}

impl Filter {
    pub fn run(&self) -> Result<(), Failure> {
        let any = self.intensity.is_some()
            || self.spike.is_some()
            || self.range.is_some()
            || self.mixed.is_some()
            || self.incidence.is_some()
            || self.isolated.is_some()
            || self.statistical.is_some();
        let beams = self.looking.read().map_err(failure)?;
        let by_profile =
            self.spike.is_some() || self.mixed.is_some() || matches!(beams, Some(Beams::Poses(_)));
        let notes: &[&str] = match beams {
            None if self.spike.is_some() || self.mixed.is_some() => &[NO_BEAM],
            _ => &[],
        };
        self.clouds.run(
            "filter",
            self.dropped.as_deref(),
            |columns| {
                let refused = |code, what: &str| Err(ScanError::refused(code, what));
                if !any {
                    return refused(
                        "no_filter",
                        "Name what goes: --intensity, --range, --mixed, --spike, --incidence, \
                         --isolated or --statistical.",
                    );
                }
                if by_profile && !columns.profile {
                    return refused(
                        "no_profiles",
                        "The cloud does not say which profiles its points are of: it has no column `profile`. \
                         `umi scan merge --profiles-too` writes it to a PLY.",
                    );
                }
                if self.intensity.is_some() && !columns.intensity {
                    return refused(
                        "no_intensity",
                        "The cloud does not say how bright its points are: it has no column `intensity`.",
                    );
                }
                Ok(())
            },
            false,
            &|mut points, drops| {
                if let Some(Beams::Poses(poses)) = &beams {
                    points = of_these_poses(points, Arc::clone(poses));
                }
                if let Some([least, most]) = self.intensity {
                    points = intensity(points, least, most, drops);
                }
                if let (Some([least, most]), Some(Beams::Poses(poses))) = (self.range, &beams) {
                    points = range(points, Arc::clone(poses), least, most, drops);
                }
                if let Some((off_mm, most)) = self.mixed {
                    points = mixed(points, off_mm, most as usize, beams.clone(), drops);
                }
                if let Some(off_mm) = self.spike {
                    points = spikes(points, off_mm, beams.clone(), drops);
                }
                if self.incidence.is_none() && self.isolated.is_none() && self.statistical.is_none()
                {
                    return Ok(points);
                }
                let mut all = held(points)?;
                if let (Some((most_deg, cell_mm)), Some(beams)) = (self.incidence, &beams) {
                    all = steep(all, beams, most_deg, cell_mm, drops)?;
                }
                if let Some((cell_mm, least)) = self.isolated {
                    all = isolated(all, cell_mm, least, drops)?;
                }
                if let Some((k, sigmas)) = self.statistical {
                    all = statistical(all, k, sigmas, drops)?;
                }
                Ok(Box::new(all.into_iter().map(Ok)))
            },
            notes,
        )
    }
}

impl Looking {
    fn read(&self) -> Result<Option<Beams>, ScanError> {
        if let Some(path) = &self.poses {
            return Ok(Some(Beams::Poses(Arc::new(poses::read(
                TableReader::open(path)?,
            )?))));
        }
        let Some(beam) = self.beam else {
            return Ok(None);
        };
        let beam = Vec3::from(beam).try_normalize(1e-12);
        let beam = beam.ok_or_else(|| ScanError::unreadable("usage", "--beam has length 0"))?;
        Ok(Some(Beams::Along(beam)))
    }
}
