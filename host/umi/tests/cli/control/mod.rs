//! What goes to a control, and the virtual one.

mod basis;
mod correction;
mod machine;
mod nc;
mod nc_diff;
mod nc_hints;
mod nc_refusals;
mod program;
mod taken_back;
