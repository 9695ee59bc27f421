//! The tool as its users run it: its output, its exit status, its help.

mod board;
mod connected;
mod correction;
mod demo;
mod events;
mod fits;
mod help;
mod input;
mod job;
mod machine;
mod nc;
mod program;
mod run;
mod watch;
