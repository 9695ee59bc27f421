//! Axis positions over time, along the path that the bench has laid.

use heapless::Deque;
use umi_core::units::Counts;
use umi_protocol::latch::MAX_AXES;

/// Axes of this board.
pub const AXES: usize = 4;
const _: () = assert!(AXES <= MAX_AXES);

/// Encoder counts of all axes.
pub type AxisCounts = [Counts; AXES];

/// Corners of the path that are kept: an edge may be told as late as that.
const CORNERS: usize = 64;

/// A corner of the path: between two of them the axes move evenly.
#[derive(Clone, Copy)]
struct Corner {
    t_ns: u64,
    counts: AxisCounts,
}

/// The path of the axes over the board's clock.
pub struct Path {
    /// The oldest first.
    corners: Deque<Corner, CORNERS>,
    /// The last one.
    end: Corner,
}

/// The path goes back in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backwards;

impl Path {
    /// Axes that have always stood at zero.
    pub const fn new() -> Self {
        Self {
            corners: Deque::new(),
            end: Corner {
                t_ns: 0,
                counts: [Counts(0); AXES],
            },
        }
    }

    /// Appends standing and moving.
    pub fn lay(&mut self, from_ns: u64, to_ns: u64, counts: &[i64]) -> Result<(), Backwards> {
        if from_ns < self.end.t_ns || to_ns <= from_ns {
            return Err(Backwards);
        }
        let mut end = self.end;
        end.t_ns = from_ns;
        self.push(end);
        end.t_ns = to_ns;
        for (place, count) in end.counts.iter_mut().zip(counts) {
            *place = Counts(*count);
        }
        self.push(end);
        Ok(())
    }

    fn push(&mut self, corner: Corner) {
        if self.corners.is_full() {
            self.corners.pop_front();
        }
        // There is room: just made.
        let _ = self.corners.push_back(corner);
        self.end = corner;
    }

    /// Where the axes are at an instant; none if that is longer ago than the path reaches.
    /// A count is one when it has been passed.
    pub fn at(&self, t_ns: u64) -> Option<AxisCounts> {
        if t_ns >= self.end.t_ns {
            return Some(self.end.counts);
        }
        let later = self.corners.iter().position(|corner| corner.t_ns > t_ns)?;
        let mut corners = self.corners.iter().skip(later.checked_sub(1)?);
        let (a, b) = (corners.next()?, corners.next()?);
        let mut counts = a.counts;
        for (count, to) in counts.iter_mut().zip(b.counts) {
            *count = between(*count, to, t_ns - a.t_ns, b.t_ns - a.t_ns);
        }
        Some(counts)
    }
}

/// The count after a part of the way.
fn between(Counts(from): Counts, Counts(to): Counts, part_ns: u64, whole_ns: u64) -> Counts {
    let way = i128::from(to) - i128::from(from);
    // No further than `to`, so it fits.
    Counts((i128::from(from) + way * i128::from(part_ns) / i128::from(whole_ns)) as i64)
}
