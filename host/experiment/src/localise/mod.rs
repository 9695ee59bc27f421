//! Where a part is, by six scans and two fiducials: the experiment of H. Srinivasan, O. Harrysson and R. Wysk
//! ("Automatic part localization in a CNC machine coordinate system by means of 3D scans", Int. J. Adv. Manuf. Technol.,
//! 2015) on a virtual machine.
//!
//! | file | idea |
//! | --- | --- |
//! | `paper` | what its tables 4 and 5 print, and what follows from it |
//! | `cell` | the part, the two corner fiducials, the trunnion, the scanner where the operator puts it |
//! | `run` | six scans in each of the five clampings, localised; the nine hits of a probe beside it |
//! | `figures` | bias, scatter and length of the errors |
//! | `raw` | a near-net-shape part: finished, and as it was printed |
//! | `cut` | the finished part put where its stock is best, and cut |
//!
//! The poses of table 4 as it measured them are the truth here. The paper does not print its angle convention: the turn is
//! about X, then Y, then Z of the machine. Nor does it print the part's extent: a stepped bar of its place and its three
//! reference planes.

pub mod cell;
pub mod cut;
pub mod figures;
pub mod paper;
pub mod raw;
pub mod run;
#[cfg(test)]
mod tests;
