//! The tool as its users run it: its output, its exit status, its help.

mod board;
mod clouds;
mod connected;
mod correction;
mod demo;
mod digitize;
mod events;
mod fits;
mod help;
mod hostile;
mod input;
mod job;
mod line;
mod localise;
mod machine;
mod nc;
mod nc_refusals;
mod outputs;
mod point_sensor;
mod program;
mod readme;
mod run;
mod scan;
mod teach;
mod trust;
mod watch;
