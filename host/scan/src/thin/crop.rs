//! What is not of the part.

use std::cell::RefCell;
use std::ops::RangeInclusive;

use super::drops::{Drops, judged};
use crate::cloud::Points;
use crate::rigid::Vec3;

/// What a cloud is cropped to. Points on a border stay.
#[derive(Debug, Clone, PartialEq)]
pub enum CropRegion {
    /// Between two corners.
    Box(Vec3, Vec3),
    /// About a centre, within a radius.
    Ball(Vec3, f64),
    /// On the side of a plane that its normal points to.
    Side(Vec3, Vec3),
    /// Profiles from a number to a number.
    Profiles(RangeInclusive<u64>),
}

impl CropRegion {
    /// Why a point outside is left out.
    const fn reason(&self) -> &'static str {
        match self {
            Self::Box(..) => "outside_box",
            Self::Ball(..) => "outside_ball",
            Self::Side(..) => "behind_plane",
            Self::Profiles(_) => "other_profile",
        }
    }

    /// Is a point in the region?
    #[must_use]
    pub fn holds(&self, at: &Vec3, profile: u64) -> bool {
        match self {
            Self::Box(low, high) => (0..3).all(|k| (low[k]..=high[k]).contains(&at[k])),
            Self::Ball(centre, radius) => (at - centre).norm() <= *radius,
            Self::Side(on, normal) => (at - on).dot(normal) >= 0.0,
            Self::Profiles(range) => range.contains(&profile),
        }
    }
}

/// The points that lie in all regions; the first region that does not hold a point is its reason.
pub fn crop<'a>(
    points: Points<'a>,
    regions: Vec<CropRegion>,
    drops: &'a RefCell<Drops>,
) -> Points<'a> {
    judged(points, drops, move |p| {
        let at = Vec3::from(p.at);
        regions
            .iter()
            .find(|r| !r.holds(&at, p.profile))
            .map(CropRegion::reason)
    })
}
