//! Captures of the axes: a touch's into the queue, a scan's to the host.

pub(crate) mod latch;
pub(crate) mod scan;
