//! A program as it is carried out, block by block: the control, its calls, codes and system variables.

mod calls;
pub(super) mod codes;
pub(super) mod control;
pub(super) mod execute;
mod linuxcnc;
mod position;
mod statement;
pub(super) mod status;
mod system;
pub(super) mod words;
