//! The tool as its users run it: its output, its exit status, its help.

mod board;
mod control;
mod demo;
mod fits;
mod help;
mod hostile;
mod input;
mod outputs;
mod readme;
mod record;
mod rig;
mod scan;
