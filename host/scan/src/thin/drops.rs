//! Points that are left out, by reason.

use std::cell::RefCell;
use std::path::Path;

use serde::Serialize;

use crate::ScanError;
use crate::cloud::{CloudColumns, CloudPoint, Points};
use crate::format::points::{PointFile, PointSink, PointStyle};

/// How many points were left out for a reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Dropped {
    /// Why.
    pub reason: &'static str,
    /// How many.
    pub points: u64,
}

/// Counts what is left out, and writes it where that is wanted.
#[derive(Default)]
pub struct Drops {
    /// By reason, in the order in which the reasons came.
    pub counts: Vec<Dropped>,
    file: Option<PointFile>,
}

impl Drops {
    /// Dropped points go to a file, too (.csv or .ply, as `umi scan merge` writes them), with their times,
    /// uncertainties and intensities where the cloud has them.
    ///
    /// # Errors
    /// As [`PointFile::create`].
    pub fn to_file(path: &Path, columns: CloudColumns) -> Result<Self, ScanError> {
        let style = PointStyle {
            double: true,
            profiles: false,
            times: columns.time,
            uncertainties: columns.mount_u,
            intensities: columns.intensity,
            interpolated: columns.interpolated,
        };
        Ok(Self {
            counts: Vec::new(),
            file: Some(PointFile::create(path, style)?),
        })
    }

    /// A point is left out.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn drop_point(
        &mut self,
        reason: &'static str,
        point: &CloudPoint,
    ) -> Result<(), ScanError> {
        match self.counts.iter_mut().find(|d| d.reason == reason) {
            Some(dropped) => dropped.points += 1,
            None => self.counts.push(Dropped { reason, points: 1 }),
        }
        match &mut self.file {
            Some(file) => {
                file.time(point.t_us);
                file.uncertainties(&[point.mount_u_mm]);
                file.intensities(&[point.intensity]);
                file.interpolated(point.interpolated);
                file.profile(point.profile, &[(point.index, point.at)])
            }
            None => Ok(()),
        }
    }

    /// No more are left out: the file is complete.
    ///
    /// # Errors
    /// Its end cannot be written.
    pub fn finish(mut self) -> Result<Vec<Dropped>, ScanError> {
        if let Some(file) = &mut self.file {
            file.finish(self.counts.iter().map(|d| d.points).sum())?;
        }
        Ok(self.counts)
    }
}

/// The points for which `judge` has no reason to leave them out.
pub(super) fn judged<'a>(
    points: Points<'a>,
    drops: &'a std::cell::RefCell<Drops>,
    mut judge: impl FnMut(&CloudPoint) -> Option<&'static str> + 'a,
) -> Points<'a> {
    Box::new(points.filter_map(move |point| {
        let point = match point {
            Ok(point) => point,
            Err(error) => return Some(Err(error)),
        };
        match judge(&point) {
            None => Some(Ok(point)),
            Some(reason) => drops.borrow_mut().drop_point(reason, &point).err().map(Err),
        }
    }))
}

/// The points that stay, of which each other one is dropped for this reason.
pub(super) fn keep(
    points: Vec<CloudPoint>,
    drops: &RefCell<Drops>,
    reason: &'static str,
    stays: impl Fn(usize, &CloudPoint) -> bool,
) -> Result<Vec<CloudPoint>, ScanError> {
    let mut kept = Vec::with_capacity(points.len());
    for (i, p) in points.into_iter().enumerate() {
        if stays(i, &p) {
            kept.push(p);
        } else {
            drops.borrow_mut().drop_point(reason, &p)?;
        }
    }
    Ok(kept)
}
