//! Solvers: least squares of distances to a surface, small linear programmes, and Student's t.

mod kernel;
mod least;
pub mod linear;
mod small;
pub mod student;

pub use kernel::Kernel;
pub use least::{Measured, Offset, Settled, Task, measure};
pub(crate) use least::{left_jacobian, measure_within};
pub(crate) use small::median;
pub use small::{eigen, pseudo_solve};
