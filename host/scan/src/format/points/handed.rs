//! Points to a writer that takes them one by one: the formats of clouds beside CSV and PLY.
//!
//! The writer has a thread of its own, and a channel of a few profiles between: memory does not
//! grow with the scan. What ends before its end leaves no file.

use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::PointSink;
use crate::ScanError;
use crate::cloud::CloudPoint;
use crate::format::clouds::write::WrittenCloud;
use crate::format::clouds::{CloudStyle, write_cloud};

/// Profiles that wait between merge and writer.
const WAITING: usize = 64;

enum Handover {
    Points(Vec<CloudPoint>),
    /// There are no more.
    End,
}

pub(super) struct HandedPoints {
    to: Option<SyncSender<Handover>>,
    writer: Option<JoinHandle<Result<WrittenCloud, ScanError>>>,
    /// Of the profile that comes next.
    t_us: f64,
    /// As `t_us`, of its points.
    mount_u_mm: Vec<f64>,
    /// As `mount_u_mm`.
    intensities: Vec<f64>,
    /// As `t_us`.
    interpolated: bool,
}

impl HandedPoints {
    pub(super) fn new(path: &Path, style: CloudStyle) -> Self {
        let (to, from) = sync_channel(WAITING);
        let path = path.to_owned();
        let writer = std::thread::spawn(move || {
            let points = Arriving {
                from,
                points: Vec::new().into_iter(),
                ended: false,
            };
            write_cloud(&path, style, Box::new(points))
        });
        Self {
            to: Some(to),
            writer: Some(writer),
            t_us: 0.0,
            mount_u_mm: Vec::new(),
            intensities: Vec::new(),
            interpolated: false,
        }
    }

    /// What the writer says once nothing more comes.
    fn close(&mut self) -> Result<WrittenCloud, ScanError> {
        self.to = None;
        let gone = || ScanError::unreadable("file", "the writer of the cloud ended");
        self.writer
            .take()
            .map_or_else(|| Err(gone()), |writer| writer.join().map_err(|_| gone())?)
    }

    fn hand(&mut self, message: Handover) -> Result<(), ScanError> {
        let taken = self.to.as_ref().is_some_and(|to| to.send(message).is_ok());
        if taken {
            return Ok(());
        }
        // The writer stopped: what it says is the reason.
        self.close().map(|_| ())
    }
}

impl PointSink for HandedPoints {
    fn time(&mut self, t_us: f64) {
        self.t_us = t_us;
    }

    fn uncertainties(&mut self, mount_u_mm: &[f64]) {
        self.mount_u_mm.clear();
        self.mount_u_mm.extend_from_slice(mount_u_mm);
    }

    fn intensities(&mut self, intensities: &[f64]) {
        self.intensities.clear();
        self.intensities.extend_from_slice(intensities);
    }

    fn interpolated(&mut self, is: bool) {
        self.interpolated = is;
    }

    fn profile(&mut self, profile: u64, points: &[(u32, [f64; 3])]) -> Result<(), ScanError> {
        let (t_us, interpolated) = (self.t_us, self.interpolated);
        let u_mm = self.mount_u_mm.iter().copied();
        let u_mm = u_mm.chain(std::iter::repeat(0.0));
        let bright = self.intensities.iter().copied();
        let beside = u_mm.zip(bright.chain(std::iter::repeat(0.0)));
        let points = points
            .iter()
            .zip(beside)
            .map(|(&(index, at), (mount_u_mm, intensity))| CloudPoint {
                at,
                profile,
                index,
                t_us,
                mount_u_mm,
                intensity,
                interpolated,
            });
        self.hand(Handover::Points(points.collect()))
    }

    fn finish(&mut self, _: u64) -> Result<(), ScanError> {
        self.hand(Handover::End)?;
        self.close().map(|_| ())
    }
}

impl Drop for HandedPoints {
    fn drop(&mut self) {
        // Waits until the writer has taken its partial file away; its refusal is our own.
        let _ = self.close();
    }
}

/// The writer's end.
struct Arriving {
    from: Receiver<Handover>,
    points: std::vec::IntoIter<CloudPoint>,
    ended: bool,
}

impl Iterator for Arriving {
    type Item = Result<CloudPoint, ScanError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(point) = self.points.next() {
                return Some(Ok(point));
            }
            if self.ended {
                return None;
            }
            match self.from.recv() {
                Ok(Handover::Points(points)) => self.points = points.into_iter(),
                Ok(Handover::End) => self.ended = true,
                Err(_) => {
                    self.ended = true;
                    return Some(Err(ScanError::unreadable(
                        "file",
                        "the cloud ended before its end",
                    )));
                }
            }
        }
    }
}
