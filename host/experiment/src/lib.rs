//! Published experiments on a desk, each with what its paper prints beside it.
//!
//! | room | idea |
//! | --- | --- |
//! | `thesis` | five clampings by three spheres, probed, corrected, cut and measured |
//! | `scan` | a scanner on a table machine: a washer, a ball, and what time does to both |
//! | `localise` | where a part is by six scans and two fiducials; a raw part cut where its stock is best |

pub mod localise;
pub mod scan;
pub mod thesis;
