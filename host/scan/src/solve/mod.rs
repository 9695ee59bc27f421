//! Solvers: least squares of distances to a surface, and small linear programmes.

mod kernel;
mod least;
pub mod linear;
mod small;

pub use kernel::Kernel;
pub use least::{Measured, Offset, Settled, Task, measure};
pub(crate) use least::{left_jacobian, measure_within};
pub use small::{eigen, pseudo_solve};
