//! What self-tests of boards share: the table that they send, the host's request, and what became of
//! edges that were driven at known positions and times. The boards' own images drive and measure.
//!
//! | file | idea |
//! | --- | --- |
//! | [`table`] | rows as they are measured, and the request that they answer |
//! | [`edges`] | captures against what was driven |
//! | [`loopback`] | the control's line, led back |

pub mod edges;
pub mod loopback;
pub mod table;
