//! `umi scan crop`

use std::ops::RangeInclusive;
use std::path::PathBuf;

use clap::Args;
use umi_scan::ScanError;
use umi_scan::rigid::Vec3;
use umi_scan::thin::crop::{CropRegion, crop};

use super::thin::{Clouds, numbers};
use crate::failure::Failure;

/// The part of a cloud that lies in a box, in a ball, on a side of a plane, or in some profiles
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Crop {
    #[command(flatten)]
    clouds: Clouds,
    /// Two corners of a box, in mm
    #[arg(long = "box", value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = numbers::<6>)]
    corners: Option<[f64; 6]>,
    /// Centre and radius of a ball, in mm
    #[arg(long, value_name = "X,Y,Z,R", allow_hyphen_values = true, value_parser = ball)]
    ball: Option<[f64; 4]>,
    /// A point of a plane and its normal; the side that the normal points to stays
    #[arg(long, value_name = "X,Y,Z,NX,NY,NZ", allow_hyphen_values = true, value_parser = side)]
    side: Option<[f64; 6]>,
    /// The first and the last profile
    #[arg(long, value_name = "FROM-TO", value_parser = profiles)]
    profiles: Option<RangeInclusive<u64>>,
    /// Write what is left out, too (.csv or .ply)
    #[arg(long, value_name = "CLOUD")]
    dropped: Option<PathBuf>,
}

const HELP: &str = "\
What lies in all regions that are named stays; a point on a border stays. The memory does
not grow with the cloud.

Examples:
  umi scan crop cloud.ply --box -10,-10,0,60,40,25 -o part.ply
  umi scan crop cloud.csv --side 0,0,2,0,0,1 --dropped table.csv -o part.csv
  umi scan crop cloud.csv --profiles 100-250 -o piece.csv --json

Refused (status 2): no_region, no_profiles (the cloud does not say which profiles its
points are of), nothing_left (no point lies in all of the regions; no file is written).";

fn ball(text: &str) -> Result<[f64; 4], String> {
    numbers::<4>(text)
        .ok()
        .filter(|b| b[3] > 0.0)
        .ok_or_else(|| "give x,y,z and a radius above 0, in mm".into())
}

fn side(text: &str) -> Result<[f64; 6], String> {
    numbers::<6>(text)
        .ok()
        .filter(|s| s[3..] != [0.0; 3])
        .ok_or_else(|| "give a point and a normal that is not 0: six numbers".into())
}

fn profiles(text: &str) -> Result<RangeInclusive<u64>, String> {
    text.split_once('-')
        .and_then(|(from, to)| Some(from.trim().parse().ok()?..=to.trim().parse().ok()?))
        .filter(|range| range.start() <= range.end())
        .ok_or_else(|| "give the first and the last profile, as 100-250".into())
}

impl Crop {
    pub fn run(&self) -> Result<(), Failure> {
        let three = |v: &[f64]| Vec3::new(v[0], v[1], v[2]);
        let mut regions = Vec::new();
        if let Some(c) = &self.corners {
            let (a, b) = (three(&c[..3]), three(&c[3..]));
            regions.push(CropRegion::Box(a.inf(&b), a.sup(&b)));
        }
        if let Some(b) = &self.ball {
            regions.push(CropRegion::Ball(three(&b[..3]), b[3]));
        }
        if let Some(s) = &self.side {
            regions.push(CropRegion::Side(three(&s[..3]), three(&s[3..])));
        }
        if let Some(range) = &self.profiles {
            regions.push(CropRegion::Profiles(range.clone()));
        }
        self.clouds.run(
            "crop",
            self.dropped.as_deref(),
            |columns| {
                if regions.is_empty() {
                    return Err(ScanError::refused(
                        "no_region",
                        "Name what stays: --box, --ball, --side or --profiles.",
                    ));
                }
                if self.profiles.is_some() && !columns.profile {
                    return Err(ScanError::refused(
                        "no_profiles",
                        "The cloud does not say which profiles its points are of: it has no column `profile`. \
                         `umi scan merge --profiles-too` writes it to a PLY.",
                    ));
                }
                Ok(())
            },
            false,
            &|points, drops| Ok(crop(points, regions.clone(), drops)),
            &[],
        )
    }
}
