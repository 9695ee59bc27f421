//! What solves the fits: points made ready, linear algebra, the search for an axis, least squares.

pub(super) mod axis;
pub(super) mod axis_search;
pub(crate) mod cloud;
pub(crate) mod least_squares;
pub(crate) mod linalg;
