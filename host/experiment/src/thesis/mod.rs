//! The experiment of A. Sawula's thesis (2013, chapters 4 and 5): a plate with three spheres and a workpiece is clamped
//! five times, probed, registered, and a fifth of the workpiece's surface finished in each clamping; then the whole
//! surface is measured.
//!
//! | file | idea |
//! | --- | --- |
//! | `part`, `path` | the workpiece, and its finishing path as an NC program |
//! | `cases` | how the plate stands in the five clampings |
//! | `shop/` | the machine with its errors; the probing programs |
//! | `run` | one run, from the ring gauge to the measured surface |
//! | `outcome` | what it gives |
//! | `pages` | the pages on it |
//! | `printed` | what the thesis prints, for comparison |
//!
//! # What each remedy leaves
//!
//! Without error sources, in the clampings of table 4.2 (tilts up to 0.0115 degrees), on one
//! surface of about 51 by 70 mm; `tests/experiment.rs` prints it and holds it
//! (`cargo test -p umi-experiment --test experiment every_remedy -- --nocapture`), `umi demo --ideal
//! --printed-poses --remedy NAME` shows one:
//!
//! | remedy | mean, mm | standard deviation | lowest | highest | the programs state |
//! | --- | ---: | ---: | ---: | ---: | ---: |
//! | `g10-g68` | -0.0007 | 0.0030 | -0.0071 | +0.0066 | 0.0071 |
//! | `variables` | -0.0007 | 0.0030 | -0.0071 | +0.0066 | 0.0071 |
//! | `haas` | -0.0007 | 0.0030 | -0.0071 | +0.0066 | 0.0071 |
//! | `linuxcnc` | -0.0006 | 0.0029 | -0.0067 | +0.0065 | 0.0069 |
//! | `g68-3d` | +0.0003 | 0.0006 | -0.0011 | +0.0017 | 0.0010 |
//! | `fanuc-g54.4` | +0.0003 | 0.0006 | -0.0012 | +0.0018 | 0.0011 |
//! | `rewritten` | +0.0005 | 0.0005 | -0.0006 | +0.0022 | half a step |
//! | `grbl` | NG: it cannot turn; only the reference is cut | | | | |
//!
//! The cusps of the passes are up to 0.0012 mm of it. The probing programs are in Fanuc's
//! language; for Haas, LinuxCNC and GRBL a second control on the same axes finishes.

pub mod cases;
pub mod outcome;
pub mod pages;
pub mod part;
pub mod path;
pub mod printed;
pub mod run;
